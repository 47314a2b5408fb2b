#!/usr/bin/env python3
"""How well each way to measure a machine tells what it has: ball bar, probe and sphere, both, or probe, laser and logs.

Machines of the typical class come from the independent generator (``tests/independent/routes.py``). Every second one
has one fault of two to five limits. Each is measured in every way, and diagnosed by each route. Beside the intervals of
mjsim stands what the cycles of controls compute from the same points by circles.

    nice scripts/proofs/routes_proof.py run OUT.jsonl [--count 60] [--first 0] [--route probe]
    scripts/proofs/routes_proof.py page OUT.jsonl [--page docs/routes.md]

The first appends a line a machine, and goes on where it stopped; with --route by some routes only, for the ball bar
takes longest. The second prints the tables, and puts them into the page.
"""

from __future__ import annotations

import argparse
import functools
import json
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from independent import real_machines, routes, sphere  # noqa: E402

from mjsim.campaign.files import read_campaign  # noqa: E402
from mjsim.campaign.machine_file import read_machine  # noqa: E402
from mjsim.commands.at_rest import diagnose_at_rest  # noqa: E402
from mjsim.commands.diagnose import diagnose  # noqa: E402

TABLES = re.compile(r"(<!-- tables -->\n).*?(<!-- end of tables -->)", re.DOTALL)
ROUTES = ("ball bar", "probe", "bar and probe", "probe, laser, logs")
LOCATIONS = tuple(f"axis_location.{n}" for n in routes.FAULTS["axis_location"])
#: Other errors with one number whose intervals are looked at: all of a kind together.
OTHERS = ("squareness", "scale_error.X", "scale_error", "straightness", "backlash.X", "backlash")


def numbers(result) -> dict[str, list[float]]:
    """Value and ends of the 95 % interval of the first number of every fitted effect, by id, in the number's unit."""
    rows = [(c.effect.effect, c.ci95) for c in result.calibration] + [(e.effect, e.ci95) for e in result.effects]
    out = {}
    for effect, ci in rows:
        if ci and "components" not in ci:
            name, (low, high) = next(iter(ci.items()))
            out[effect.id] = [float(effect.values[name]), float(low), float(high)]
    return out


def answer(result, seconds: float) -> dict:
    """What a diagnosis says, as plain data."""
    found = [[e.effect.id, *e.alternatives] for e in result.effects]
    return {"verdict": result.verdict, "found": found, "numbers": numbers(result), "seconds": round(seconds, 1)}


def measured(seed: int, wanted: Collection[str]) -> dict:
    """One machine: what it has, and what each of the wanted routes says."""
    bars = not {ROUTES[0], ROUTES[2]}.isdisjoint(wanted)
    with tempfile.TemporaryDirectory() as folder:
        made = routes.write(folder, seed, bool(seed % 2), "standard" if bars else "")
        campaign = read_campaign(folder)
        machine = read_machine(campaign.machine_file)
        said, begun = {}, time.process_time()

        def keep(route: str, result) -> None:
            nonlocal begun
            said[route] = answer(result, time.process_time() - begun)
            begun = time.process_time()

        row = {"seed": seed, "fault": made["fault"], "truth": {}, "routes": said}
        if ROUTES[1] in wanted:
            points = diagnose(campaign.of("sphere"), machine)
            keep(ROUTES[1], points)
            row["circles"] = points.at_rest[0].classical
        if ROUTES[3] in wanted:
            keep(ROUTES[3], diagnose(campaign.of("sphere", "positions", "axis_log"), machine))
        if bars:
            found = diagnose(campaign.of("ball_bar"), machine)
            keep(ROUTES[0], found)
            keep(ROUTES[2], diagnose_at_rest(campaign.of("ball_bar", "sphere"), machine, beside=found))
    for effect in made["effects"]:
        name, value = next((k, v) for k, v in effect.items() if k != "id")
        if name != "components":
            row["truth"][effect["id"]] = value
    return row


def run(out: Path, first: int, count: int, wanted: Collection[str]) -> None:
    """Measures the machines that are not in the file yet."""
    done = rows_of(out)
    for group in (ROUTES[1::2], ROUTES[0::2]):
        for seed in range(first, first + count):
            have = done.get(seed, {"routes": {}})["routes"]
            missing = [r for r in group if r in wanted and r not in have]
            if not missing:
                continue
            row = measured(seed, missing)
            with out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            said = ", ".join(f"{r} {a['verdict']}" for r, a in row["routes"].items())
            print(f"machine {seed} ({(row['fault'] or {'id': 'sound'})['id']}): {said}", flush=True)


