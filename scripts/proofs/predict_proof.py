"""How near predicted parts are to the truth, and whether their intervals and verdicts hold.

Machines of the independent generator are measured in one campaign each and diagnosed. The generator then runs the
set-points of five parts on the true machine, and finds the nearest points of the path by its own search. Results are
kept per machine: a second run continues where the first one stopped.

    predict_proof.py FOLDER --count 50             # every second test with the spindle turned by 180°
    predict_proof.py FOLDER --count 50 --no-turn   # the same tests, the spindle always held alike
    predict_proof.py FOLDER --volumetric --away    # slides turn, tables run axially; parts 150 mm off the tests
    predict_proof.py FOLDER --volumetric --away --unstated   # the same, the machine file has no limits for that
"""

from __future__ import annotations

import argparse
import json
import sys
import time as clock
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "scripts" / "benchmarks")]

from independent import bank, drives, transmission  # noqa: E402
from independent.campaign import Case, _true, write_files  # noqa: E402
from independent.kinematics import spindle_ball, table_ball  # noqa: E402
from independent.layouts import layout, turned  # noqa: E402
from independent.real_machines import volumetric_errors  # noqa: E402

from mjsim.campaign.files import read_campaign  # noqa: E402
from mjsim.campaign.machine_file import read_machine  # noqa: E402
from mjsim.commands.diagnose import diagnose  # noqa: E402
from mjsim.commands.saved import keep, read_saved  # noqa: E402
from mjsim.instruments.ball_bar.commanded import Commanded  # noqa: E402
from mjsim.machine.chain import FIVE_AXIS  # noqa: E402
from mjsim.prediction.parts import part  # noqa: E402
from mjsim.prediction.predict import WARM, paced, predict  # noqa: E402

#: Zero point of the parts; zero points that are 150 mm and more off every place of a table ball.
ZERO = np.array([0.03, -0.02, 0.12])
AWAY = np.array([[0.2, -0.02, 0.12], [0.0, 0.2, 0.12], [-0.15, 0.0, 0.16], [0.03, -0.15, 0.12], [0.0, 0.0, 0.305]])
#: Allowed deviations as multiples of the true one, so that near and clear cases are both there.
SHARES = (0.5, 0.8, 0.95, 1.05, 1.25, 2.0)


def random_program(seed: int, zero: np.ndarray) -> Commanded:
    """A smooth five-axis path with tool centre control: a few sines in the tip and in both rotary axes."""
    rng = np.random.default_rng([41, seed])
    u = np.linspace(0.0, 1.0, 1501)
    points = np.zeros((len(u), 5))
    for i, size in enumerate((0.05, 0.05, 0.02)):
        for k in (1, 2, 3):
            points[:, i] += size / k * rng.normal() * np.sin(2 * np.pi * k * u + rng.uniform(0, 6.28)) / 1.5
    points[:, :3] += zero
    points[:, 3] = 0.35 + 0.12 * np.sin(2 * np.pi * u + rng.uniform(0, 6.28)) + 0.06 * np.sin(6 * np.pi * u)
    points[:, 4] = rng.uniform(-2, 2) + 0.8 * np.sin(2 * np.pi * u + rng.uniform(0, 6.28)) + 0.3 * np.sin(4 * np.pi * u)
    length = np.linalg.norm(np.diff(points[:, :3], axis=0), axis=1)
    return Commanded(np.maximum(length, 2e-6) / (1.0 / 60.0), points, True, FIVE_AXIS)


def programs(zero: np.ndarray) -> dict[str, Commanded]:
    built = {n: part(n, FIVE_AXIS, zero) for n in ("s-shape", "cone")}
    return built | {f"random-{k}": random_program(k, zero) for k in range(3)}


