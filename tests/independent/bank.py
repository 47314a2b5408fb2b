"""The bank: some hundreds of campaigns, sound and faulty, whose answers are known. Deterministic.

Half of each category is for tuning a diagnosis ("tune"), the other half for publishing its figures ("publish").
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import tomlkit

from . import real_machines, templates
from .campaign import Case, write
from .heldout import write_heldout
from .layouts import LAYOUTS, layout
from .machines import MACHINES

NULLS, PAIRS, UNLISTED, ODD = 320, 48, 54, 24
_UNLISTED_SIZES = (0.5, 1.2, 0.3, 2.5, 0.8)
#: Layouts on which an axis' effects show, each with the machines that it is used with.
_WHERE = {
    "X": ("standard", "feeds", "circles", "mirror", "cones-far"),
    "Y": ("standard", "feeds", "circles", "mirror", "cones-far"),
    "Z": ("circles", "mirror", "cradle"),
    "A": ("standard", "cradle", "rotaries", "cones-far"),
    "C": ("rotaries", "table", "feeds", "cones-far"),
    "lift": ("table",),
}
_WITH = {
    "standard": ("M1", "M3"),
    "feeds": ("M2", "M4", "M5"),
    "circles": ("M1", "M3", "M4"),
    "mirror": ("M5", "M2"),
    "cones-far": ("M3", "M1"),
    "cradle": ("M4", "M2"),
    "rotaries": ("M5", "M3"),
    "table": ("M1", "M2"),
    "sparse-mixed": ("M1", "M2"),
    "sparse-cones": ("M3", "M4"),
    "sparse-circles": ("M5",),
}
#: Signature sizes to plant, µm RMS over the campaign: barely visible to obvious.
_SIZES = (0.1, 0.5, 0.2, 1.2, 0.35, 3.0, 0.15, 0.8)
_HALVES = ("tune", "publish")


#: Where effects show that most layouts of their axis hide.
_SPECIAL = {
    "thermal_drift.Z": ("circles", "table"),
    "torque_ripple.Z": ("circles", "cradle"),
    "straightness.EZX": ("circles", "table"),
    "straightness.EZY": ("circles", "cradle"),
    "drive_compliance.A": ("cones-far", "rotaries"),
    "drive_compliance.Z": ("circles",),
    "backlash.C": ("rotaries", "table", "feeds"),
    "axis_location.EX0C": ("table", "rotaries"),
    "axis_location.EY0C": ("table", "standard"),
    "axis_location.EA0C": ("circles", "table", "cradle"),
    "axis_location.EB0C": ("table", "mirror"),
    "axis_location.EY0A": ("cradle", "rotaries"),
    "axis_location.EZ0A": ("cradle", "rotaries"),
    "axis_location.EB0A": ("cradle", "mirror"),
    "axis_location.EC0A": ("standard", "cradle"),
}


def _axis(kind: str, subject: str) -> str:
    """The axis whose layouts show an effect."""
    if kind == "straightness":
        return "Z" if "Z" in subject else "X"
    if kind == "squareness":
        return "X" if subject == "XY" else "Z"
    return subject[-1]


def _place(kind: str, subject: str, number: int) -> tuple[str, str]:
    """A layout and a machine for an effect; other numbers give other ones."""
    names = _SPECIAL.get(f"{kind}.{subject}") or _WHERE[_axis(kind, subject)]
    name = names[number % len(names)]
    return name, _WITH[name][(number // len(names)) % len(_WITH[name])]


def nulls() -> Iterator[Case]:
    """Sound machines inside their data sheet, some with knocks and gaps."""
    for i in range(NULLS):
        rng = np.random.default_rng([11, i])
        machine, name = MACHINES[i % len(MACHINES)], LAYOUTS[(i // 2) % len(LAYOUTS)]
        odd = i % 8 == 7
        yield Case(
            f"null-{i:03d}",
            machine,
            tuple(layout(name)),
            outliers=int(rng.integers(1, 5)) if odd else 0,
            gaps=int(rng.integers(0, 3)) if odd else 0,
            noise_um=0.12 if i % 4 else round(float(rng.uniform(0.09, 0.18)), 3),
            seed=10_000 + i,
            category="null",
            half=_HALVES[(i // 2 + i // 40) % 2],
        )


def singles() -> Iterator[Case]:
    """One hidden effect of each id, twice: another size, layout and machine."""
    for j, (kind, subject) in enumerate(templates.SINGLES):
        for v in range(2):
            number = 2 * j + v
            rng = np.random.default_rng([12, number])
            name, machine = _place(kind, subject, 3 * v + j + j // 5)
            target = min(_SIZES[(3 * j + 5 * v) % len(_SIZES)], templates.largest(kind, subject))
            hidden = templates.single(kind, subject, machine, rng)
            label = f"single-{kind}.{subject}-{v:02d}"
            category = "faint" if f"{kind}.{subject}" in templates.FAINT else "single"
            case = Case(label, machine, tuple(layout(name)), (hidden,), (target,), seed=20_000 + number)
            yield replace(case, category=category, half=_HALVES[(j + v) % 2])


def pairs() -> Iterator[Case]:
    """Two hidden effects: every third pair on the same axis, the others on different ones."""
    plain = [(k, s) for k, s in templates.SINGLES if templates.largest(k, s) > 1.0 and k != "axis_location"]
    for i in range(PAIRS):
        rng = np.random.default_rng([13, i])
        first = plain[(7 * i + i // 3) % len(plain)]
        same = i % 3 == 0
        fits = [p for p in plain if p[0] != first[0] and (_axis(*p) == _axis(*first)) == same and _shared(first, p)]
        second = fits[int(rng.integers(len(fits)))]
        name = sorted(_shared(first, second))[i % len(_shared(first, second))]
        machine = _WITH[name][i % len(_WITH[name])]
        hidden = tuple(templates.single(k, s, machine, rng) for k, s in (first, second))
        sizes = tuple(float(x) for x in rng.choice((0.3, 0.5, 0.8, 1.2), 2))
        label = f"pair-{first[0]}.{first[1]}+{second[0]}.{second[1]}-{i:02d}"
        yield Case(
            label, machine, tuple(layout(name)), hidden, sizes, seed=30_000 + i, category="pair", half=_HALVES[i % 2]
        )


def _shared(first: tuple[str, str], second: tuple[str, str]) -> set[str]:
    """Layouts that show both effects."""
    one, two = ({*(_SPECIAL.get(f"{k}.{s}") or _WHERE[_axis(k, s)])} for k, s in (first, second))
    return one & two


def unlisted() -> Iterator[Case]:
    """One cause outside the catalogue."""
    for i in range(UNLISTED):
        rng = np.random.default_rng([14, i])
        which, turn = i % templates.UNLISTED, i // templates.UNLISTED
        family = templates.unlisted(which, "M1", np.random.default_rng(0))[0]
        name = _WHERE[family][(i + turn) % len(_WHERE[family])]
        machine = _WITH[name][(i // 2) % len(_WITH[name])]
        cause = templates.unlisted(which, machine, rng)[1]
        size = float(rng.choice(_UNLISTED_SIZES))
        label = f"unlisted-{cause.name}-{i:02d}"
        half = _HALVES[(i + turn) % 2]
        yield Case(
            label, machine, tuple(layout(name)), (cause,), (size,), seed=40_000 + i, category="unlisted", half=half
        )


def odd() -> Iterator[Case]:
    """Single effects on campaigns with knocks and gaps, and on sparse ones of two or three tests."""
    easy = [
        ("backlash", "A"),
        ("pitch_error", "A"),
        ("servo_gain", "X"),
        ("squareness", "XY"),
        ("pitch_error", "C"),
        ("worm_wear", "A"),
    ]
    easy += [
        ("backlash", "X"),
        ("straightness", "EXY"),
        ("torque_ripple", "A"),
        ("scale_error", "Y"),
        ("servo_delay", "Y"),
        ("backlash", "Y"),
    ]
    sparse = {"A": ("sparse-cones", "sparse-mixed"), "C": ("sparse-mixed",)}
    for i in range(2 * ODD):
        rng = np.random.default_rng([15, i])
        category = ("outliers", "sparse")[i % 2]
        kind, subject = easy[(i // 2) % len(easy)]
        names = (
            _WHERE[_axis(kind, subject)]
            if i % 2 == 0
            else sparse.get(_axis(kind, subject), ("sparse-mixed", "sparse-circles", "sparse-cones"))
        )
        name = names[(i // 2 + i // 24) % len(names)]
        machine = _WITH[name][(i // 2) % len(_WITH[name])]
        hidden = templates.single(kind, subject, machine, rng)
        label = f"{category}-{kind}.{subject}-{i // 2:02d}"
        knocks, missing = (int(rng.integers(2, 7)), int(rng.integers(0, 4))) if category == "outliers" else (0, 0)
        case = Case(
            label, machine, tuple(layout(name)), (hidden,), (float(rng.choice((0.4, 0.8, 1.6))),), seed=50_000 + i
        )
        yield replace(case, outliers=knocks, gaps=missing, category=category, half=_HALVES[(i // 2) % 2])


#: Real machines: sound ones, faulty ones with one to three causes, and ones with a cause outside the catalogue.
REAL_SOUND, REAL_FAULTY, REAL_UNLISTED = 320, 240, 60
_REAL_CAUSES = tuple(
    (kind, subject)
    for kind, subject in templates.SINGLES
    if kind in real_machines.TOLERANCE
    or kind in ("servo_gain", "servo_delay", "worm_wear", "thermal_drift", "torque_ripple")
)
_REAL_LAYOUTS = ("standard", "rotaries", "feeds", "table", "full")


def real() -> Iterator[Case]:
    """Machines on which everything is a little wrong, with and without a stated tolerance, on drives of random data
    sheets.
    """
    for i in range(REAL_SOUND + REAL_FAULTY + REAL_UNLISTED):
        rng = np.random.default_rng([16, i])
        machine = f"R{i % 24}" if i % 3 else ("M1", "M2", "M3")[i // 3 % 3]
        name = _REAL_LAYOUTS[int(rng.integers(len(_REAL_LAYOUTS)))]
        small = tuple(real_machines.within(machine, rng))
        causes: list = []
        targets: list[float | None] = []
        if i >= REAL_SOUND + REAL_FAULTY:
            which = next(
                w
                for w in rng.permutation(templates.UNLISTED)
                if _shows(templates.unlisted(int(w), machine, rng)[0], name)
            )
            causes.append(templates.unlisted(int(which), machine, rng)[1])
            targets.append(float(rng.choice((0.8, 1.2, 2.0))))
        elif i >= REAL_SOUND:
            for n in rng.permutation(len(_REAL_CAUSES))[: 1 + i % 3]:
                kind, subject = _REAL_CAUSES[int(n)]
                if kind in real_machines.TOLERANCE:
                    causes.append(real_machines.beyond(kind, subject, machine, rng))
                    targets.append(None)
                else:
                    causes.append(templates.single(kind, subject, machine, rng))
                    targets.append(float(rng.choice((0.3, 0.6, 1.2))))
        yield Case(
            f"real-{'sound' if not causes else 'unlisted' if i >= REAL_SOUND + REAL_FAULTY else 'faulty'}-{i:03d}",
            machine,
            tuple(layout(name)),
            tuple(causes),
            tuple(targets),
            outliers=int(rng.integers(1, 4)) if i % 8 == 7 else 0,
            gaps=int(rng.integers(0, 3)) if i % 8 == 7 else 0,
            noise_um=round(float(rng.uniform(0.09, 0.16)), 3),
            seed=60_000 + i,
            category="real-sound"
            if not causes
            else "real-unlisted"
            if i >= REAL_SOUND + REAL_FAULTY
            else "real-faulty",
            half=_HALVES[i % 2],
            within=small,
            tolerance_stated=bool(i // 2 % 2),
        )


def _shows(family: str, layout_name: str) -> bool:
    """Whether a cause of one family shows in a layout."""
    return layout_name == "full" or layout_name in _WHERE[family]


def cases() -> list[Case]:
    """Every case of the bank."""
    return list(itertools.chain(nulls(), singles(), pairs(), unlisted(), odd(), real()))


def write_bank(folder: Path | str, wanted: Iterable[Case], heldout: bool = False) -> dict[str, dict]:
    """Writes campaigns and answers.toml for a folder of them; what is there already is kept. Cases of one layout are
    taken together.

    ``heldout`` adds tests that were not measured to the campaigns with effects of the catalogue.
    """
    folder, answers = Path(folder), {}
    for case in sorted(wanted, key=lambda c: (bool(c.hidden), [t["name"] for t in c.tests], c.machine)):
        done = folder / case.name / "answer.json"
        if not done.exists():
            found = {**write(case, folder / case.name), "category": case.category, "half": case.half}
            if heldout and case.catalogue():
                write_heldout(case, folder / case.name)
            done.write_text(json.dumps(found, indent=1))
        answers[case.name] = json.loads(done.read_text())
    (folder / "answers.toml").write_text(tomlkit.dumps(answers))
    return answers