def rows_of(out: Path) -> dict[int, dict]:
    """The machines that were measured, by seed."""
    machines: dict[int, dict] = {}
    for line in out.read_text().splitlines() if out.exists() else ():
        row = json.loads(line)
        known = machines.setdefault(row["seed"], row)
        machines[row["seed"]] = known | row | {"routes": known["routes"] | row["routes"]}
    return machines


def cases(rows: list[dict], route: str, name: str) -> Iterator[tuple[float, float, float, float]]:
    """True value, value and ends of the interval of the numbers whose id begins so."""
    for row in measured_by(rows, route):
        for i, true in row["truth"].items():
            if i.startswith(name) and i in row["routes"][route]["numbers"]:
                yield true, *row["routes"][route]["numbers"][i]


def measured_by(rows: list[dict], route: str) -> list[dict]:
    """The machines that were measured in a way."""
    return [row for row in rows if route in row["routes"]]


def inside(rows: list[dict], route: str, names: tuple[str, ...]) -> str:
    """How many of the numbers lie within their intervals, and the RMS of what they are off over its deviation: that of
    the side on which the truth lies, because the interval of a play ends at 0.
    """
    every = np.array([c for name in names for c in cases(rows, route, name)]).reshape(-1, 4)
    if not len(every):
        return "–"
    true, value, low, high = every.T
    z = 1.96 * (true - value) / np.where(true > value, high - value, value - low)
    share = float(np.mean((low <= true) & (true <= high)))
    return f"{100 * share:.1f} % of {len(every)}; {np.sqrt(np.mean(z**2)):.2f}"


def half(rows: list[dict], route: str, name: str) -> str:
    """Mean half width of the intervals of a number, and the RMS of what it is off, twice."""
    every = np.array(list(cases(rows, route, name))).reshape(-1, 4)
    if not len(every):
        return "–"
    true, value, low, high = every.T
    return f"{np.mean(high - low) / 2:.2g} ({2 * np.sqrt(np.mean((value - true) ** 2)):.2g})"