def true_tips(load: np.ndarray, drive: dict, effects: dict, zero: np.ndarray) -> np.ndarray:
    """Tip in the part's coordinates, (n, 3): the part is set up with the rotary axes at 0."""
    rest = np.zeros((1, 5))
    rest[0, :3] = zero
    rest = transmission.load_side(rest, np.array([WARM]), drive, effects)

    def frame(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        origin = table_ball(q, np.zeros(3), effects)
        return origin, np.stack([table_ball(q, e, effects) - origin for e in np.eye(3)], axis=2)

    corner, turn = (x[0] for x in frame(rest))
    origin, axes = frame(load)
    on_table = np.linalg.solve(axes, (spindle_ball(load, effects) - origin)[:, :, None])[:, :, 0]
    return on_table @ turn.T + corner - spindle_ball(rest, effects)[0] + zero


def nearest(path: np.ndarray, points: np.ndarray, reach: int = 120) -> np.ndarray:
    """Distance of each point (n, 3) from the stretches of the path within ``reach`` samples of its own, (n,) m."""
    out = np.empty(len(points))
    for i, p in enumerate(points):
        a = path[max(0, i - reach) : i + reach]
        s, off = np.diff(a, axis=0), p - a[:-1]
        square = np.einsum("ni,ni->n", s, s)
        keep = square > 0
        s, off, square = s[keep], off[keep], square[keep]
        share = np.einsum("ni,ni->n", off, s) / square
        share[1:-1] = np.clip(share[1:-1], 0.0, 1.0)
        share[0], share[-1] = min(share[0], 1.0), max(share[-1], 0.0)
        rest = off - share[:, None] * s
        out[i] = np.sqrt(np.einsum("ni,ni->n", rest, rest).min())
    return out


def cases(turn: bool, full: bool = False, volumetric: bool = False, stated: bool = True) -> list[Case]:
    """Machines on which everything is a little wrong, every second one with causes that matter as well.

    Args:
        turn: Every second test of a set-up with the spindle turned.
        full: The tests of a full check, in place of the machine's own campaign.
        volumetric: Machines whose slides turn and whose rotary axes run axially as well.
        stated: Whether their machine files have limits for that.
    """
    kinds = [[c for c in bank.real() if c.category == f"real-{k}"] for k in ("sound", "faulty")]
    mixed = [c for pair in zip(*kinds, strict=False) for c in pair]
    tests = [layout("full") if full else list(c.tests) for c in mixed]
    out = [replace(c, tests=tuple(turned(t) if turn else t), tolerance_stated=True)
           for c, t in zip(mixed, tests, strict=True)]  # fmt: skip
    if not volumetric:
        return out
    more = [volumetric_errors("XYZAC", np.random.default_rng([47, c.seed])) for c in out]
    return [replace(c, within=(*c.within, *e), volumetric_stated=stated) for c, e in zip(out, more, strict=True)]


def compare(case: Case, folder: Path, zero: np.ndarray = ZERO) -> list[dict]:
    """One row per part: how far the prediction is from the truth. The parts have their ``zero`` (3,) there, m."""
    case = case.resolved()
    if not folder.exists():
        write_files(case, folder)
    c = read_campaign(folder)
    m = read_machine(c.machine_file)
    saved = read_saved(c, m) or keep(diagnose(c, m, threads=1), m)
    drive, effects = _true(case)
    rows = []
    for name, motion in programs(zero).items():
        began = clock.time()
        result = predict(motion, m, name, saved, zero=tuple(zero))
        took = clock.time() - began
        time, at = paced(motion, drives.GRID)
        given = type(
            "Given", (), {"commands": staticmethod(lambda t, m=motion, x=time, y=at: m.at(np.interp(t, x, y)))}
        )
        motor, _ = drives.run(drive, effects, given, time)
        load = transmission.load_side(motor, WARM + time, drive, effects)
        kept = np.searchsorted(time, result.time - 0.5 * drives.GRID)
        true = nearest(result.path, true_tips(load[kept], drive, effects, zero))
        index = np.clip(np.searchsorted(motion.knots, at[kept], side="right") - 1, 0, len(motion.seconds) - 1)
        first = np.flatnonzero(np.diff(index, prepend=-1))
        block = np.maximum.reduceat(true, first)
        said = np.array([[b.normal, b.low, b.high] for b in result.blocks])
        inside = (block >= said[:, 1]) & (block <= said[:, 2])
        verdicts = []
        for share in SHARES:
            allowed = share * true.max()
            wrong = (result.largest[2] <= allowed < true.max()) or (result.largest[1] > allowed >= true.max())
            decided = result.largest[2] <= allowed or result.largest[1] > allowed
            verdicts.append([bool(wrong), bool(decided)])
        size = np.linalg.norm(result.normal, axis=1)
        rows.append(
            {
                "machine": case.name,
                "program": name,
                "mean_error_um": float(np.abs(size - true).mean() * 1e6),
                "true_mean_um": float(true.mean() * 1e6),
                "blocks": len(block),
                "inside": int(inside.sum()),
                "verdicts": verdicts,
                "seconds": took,
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=50, help="machines")
    parser.add_argument("--no-turn", action="store_true", help="hold the spindle alike in all tests")
    parser.add_argument("--full", action="store_true", help="measure the 13 tests of a full check on every machine")
    parser.add_argument("--volumetric", action="store_true", help="slides turn, rotary axes run axially")
    parser.add_argument("--unstated", action="store_true", help="no limits for that in the machine files")
    parser.add_argument("--away", action="store_true", help="parts 150 mm off the tested places")
    a = parser.parse_args()
    chosen = cases(not a.no_turn, a.full, a.volumetric, not a.unstated)[: a.count]
    for number, case in enumerate(chosen):
        out = a.folder / "predictions" / f"{case.name}.json"
        if out.exists():
            continue
        out.parent.mkdir(parents=True, exist_ok=True)
        zero = AWAY[number % len(AWAY)] if a.away else ZERO
        rows = compare(case, a.folder / "campaigns" / case.name, zero)
        out.write_text(json.dumps(rows))
        print(f"{case.name}: {np.mean([r['mean_error_um'] for r in rows]):.3f} µm", flush=True)
    rows = [r for f in sorted((a.folder / "predictions").glob("*.json")) for r in json.loads(f.read_text())]
    inside, blocks = sum(r["inside"] for r in rows), sum(r["blocks"] for r in rows)
    verdicts = np.array([v for r in rows for v in r["verdicts"]])
    print(
        f"{len({r['machine'] for r in rows})} machines, {len(rows)} parts: mean of |predicted - true| "
        f"{np.mean([r['mean_error_um'] for r in rows]):.3f} µm "
        f"(worst part {max(r['mean_error_um'] for r in rows):.3f}), "
        f"true mean {np.mean([r['true_mean_um'] for r in rows]):.2f} µm"
    )
    print(f"95 % intervals hold in {100 * inside / blocks:.1f} % of {blocks} blocks")
    print(
        f"verdicts: {int(verdicts[:, 0].sum())} of {len(verdicts)} wrong ({100 * verdicts[:, 0].mean():.2f} %), "
        f"{100 * verdicts[:, 1].mean():.0f} % decided; longest prediction {max(r['seconds'] for r in rows):.1f} s"
    )
    for name in dict.fromkeys(r["program"] for r in rows):
        mine = [r for r in rows if r["program"] == name]
        share = sum(r["inside"] for r in mine) / sum(r["blocks"] for r in mine)
        print(f"  {name}: {np.mean([r['mean_error_um'] for r in mine]):.3f} µm, intervals hold in {100 * share:.1f} %")


if __name__ == "__main__":
    main()
