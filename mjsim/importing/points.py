"""Points of a probed sphere from tables of any layout into a campaign: ``mjsim import --points``.

A table has the angles of the rotary axes and what was found: the deviation of the sphere's centre from where it was
looked for, or the centre itself. Where it has no linear positions, they are those at which an ideal machine's tool
centre point is in the sphere's centre.
"""

from __future__ import annotations

import gzip
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from mjsim.campaign.files import campaign_from
from mjsim.campaign.machine_file import read_machine
from mjsim.errors import InputError
from mjsim.importing.formats import read_any
from mjsim.importing.into_campaign import campaign_file, test_name
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.importing.units import QUANTITIES, bare, factor, unit_named, unit_of_column
from mjsim.instruments.sphere.files import FEWEST, columns_of, points_of, trace_text
from mjsim.instruments.sphere.measurement import Points, Probe, SphereTest
from mjsim.instruments.sphere.mistakes import sphere_mistakes
from mjsim.io.files import check_writable, write_all
from mjsim.io.inputs import shown
from mjsim.io.toml import parse, read_text
from mjsim.machine.chain import COORDINATES, Chain
from mjsim.units import DEG, MM, UM

#: Words of headers for what was found, before or behind the letter of a coordinate, lower case.
_FOUND = ("measured", "meas", "actual", "act", "ist", "centre", "center", "m")
_OFF = ("d", "delta", "δ", "dev", "deviation", "diff", "error", "err", "abw", "abweichung")
#: The same for what was commanded.
_NOMINAL = ("nominal", "nom", "soll", "command", "cmd")
_SAID = re.compile(r"([^=]+)=([^:]+)(?::(.+))?")


@dataclass(frozen=True)
class PointColumn:
    """One column of a file.

    Attributes:
        name: Letter of an axis, ``dx``, ``x_measured``, ``from_`` and a letter, ``spindle``, ``run`` or ``time``.
        place: Of the column, from 0.
        unit: As the file has it; empty where it has none.
    """

    name: str
    place: int
    unit: str


@dataclass(frozen=True)
class ImportedPoints:
    """One file as it was brought in, or as it would be.

    Attributes:
        source: The measurement file.
        target: The trace's file in the campaign.
        test: Its test.
        columns: Which column is what.
        points: What was kept.
        notes: What was found and concluded.
        questions: What looks wrong.
        new_test: Whether campaign.toml got the test.
    """

    source: Path
    target: Path
    test: SphereTest
    columns: tuple[PointColumn, ...]
    points: Points
    notes: tuple[str, ...]
    questions: tuple[str, ...]
    new_test: bool

    def to_json(self) -> dict:
        """Plain numbers, as ``mjsim import --json`` prints them."""
        p = self.points
        return {
            "source": str(self.source),
            "trace": str(self.target),
            "test": self.test.name,
            "new_test": self.new_test,
            "points": len(p.position),
            "columns": [{"column": c.place + 1, "is": c.name, "unit": c.unit} for c in self.columns],
            "largest_um": round(float(np.abs(p.deviation).max()) / UM, 4),
            "first_rows": trace_text(self.test, p).splitlines()[:6],
            "notes": list(self.notes),
            "questions": list(self.questions),
        }


