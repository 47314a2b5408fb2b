"""The bank: some hundreds of campaigns, sound and faulty, whose answers are known. Deterministic.

It has three worlds: ideal machines but for what hides, real machines on which everything is a little wrong, and wild
machines that do what no catalogue has. Half of each category is for tuning a diagnosis ("tune"), the other half for
publishing its figures ("publish"). The halves share no seed: everything of the published half is numbered from FRESH.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from . import chain_campaigns, odd_causes, real_machines, templates, wild
from .campaign import Case, write
from .chain_campaigns import ChainCase
from .chains import CHAINS
from .heldout import write_heldout
from .layouts import LAYOUTS, layout
from .machines import MACHINES, nominal
from .measurement import Bar

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
#: Number of the first campaign of the published half. A published half that has been looked into is no longer blind: a
#: new one begins at another number.
FRESH = 4000


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


def nulls(first: int) -> Iterator[Case]:
    """Sound machines inside their data sheet, some with knocks and gaps."""
    for i in range(first, first + NULLS):
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


def singles(first: int) -> Iterator[Case]:
    """One hidden effect of each id, twice: another size, layout and machine."""
    for j, (kind, subject) in enumerate(templates.SINGLES):
        for v in range(first, first + 2):
            number = 2 * j + v
            rng = np.random.default_rng([12, number])
            name, machine = _place(kind, subject, 3 * v + j + j // 5)
            target = min(_SIZES[(3 * j + 5 * v) % len(_SIZES)], templates.largest(kind, subject))
            hidden = templates.single(kind, subject, machine, rng)
            label = f"single-{kind}.{subject}-{v:02d}"
            category = "faint" if f"{kind}.{subject}" in templates.FAINT else "single"
            case = Case(label, machine, tuple(layout(name)), (hidden,), (target,), seed=20_000 + number)
            yield replace(case, category=category, half=_HALVES[(j + v) % 2])


def pairs(first_number: int) -> Iterator[Case]:
    """Two hidden effects: every third pair on the same axis, the others on different ones."""
    plain = [(k, s) for k, s in templates.SINGLES if templates.largest(k, s) > 1.0 and k != "axis_location"]
    for i in range(first_number, first_number + PAIRS):
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


def unlisted(first: int) -> Iterator[Case]:
    """One cause outside the catalogue."""
    for i in range(first, first + UNLISTED):
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


def odd(first: int) -> Iterator[Case]:
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
    for i in range(first, first + 2 * ODD):
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


def real(first: int = 0) -> Iterator[Case]:
    """Machines on which everything is a little wrong, with and without a stated tolerance, on drives of random data
    sheets.
    """
    for i in range(first, first + REAL_SOUND + REAL_FAULTY + REAL_UNLISTED):
        sort = "sound" if i - first < REAL_SOUND else "faulty" if i - first < REAL_SOUND + REAL_FAULTY else "unlisted"
        rng = np.random.default_rng([16, i])
        machine = f"R{i % 24}" if i % 3 else ("M1", "M2", "M3")[i // 3 % 3]
        name = _REAL_LAYOUTS[int(rng.integers(len(_REAL_LAYOUTS)))]
        small = tuple(real_machines.within(machine, rng))
        causes: list = []
        targets: list[float | None] = []
        if sort == "unlisted":
            which = next(
                w
                for w in rng.permutation(templates.UNLISTED)
                if _shows(templates.unlisted(int(w), machine, rng)[0], name)
            )
            causes.append(templates.unlisted(int(which), machine, rng)[1])
            targets.append(float(rng.choice((0.8, 1.2, 2.0))))
        elif sort == "faulty":
            for n in rng.permutation(len(_REAL_CAUSES))[: 1 + i % 3]:
                kind, subject = _REAL_CAUSES[int(n)]
                if kind in real_machines.TOLERANCE:
                    causes.append(real_machines.beyond(kind, subject, nominal(machine), rng, (2.0, 5.0)))
                    targets.append(None)
                else:
                    causes.append(templates.single(kind, subject, machine, rng))
                    targets.append(float(rng.choice((0.3, 0.6, 1.2))))
        yield Case(
            f"real-{sort}-{i:03d}",
            machine,
            tuple(layout(name)),
            tuple(causes),
            tuple(targets),
            outliers=int(rng.integers(1, 4)) if i % 8 == 7 else 0,
            gaps=int(rng.integers(0, 3)) if i % 8 == 7 else 0,
            noise_um=round(float(rng.uniform(0.09, 0.16)), 3),
            seed=60_000 + i,
            category=f"real-{sort}",
            half=_HALVES[i % 2],
            within=small,
            tolerance_stated=bool(i // 2 % 2),
        )


def _shows(family: str, layout_name: str) -> bool:
    """Whether a cause of one family shows in a layout."""
    return layout_name == "full" or layout_name in _WHERE[family]


#: Campaigns of both halves: sound machines with knocks by other plans, ideal and real ones, and wild machines.
KNOCKED, WILD = 80, {"sound": 48, "faulty": 80, "unlisted": 24, "beside": 40, "two": 16}


def knocked(first: int) -> Iterator[ChainCase]:
    """Sound machines with six knocks and two gaps, by plans of all sorts; every second one is a real machine."""
    for i in range(first, first + KNOCKED):
        rng = np.random.default_rng([17, i])
        drives = f"R{i % 24}" if i % 3 else ("M1", "M2", "M3")[i // 3 % 3]
        real_machine = bool(i // 2 % 2)
        yield ChainCase(
            f"{'real-' if real_machine else ''}knocked-{i:03d}",
            "paper",
            70_000 + i,
            real=real_machine,
            drives=drives,
            bar=Bar(outliers=6, gaps=2),
            plan=tuple(wild.draw_plan("XYZAC", "", rng)),
            category=f"{'real-' if real_machine else ''}knocked",
            half=_HALVES[i % 2],
        )


def wild_machines(first: int) -> Iterator[ChainCase]:
    """Machines that do what no catalogue has, some of other chains: sound, with one or two small faults, with a cause
    outside the catalogue alone, beside a fault, or with two of them.
    """
    sorts = [sort for sort, count in WILD.items() for _ in range(count)]
    for number, sort in enumerate(sorts):
        i = first + number
        rng = np.random.default_rng([18, i])
        family = list(CHAINS)[1 + i // 8 % 4] if i % 8 > 5 else "paper"
        drives = ("M1", "M2")[i // 2 % 2] if i % 3 == 0 else f"R{i}"
        bare = ChainCase("", family, 80_000 + i, real=True, drives=drives)
        model, machine = bare.model(), bare.machine
        faults = wild.list_faults(model, CHAINS[family][3].split())
        count = {"sound": 0, "faulty": 1 + number // 2 % 2, "unlisted": 0, "beside": 1, "two": 0}[sort]
        hidden: list = [wild.draw_fault(*faults[int(n)], model, rng) for n in rng.permutation(len(faults))[:count]]
        makers = odd_causes.draw_makers(machine.axes, rng)
        strange = {"unlisted": 1, "beside": 1, "two": 2}.get(sort, 0)
        hidden += [makers[int(n)]() for n in rng.permutation(len(makers))[:strange]]
        level = float(rng.uniform(0.3, 1.0))
        yield replace(
            bare,
            name=f"wild-{sort}-{i:03d}",
            hidden=tuple(hidden),
            target_um=float(rng.uniform(0.6, 2.0)),
            bar=wild.draw_bar(rng),
            noise_um=round(float(rng.uniform(0.09, 0.16)), 3),
            plan=tuple(wild.draw_plan(machine.axes, "".join(machine.sides[1]), rng)) if i % 4 else bare.usual(),
            stated=bool(rng.uniform() < 0.5),
            nature=tuple(wild.draw_nature(model, level, rng)),
            spread=wild.draw_data_sheet(rng),
            level=wild.draw_factors(real_machines.TOLERANCE, rng),
            category=f"wild-{sort}",
            half=_HALVES[i % 2],
        )


def cases() -> list[Case | ChainCase]:
    """Every case of the bank: the tuning half of all that is numbered from 0, the published half of what is numbered
    from FRESH.
    """
    makers = (nulls, singles, pairs, unlisted, odd, real, knocked, wild_machines)
    both = ((maker(first), half) for first, half in ((0, "tune"), (FRESH, "publish")) for maker in makers)
    return [case for made, half in both for case in made if case.half == half]


def world(category: str) -> str:
    """The world of a category: ideal, real or wild."""
    return category.split("-")[0] if category.startswith(("real-", "wild-")) else "ideal"


def write_case(case: Case | ChainCase, folder: Path | str, heldout: bool = False) -> dict:
    """Writes the folder of one case, with ``heldout`` the tests outside its campaign as well; its answer."""
    if isinstance(case, ChainCase):
        answer = chain_campaigns.write(case, folder)
        if heldout:
            chain_campaigns.write_heldout(case, folder)
        return answer
    answer = write(case, folder)
    if heldout:
        write_heldout(case, folder)
    return answer
