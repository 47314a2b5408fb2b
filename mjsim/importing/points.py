"""What was measured at rest, from tables of any layout into a campaign: ``mjsim import --points``.

The instrument of the test says what a column may be, and makes its recording of them.
"""

from __future__ import annotations

import gzip
import re
from dataclasses import dataclass, replace
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
from mjsim.instruments.base import INSTRUMENTS, Instrument
from mjsim.instruments.sphere.measurement import LOGGED, Points, SphereTest, centres_of_log
from mjsim.io.files import check_writable, write_all
from mjsim.io.inputs import shown
from mjsim.io.toml import parse, read_text
from mjsim.units import MM

#: Fewest rows of a table.
_FEWEST = 3
_SAID = re.compile(r"([^=]+)=([^:]+)(?::(.+))?")


@dataclass(frozen=True)
class PointColumn:
    """One column of a file.

    Attributes:
        name: What it is, one of those that the instrument knows.
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
        recording: What was kept.
        notes: What was found and concluded.
        questions: What looks wrong.
        new_test: Whether campaign.toml got the test.
    """

    source: Path
    target: Path
    test: Any
    columns: tuple[PointColumn, ...]
    recording: Any
    notes: tuple[str, ...]
    questions: tuple[str, ...]
    new_test: bool

    def to_json(self) -> dict:
        """Plain numbers, as ``mjsim import --json`` prints them."""
        instrument = INSTRUMENTS[self.test.instrument]
        value, channel = instrument.observe(self.test, self.recording).value, instrument.channels(self.test)[0]
        return {
            "source": str(self.source),
            "trace": str(self.target),
            "test": getattr(self.test, "recording", self.test.name),
            "new_test": self.new_test,
            "points": len(value),
            "columns": [{"column": c.place + 1, "is": c.name, "unit": c.unit} for c in self.columns],
            f"largest_{channel.suffix}": round(float(np.abs(value).max()) / channel.size, 4),
            "first_rows": instrument.trace_text(self.test, self.recording).splitlines()[:6],
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
    known = next((t for t in c.tests if name in (t.name, getattr(t, "recording", t.name))), None)
    if known is not None and not INSTRUMENTS[known.instrument].file_columns(known):
        able = (i for i in INSTRUMENTS.values() if type(i).file_columns is not Instrument.file_columns)
        kinds = ", ".join(k for i in able for k in i.kinds())
        raise InputError(f'{file}: [[test]] "{name}" is of the kind {known.kind!r}; allowed with --points: {kinds}')
    if known is not None and sphere_mm is not None:
        raise InputError(f'{file}: [[test]] "{name}" says where the sphere is; leave out --sphere')
    if known is None and sphere_mm is None:
        raise InputError(
            f'{source}: test "{name}" is not in {file}; name one of the campaign with --test, or, of a new sphere, say '
            "where the sphere is: --sphere X Y Z, mm in the work frame"
        )
    text = read_text(file)
    made = known or SphereTest(name, tuple(v * MM for v in sphere_mm or ()), name, None, chain)  # type: ignore[arg-type]
    trace = made.trace or f"traces/{name}.csv"
    if made.trace is None:
        text = _with_test(text, name, trace, sphere_mm, known is None, "instrument" in data)
        c = campaign_from(file, tomlkit.parse(text).unwrap(), traces=False)
        made = next(t for t in c.tests if name in (t.name, getattr(t, "recording", t.name)))
    instrument = INSTRUMENTS[made.instrument]
    target = file.parent / trace
    table = read_any(source, options)
    if isinstance(made, SphereTest) and made.angles and is_probe_log(table):
        columns, notes = (), [f"{len(table.values)} touches of a probing program, as LinuxCNC writes them"]
        recording, more = points_of_log(made, table.values), []
    else:
        columns, notes = _columns(table, made, signals)
        recording, more = _recording(source, table, columns, made)
    if not preview:
        check_writable(target, force)
        out = instrument.trace_text(made, recording).encode()
        write_all(
            {target: gzip.compress(out, mtime=0) if target.suffix == ".gz" else out, file: text.encode()}, force=True
        )
    asked = tuple(
        m.sentence for m in instrument.mistakes([made], {made.name: recording}, c.instruments[made.instrument])
    )
    return ImportedPoints(source, target, made, columns, recording, (*table.notes, *notes, *more), asked, known is None)


def is_probe_log(table: Table) -> bool:
    """Whether a table may be what LinuxCNC writes of its probings: the places of nine axes without a header."""
    return table.values.shape[1] == LOGGED and not any(table.names)


def points_of_log(test: SphereTest, values: np.ndarray) -> Points:
    """The planned points with the centres that follow from touches.

    Args:
        test: With its positions.
        values: Places of the axes X, Y, Z first, (touches, 9) mm.
    """
    planned = test.planned
    found = centres_of_log(test, values * MM)
    return replace(planned, deviation=found - planned.position[:, test.chain.linear_columns])


def _columns(table: Table, test: Any, signals: tuple[str, ...]) -> tuple[tuple[PointColumn, ...], list[str]]:
    """Which column is what: as the user says, otherwise as the words of the header say."""
    instrument, out = INSTRUMENTS[test.instrument], {}
    names = instrument.file_columns(test)
    taken = set()
    for said in signals:
        match = _SAID.fullmatch(said)
        name = match[1].strip() if match else said
        if match is None or name not in names:
            raise InputError(
                f"--signal {shown(said)}; allowed: NAME=COLUMN or NAME=COLUMN:UNIT, NAME one of {', '.join(names)}"
            )
        place, quantity, unit = table.place(match[2].strip()), names[name][0], match[3] or ""
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
        name = instrument.column_named(test, header, bare(header)) if header else ""
        if name not in names or name in out:
            unused.append(place)
            continue
        quantity, usual = names[name]
        unit = unit_of_column(header, table.units[place], quantity) if quantity else ""
        if quantity and not unit:
            notes.append(f'column {place + 1} "{header}" has no unit: taken for {usual}')
        out[name] = PointColumn(name, place, unit or usual)
    if missing := instrument.missing_columns(test, out):
        raise InputError(
            f"{table.path}: no column for {', '.join(missing)}; the file has {table.columns}; say which it is with "
            f"--signal {missing[0].split()[0]}=COLUMN:UNIT"
        )
    if unused:
        notes.append(f"not taken: {table.listed(unused)}")
    return tuple(out.values()), notes


def _recording(source: Path, table: Table, columns: tuple[PointColumn, ...], test: Any) -> tuple[Any, list[str]]:
    """What the whole rows of a table hold."""
    instrument, notes = INSTRUMENTS[test.instrument], []
    names = instrument.file_columns(test)
    whole = np.isfinite(table.values[:, [c.place for c in columns]]).all(axis=1)
    if not whole.all():
        notes.append(f"{int((~whole).sum())} rows are left out: they have empty cells")
    values = table.values[whole]
    if len(values) < _FEWEST:
        raise InputError(f"{source}: {len(values)} whole rows; allowed: at least {_FEWEST}")
    si = {c.name: values[:, c.place] * (factor(c.unit, names[c.name][0]) if names[c.name][0] else 1.0) for c in columns}
    recording, more = instrument.from_columns(source, test, si)
    return recording, [*notes, *more]


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