def import_points(
    campaign: Path,
    source: Path,
    test: str | None = None,
    signals: tuple[str, ...] = (),
    sphere_mm: tuple[float, ...] | None = None,
    options: Options | None = None,
    force: bool = False,
    preview: bool = False,
) -> ImportedPoints:
    """Bring one file into a campaign.

    Args:
        campaign: Its folder.
        source: A table as text, or a file of a known format.
        test: Name of its test; by default that of the file.
        signals: Columns that the header does not name well: ``dx=5:um``, column by name or number from 1.
        sphere_mm: Nominal centre in the work frame, for a test that the campaign does not have yet.
        options: How the file is to be read.
        force: Replace a trace that is there.
        preview: Write nothing.

    Raises:
        InputError: The file cannot be read, a column is missing, or the test is not known.
    """
    options, file = options or Options(), campaign_file(campaign)
    data = parse(file)
    c = campaign_from(file, data, traces=False, empty=True)
    chain, name = read_machine(c.machine_file).chain, test or test_name(source)
    known = next((t for t in c.tests if t.name == name), None)
    if known is not None and not isinstance(known, SphereTest):
        raise InputError(f'{file}: [[test]] "{name}" is of the kind {known.kind!r}; allowed: one of the kind "sphere"')
    if known is not None and sphere_mm is not None:
        raise InputError(f'{file}: [[test]] "{name}" says where the sphere is; leave out --sphere')
    if known is None and sphere_mm is None:
        raise InputError(
            f'{source}: test "{name}" is not in {file}; say where the sphere is: --sphere X Y Z, mm in the work frame, '
            "or name a test of the campaign with --test"
        )
    text = read_text(file)
    made = known or SphereTest(name, tuple(v * MM for v in sphere_mm or ()), name, None, chain)  # type: ignore[arg-type]
    trace = made.trace or f"traces/{name}.csv"
    if made.trace is None:
        text = _with_test(text, name, trace, sphere_mm, known is None, "instrument" in data)
        added = campaign_from(file, tomlkit.parse(text).unwrap(), traces=False)
        made = next(t for t in added.tests if t.name == name)
    target = file.parent / trace
    table = read_any(source, options)
    columns, notes = _columns(table, made.chain, signals)
    points, more = _points(source, table, columns, made)
    if not preview:
        check_writable(target, force)
        out = trace_text(made, points).encode()
        write_all(
            {target: gzip.compress(out, mtime=0) if target.suffix == ".gz" else out, file: text.encode()}, force=True
        )
    found = sphere_mistakes([made], {name: points}, Probe())
    asked = tuple(m.sentence for m in found)
    return ImportedPoints(source, target, made, columns, points, (*table.notes, *notes, *more), asked, known is None)


def _names(chain: Chain) -> dict[str, tuple[str, str]]:
    """What a column may be: its quantity, and the unit where nothing says it."""
    out = {a: ("angle", "deg") if chain.is_rotary(a) else ("deviation", "mm") for a in chain.letters}
    for c in COORDINATES:
        out[f"d{c.lower()}"] = "deviation", "um"
        out[f"{c.lower()}_measured"] = "deviation", "mm"
    return (
        out
        | {f"from_{a}": ("", "") for a in chain.rotary}
        | {"spindle": ("angle", "deg"), "run": ("", ""), "time": ("time", "s")}
    )


def _guess(name: str, chain: Chain) -> str:
    """What a header's word means; empty where it means nothing."""
    for a in chain.rotary:  # the letter would be taken for a unit
        if name.strip().lower() == f"from_{a.lower()}":
            return f"from_{a}"
    word = bare(name).replace(" ", "_").strip("_")
    if word in ("spindle", "run", "time"):
        return word
    if word.upper() in chain.letters:
        return word.upper()
    for c in (c.lower() for c in COORDINATES):
        parts = word.replace(c, "_", 1).strip("_") if word.count(c) == 1 else ""
        if c in word and parts in _OFF:
            return f"d{c}"
        if c in word and parts in _FOUND:
            return f"{c}_measured"
    parts = word.split("_")
    if len(parts) == 2 and parts[0].upper() in chain.letters and parts[1] in _NOMINAL:
        return parts[0].upper()
    return ""


