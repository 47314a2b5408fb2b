"""Measurement files of other systems into a campaign: the command ``mjsim import`` as functions."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mjsim.campaign.machine_file import read_machine
from mjsim.errors import InputError
from mjsim.importing import into_campaign as into
from mjsim.importing.checks import questions
from mjsim.importing.reading import Options, read_columns
from mjsim.importing.sources import sources
from mjsim.importing.timing import place
from mjsim.instruments.ball_bar.measurement import BallBarData, BallBarTest, Trace
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.files import check_writable
from mjsim.units import DEG, UM


@dataclass(frozen=True)
class ImportedTrace:
    """One trace as it was brought in, or as it would be.

    Attributes:
        source: the measurement file. file: the trace's file in the campaign. test: its test; ``added`` whether
            campaign.toml got it or its ``trace``, ``new_test`` whether it got the test.
        trace: what was kept. unit: of the deviation in ``source``. notes: what was found and concluded. questions: what
            looks wrong.
        written: false for a preview.
    """

    source: Path
    file: Path
    test: BallBarTest
    added: bool
    trace: Trace
    unit: str
    notes: tuple[str, ...]
    questions: tuple[str, ...]
    written: bool
    new_test: bool = False

    def to_json(self) -> dict:
        """Plain numbers in s, degrees and µm, as ``mjsim import --json`` prints them."""
        t, program = self.trace, Program(self.test)
        lo, hi = program.measured_span
        deviation = t.deviation[t.valid] / UM
        return {
            "source": str(self.source),
            "test": self.test.name,
            "trace": str(self.file),
            "added": self.added,
            "new_test": self.new_test,
            "written": self.written,
            "samples": len(t.time),
            "samples_missing": int((~t.valid).sum()),
            "rate_Hz": round(1.0 / float(np.median(np.diff(t.time))), 3),
            "duration_s": round(float(t.time[-1] - t.time[0]), 4),
            "program_s": round(hi - lo, 4),
            "unit": self.unit,
            "min_um": round(float(deviation.min()), 4),
            "max_um": round(float(deviation.max()), 4),
            "rms_um": round(float(deviation.std()), 4),
            "first_rows": [
                {
                    "time_s": round(float(s), 6),
                    "phi_deg": round(float(p / DEG), 4),
                    "deviation_um": round(float(d / UM), 4),
                }
                for s, p, d in zip(t.time[:5], program.phi(t.time[:5]), t.deviation[:5], strict=True)
            ],
            "notes": list(self.notes),
            "questions": list(self.questions),
        }


def import_traces(
    campaign: str | Path,
    files: Sequence[str | Path],
    test: str | Sequence[str | None] | None = None,
    keys: dict[str, Any] | None = None,
    options: Options | None = None,
    force: bool = False,
    preview: bool = False,
    check: bool = True,
) -> list[ImportedTrace]:
    """Bring recorded traces into a campaign, from text files and the runs of ``.b5r`` files: all of them, or none.

    Args:
        campaign: a folder with a campaign.toml, or the path of one.
        files: tables as text, each with one run of one test; or ``.b5r`` files, whose runs go to the tests that fit
            their header.
        test: the test's name for a single file, or a name (or ``None``) for each file. Without one the file's name is
            the test's.
        keys: keys of the ``[[test]]`` table, as in campaign.toml, of tests that are not there yet; the files' headers
            come second.
        options: how the files are read. force: replace traces that are there. preview: write nothing.
        check: also compare the trace's size with what the campaign's model gives, which simulates the test.

    Raises:
        InputError: names the file, the place, what was found and what is allowed; nothing is written.
    """
    o = options or Options()
    file, text, known = into.read_document(Path(campaign))
    if isinstance(test, str) and len(files) > 1:
        raise InputError(
            f"--test {test} names one test, {len(files)} files were given; allowed: FILE=TEST for each of them"
        )
    names = [test] * len(files) if test is None or isinstance(test, str) else test
    instrument = known.instruments.get(BallBarTest.instrument, BallBarData()) if known else BallBarData()
    out, contents = [], {}
    for item in sources([Path(f) for f in files], names, dict(keys or {}), o, known):
        source, table, name = item.path, item.table, item.name
        entry = into.entry(file, text, name, dict(keys or {}), item.header, source)
        if entry.file in contents:
            raise InputError(
                f"{source}: another of these files is test {name!r} as well; allowed: one file for each test "
                f"(FILE=TEST names it)"
            )
        if not preview:
            check_writable(entry.file, force)
        text = entry.text
        own, assumed = item.timed(entry.test)
        recording = read_columns(table, entry.test, own)
        time, deviation, placed = place(source, recording, entry.test, own)
        trace = into.checked_trace(source, entry.test, time, deviation, instrument)
        notes = (
            *table.notes,
            *assumed,
            *recording.notes,
            *placed,
            "a shorter bar is positive in the file: signs turned" if o.inward else "",
        )
        if trace.saturated:
            notes = (
                *notes,
                f"{trace.saturated} samples of a sensor at its stop, or beyond its range: they count as missing",
            )
        asked = questions(
            entry.test, trace, recording.unit, _machine(file, text) if check else None, known.tests if known else ()
        )
        asked += item.questions(entry.test)
        contents[entry.file] = into.trace_bytes(entry.file, time, deviation)
        kept = (
            source,
            entry.file,
            entry.test,
            entry.added,
            trace,
            item.unit or recording.unit,
            tuple(n for n in notes if n),
            tuple(asked),
        )
        out.append(ImportedTrace(*kept, written=not preview, new_test=entry.new_test))
    if not preview:
        into.write(file, text, contents, force)
    return out


def import_trace(campaign: str | Path, file: str | Path, test: str | None = None, **more: Any) -> ImportedTrace:
    """Bring one recorded trace into a campaign; arguments as :func:`import_traces`, and those of :class:`Options` by
    name.

    Raises:
        InputError: as :func:`import_traces`.
    """
    own = {k: more.pop(k) for k in ("keys", "force", "preview", "check") if k in more}
    made = import_traces(campaign, [file], test, options=Options(**more), **own)
    if not made:
        raise InputError(
            f"{file}: no run fits a test of the campaign; allowed: the name of its test, or keys of a new one"
        )
    return made[0]


def _machine(file: Path, text: str):
    """The campaign's machine, for what is to be expected; ``None`` where it cannot be read: an import needs none."""
    try:
        return read_machine(file.parent / str(tomllib.loads(text).get("machine", "machine.toml")))
    except InputError:
        return None
