"""How well a touch probe and a sphere tell the location errors of generated machines, beside the cycles of controls.

Machines of the typical class come from the independent generator and are probed at 34 points. mjsim says the location
errors with 95 % intervals. The same points give centre and direction of the axes by circles, as the cycles of controls
compute them. With --with-bar each machine is measured by a ball bar as well: alone and together with the points.

    scripts/probe_proof.py [--count 60] [--first 200] [--with-bar LAYOUT]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from independent import sphere  # noqa: E402

from mjsim.campaign.files import read_campaign  # noqa: E402
from mjsim.campaign.machine_file import read_machine  # noqa: E402
from mjsim.workflow.diagnose import diagnose  # noqa: E402


def located(result) -> dict[str, tuple[float, float, float]]:
    """Value and ends of the 95 % interval of every location error, by name, µm and µrad."""
    rows = [(c.effect.effect, c.ci95) for c in result.calibration] + [(e.effect, e.ci95) for e in result.effects]
    out = {}
    for effect, ci in rows:
        if effect.kind == "axis_location":
            (name, (low, high)), *_ = ci.items()
            out[effect.subject] = effect.values[name], low, high
    return out


def measured(seed: int, layout: str) -> tuple[dict[str, float], dict[str, dict], str]:
    """True location errors of one machine; what each route says of them; the verdict on the points."""
    with tempfile.TemporaryDirectory() as folder:
        made = sphere.write_with_bar(folder, seed, layout) if layout else sphere.write(folder, seed)
        campaign = read_campaign(folder)
        machine = read_machine(campaign.machine_file)
        result = diagnose(campaign.of("sphere"), machine)
        routes = {"probe": located(result)}
        circles = {k.partition(".")[2]: v for k, v in result.at_rest.classical.items()}
        routes["circles"] = {k: (v, v, v) for k, v in circles.items()}
        if layout:
            routes["ball bar"] = located(diagnose(campaign.of("ball_bar"), machine))
            routes["both"] = located(diagnose(campaign, machine))
        return {k: v * 1e6 for k, v in made["location"].items()}, routes, result.verdict


def table(truth: list[dict[str, float]], said: list[dict[str, dict]]) -> list[str]:
    """Lines of the table: per location error and route bias, scatter, expanded uncertainty, share inside."""
    out = [f"{'location error':15} {'route':9} {'bias':>7} {'scatter':>8} {'95 % ±':>7} {'inside':>7}   µm, µrad"]
    routes = list(said[0])
    inside: dict[str, list[bool]] = {r: [] for r in routes}
    for name in truth[0]:
        for route in routes:
            rows = [(s[route][name], t[name]) for s, t in zip(said, truth, strict=True) if name in s[route]]
            if not rows:
                continue
            off = np.array([v - t for (v, _, _), t in rows])
            half = np.mean([0.5 * (b - a) for (_, a, b), _ in rows])
            hits = [bool(a <= t <= b) for (_, a, b), t in rows]
            inside[route] += hits
            ends = f"{half:7.2f} {100 * np.mean(hits):6.1f}%" if half > 0.0 else f"{'–':>7} {'–':>7}"
            out.append(f"{name:15} {route:9} {off.mean():+7.2f} {off.std():8.2f} {ends}")
    for route, hits in inside.items():
        if route != "circles":
            out.append(f"inside their 95 % intervals, {route}: {100 * np.mean(hits):.1f} % of {len(hits)}")
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--first", type=int, default=200)
    parser.add_argument("--with-bar", default="", metavar="LAYOUT")
    args = parser.parse_args()
    truth, said, verdicts = [], [], Counter()
    for seed in range(args.first, args.first + args.count):
        true, routes, verdict = measured(seed, args.with_bar)
        truth.append(true)
        said.append(routes)
        verdicts[verdict] += 1
        print(f"machine {seed}: {verdict}", file=sys.stderr, flush=True)
    print("\n".join(table(truth, said)))
    print("verdicts on the points: " + ", ".join(f"{k} {v}" for k, v in verdicts.items()))


if __name__ == "__main__":
    main()