def _columns(table: Table, chain: Chain, signals: tuple[str, ...]) -> tuple[tuple[PointColumn, ...], list[str]]:
    """Which column is what: as the user says, otherwise as the words of the header say."""
    names, out = _names(chain), {}
    taken = set()
    for said in signals:
        match = _SAID.fullmatch(said)
        name = match[1].strip() if match else said
        if match is None or name not in names:
            raise InputError(
                f"--signal {shown(said)}; allowed: NAME=COLUMN or NAME=COLUMN:UNIT, NAME one of {', '.join(names)}"
            )
        place, quantity, unit = _place(table, match[2].strip()), names[name][0], match[3] or ""
        if unit and (not quantity or unit_named(unit, quantity) is None):
            allowed = ", ".join(QUANTITIES[quantity]) if quantity else "none: it is a number"
            raise InputError(f"--signal {shown(said)}: unit {unit!r}; allowed: {allowed}")
        if unit:
            unit = unit_named(unit, quantity) or ""
        elif quantity:
            unit = unit_of_column(table.names[place], table.units[place], quantity) or ""
        out[name] = PointColumn(name, place, unit or names[name][1])
        taken.add(place)
    notes, unused = [], []
    for place, header in enumerate(table.names):
        if place in taken:
            continue
        name = _guess(header, chain) if header else ""
        if not name or name in out:
            unused.append(place)
            continue
        quantity, usual = names[name]
        unit = unit_of_column(header, table.units[place], quantity) if quantity else ""
        if quantity and not unit:
            notes.append(f'column {place + 1} "{header}" has no unit: taken for {usual}')
        out[name] = PointColumn(name, place, unit or usual)
    missing = [a for a in chain.rotary if a not in out]
    for c in (c.lower() for c in COORDINATES):
        if f"d{c}" not in out and f"{c}_measured" not in out:
            missing.append(f"d{c} or {c}_measured")
    if missing:
        raise InputError(
            f"{table.path}: no column for {', '.join(missing)}; the file has {table.columns}; say which it is with "
            f"--signal {missing[0].split()[0]}=COLUMN:UNIT"
        )
    if unused:
        few = ", ".join(f'{p + 1} "{table.names[p]}"' if table.names[p] else str(p + 1) for p in unused[:8])
        notes.append(f"not taken: column{'s' if len(unused) > 1 else ''} {few}")
    return tuple(out.values()), notes


def _place(table: Table, text: str) -> int:
    """A column by name or number from 1."""
    if text in table.names:
        return table.names.index(text)
    if text.isdigit() and 1 <= int(text) <= len(table.names):
        return int(text) - 1
    raise InputError(f"{table.path}: no column {shown(text)}; allowed: {table.columns}, by name or number")


def _points(source: Path, table: Table, columns: tuple[PointColumn, ...], test: SphereTest) -> tuple[Points, list[str]]:
    """Points in the units of a campaign."""
    chain, notes = test.chain, []
    names = _names(chain)
    whole = np.isfinite(table.values[:, [c.place for c in columns]]).all(axis=1)
    if not whole.all():
        notes.append(f"{int((~whole).sum())} rows are left out: they have empty cells")
    values = table.values[whole]
    if len(values) < FEWEST:
        raise InputError(f"{source}: {len(values)} whole rows; allowed: at least {FEWEST}")
    si: dict[str, Any] = {
        c.name: values[:, c.place] * (factor(c.unit, names[c.name][0]) if names[c.name][0] else 1.0) for c in columns
    }
    angles = np.column_stack([si[a] for a in chain.rotary])
    centred = test.centred(angles)
    if lacking := [a for a in chain.linear if a not in si]:
        notes.append(f"no column for {', '.join(lacking)}: where the tool of an ideal machine is in the sphere")
    for i, a in enumerate(chain.linear):
        si.setdefault(a, centred[:, i])
    for i, c in enumerate(COORDINATES):
        low = c.lower()
        if f"d{low}" not in si:
            si[f"d{low}"] = si[f"{low}_measured"] - si[chain.linear[i]]
    need = columns_of(chain)
    order = [*chain.letters, *(f"d{c.lower()}" for c in COORDINATES)]
    out = {name: si[own] / size for own, (name, size) in zip(order, need.items(), strict=True)}
    out |= {n: si[n] for n in names if n.startswith("from_") and n in si}
    if "spindle" in si:
        out["spindle_deg"] = si["spindle"] / DEG
    for own, name in (("run", "run"), ("time", "time_s")):
        if own in si:
            out[name] = si[own]
    return points_of(source, list(out), np.column_stack(list(out.values())), test), notes


def _with_test(text: str, name: str, trace: str, sphere_mm, new: bool, has_instrument: bool) -> str:
    """campaign.toml with the test, or with its trace."""
    document = tomlkit.parse(text)
    if not new:
        table = next(t for t in document["test"] if t["name"] == name)  # type: ignore[union-attr]
        table["trace"] = trace
        return tomlkit.dumps(document)
    end = "" if text.endswith("\n") else "\n"
    instrument = "" if has_instrument else '\n[instrument]\nkind = "sphere"\n'
    place = ", ".join(f"{v:g}" for v in sphere_mm)
    test = f'name = "{name}"\nkind = "sphere"\ntrace = "{trace}"\nsphere_mm = [{place}]\n'
    return f"{text}{end}{instrument}\n[[test]]\n{test}"