def table(head: list[str], body: list[list[str]]) -> list[str]:
    """Lines of a table in Markdown."""
    return ["", *("| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *body)), ""]


def page(rows: list[dict]) -> str:
    """The tables."""
    sound, faulty = ([r for r in rows if bool(r["fault"]) == f] for f in (False, True))
    out = [f"{len(rows)} machines, {len(faulty)} of them with one fault.", ""]
    out += ["Location errors inside their 95 % intervals; RMS of error over standard deviation:"]
    groups = (("all", rows), ("sound machines", sound), ("machines with a fault", faulty))
    body = [["machines", *(str(len(measured_by(rows, r))) for r in ROUTES)]]
    body += [[what, *(inside(group, r, LOCATIONS) for r in ROUTES)] for what, group in groups]
    missing = [
        sum(n not in row["routes"][r]["numbers"] for row in measured_by(rows, r) for n in LOCATIONS) for r in ROUTES
    ]
    out += table(["", *ROUTES], [*body, ["without an interval", *map(str, missing)]])
    out += ["Expanded uncertainty (k = 2), mean of all machines; in brackets twice the RMS error:"]
    unit = {n: "µrad" if n.partition(".")[2][1] in "ABC" else "µm" for n in LOCATIONS}
    body = [[f"{n.partition('.')[2]}, {unit[n]}", *(half(rows, r, n) for r in ROUTES)] for n in LOCATIONS]
    out += table(["", *ROUTES], body)
    out += ["The same points by circles, as the cycles of controls compute them. Mean error, and its scatter:"]
    out += table(
        ["", "circles", "mjsim, probe", "mjsim, bar and probe"], [_beside(rows, n, unit[n]) for n in LOCATIONS]
    )
    out += ["Other errors inside their 95 % intervals; RMS of error over standard deviation:"]
    body = [[n, *(inside(rows, r, (n,)) for r in ROUTES)] for n in OTHERS]
    # a fault of one scale that is no finding moves all three, so that these machines stand by themselves
    scaled = [(r["fault"] or {"id": ""})["id"].startswith("scale_error") for r in rows]
    for what, wanted in (("on machines without a fault of it", False), ("on machines with one", True)):
        group = [r for r, is_scaled in zip(rows, scaled, strict=True) if is_scaled == wanted]
        body.append([f"scale_error {what}", *(inside(group, r, ("scale_error",)) for r in ROUTES)])
    out += table(["", *ROUTES], body)
    out += ["Faults that were named, or named as one of several that the data cannot tell apart (+):"]
    body = []
    for kind in (k for k in routes.FAULTS if any(r["fault"]["id"].startswith(k) for r in faulty)):
        mine = [r for r in faulty if r["fault"]["id"].startswith(kind)]
        body.append([kind, *(_named(mine, r) for r in ROUTES)])
    body.append(["all", *(_named(faulty, r) for r in ROUTES)])
    wrong = [sum(_wrong(row, r) for row in measured_by(rows, r)) for r in ROUTES]
    out += table(["", *ROUTES], [*body, ["findings of what is within its limit", *map(str, wrong)]])
    out += ["Verdicts, and processor seconds of one diagnosis (median):"]
    body = []
    for what, group in groups[1:]:
        counts = [Counter(row["routes"][r]["verdict"] for row in measured_by(group, r)) for r in ROUTES]
        body.append([what, *(", ".join(f"{v} {n}".replace("_", " ") for v, n in c.most_common()) for c in counts)])
    pace = [[s for row in measured_by(rows, r) if (s := row["routes"][r]["seconds"])] for r in ROUTES]
    out += table(["", *ROUTES], [*body, ["seconds", *(f"{np.median(p):.0f}" if p else "–" for p in pace)]])
    return "\n".join(out).strip() + "\n"


def _beside(rows: list[dict], name: str, unit: str) -> list[str]:
    """Mean and scatter of the errors by circles and by two routes."""
    off = [np.array([r["circles"][name] - r["truth"][name] for r in rows if name in r.get("circles", {})])]
    off += [np.array([value - true for true, value, _, _ in cases(rows, route, name)]) for route in ROUTES[1:3]]
    cells = [f"{o.mean():+.1f}, {o.std():.1f}" if len(o) else "–" for o in off]
    return [f"{name.partition('.')[2]}, {unit}", *cells]


def _named(rows: list[dict], route: str) -> str:
    mine = [(row["fault"]["id"], row["routes"][route]["found"]) for row in measured_by(rows, route)]
    alone = sum([fault] in found for fault, found in mine)
    several = sum(any(fault in f for f in found) for fault, found in mine) - alone
    return f"{alone}" + (f" + {several}" if several else "") + f" of {len(mine)}"


def _wrong(row: dict, route: str) -> int:
    """How many findings name nothing that is beyond the limit of its kind: a few errors of a machine of the class are,
    by chance, beside its fault.
    """
    beyond = _beyond(row["seed"])
    return sum(not set(f) & beyond for f in row["routes"][route]["found"])


@functools.cache
def _beyond(seed: int) -> set[str]:
    """Ids of what a machine has beyond its limit."""
    errors, causes, fault = routes.draw(seed, bool(seed % 2))
    out = {fault["id"]} if fault else set()
    for effect in sphere.tables(errors) + causes:
        limits = real_machines.TOLERANCE[effect["id"].partition(".")[0]]
        numbers = [(k.rpartition("_")[2], v) for k, v in effect.items() if k != "components" and k != "id"]
        turns = effect["id"][-1] in "AC"
        numbers += [("deg" if turns else "um", amplitude) for _, amplitude, _ in effect.get("components", ())]
        if any(unit in limits and abs(v) > limits[unit] for unit, v in numbers):
            out.add(effect["id"])
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for name in ("run", "page"):
        one = commands.add_parser(name)
        one.add_argument("out", type=Path)
        if name == "run":
            one.add_argument("--count", type=int, default=60)
            one.add_argument("--first", type=int, default=0)
            one.add_argument("--route", choices=ROUTES, action="append", help="only this one, or these (default: all)")
        else:
            one.add_argument("--page", type=Path)
    args = parser.parse_args()
    if args.command == "run":
        run(args.out, args.first, args.count, args.route or ROUTES)
        return
    text = page(list(rows_of(args.out).values()))
    print(text)
    if args.page:
        whole, n = TABLES.subn(lambda m: f"{m[1]}\n{text}\n{m[2]}", args.page.read_text())
        if n != 1:
            parser.error(f"{args.page} has no place for the tables")
        args.page.write_text(whole)


if __name__ == "__main__":
    main()
