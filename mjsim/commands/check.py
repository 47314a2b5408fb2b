"""``mjsim check`` as functions: what is wrong with a campaign's files, and a corrected copy of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign, remarks_on
from mjsim.commands.any_instrument import check_plainly
from mjsim.commands.comparison import CheckedPart, joined
from mjsim.errors import InputError
from mjsim.importing.importer import duration_question
from mjsim.importing.into_campaign import trace_bytes
from mjsim.inference.mistakes.mistakes import MISTAKES, Mistake, corrected, rewritten
from mjsim.inference.mistakes.recognise import TestEvidence, recognise
from mjsim.instruments.ball_bar.files import read_trace, spans_fit, test_table
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.span import explain
from mjsim.io.files import write_all
from mjsim.io.toml import read_text
from mjsim.machine.model import Machine

# -- what is wrong with the ball-bar tests of a campaign, and a corrected copy of its files ----------------------------


@dataclass(frozen=True)
class CheckedBars(CheckedPart):
    """Mistakes of ball-bar tests.

    Attributes:
        corrected: The campaign without the mistakes that have one remedy.
    """

    corrected: Campaign

    @property
    def questions(self) -> tuple[str, ...]:
        """Traces that last longer or shorter than their tests: a sentence for each."""
        named = {name for m in self.mistakes for name in m.tests}
        tests = [t for t in self.campaign.measured if t.name not in named]
        asked = (duration_question(t, self.campaign.traces[t.name], self.campaign.tests) for t in tests)
        return tuple(f"{t.name}: {q}" for t, q in zip(tests, asked, strict=True) if q)


#: The spikes' size over the model's may be so far from 1 where they are taken for the test's own.
_SIZE = 4.0


def evidence_of(t: TestEvidence) -> str:
    """Why a test's reversals do not show that its trace is what campaign.toml says; empty where they do."""
    if t.factor is None or t.agreement is None:
        return "the model has no friction spikes at its reversals"
    if t.agreement < MISTAKES.agreement:
        return f"its reversals agree little with the model ({t.agreement:.2f}; {MISTAKES.agreement:g} is needed)"
    if not 1 / _SIZE < t.factor < _SIZE:
        return f"the spikes at its reversals have {t.factor:.2g} times the model's size"
    return ""


def check_bars(campaign: Campaign, machine: Machine, threads: int = 2) -> CheckedBars:
    """Look for a wrong unit, sign, direction or feed, exchanged traces and wrong clocks.

    Args:
        campaign: With ball-bar tests alone, read without a look at the spans.
        machine: The model.
        threads: Simulations side by side.
    """
    clocks = tuple(_clocks(campaign))
    timed = corrected(campaign, clocks)
    left = {name for m in clocks if not m.certain for name in m.tests}
    usable = replace(timed, traces={n: t for n, t in timed.traces.items() if n not in left})
    if not usable.measured:
        return CheckedBars(campaign, clocks, (), timed)
    found = recognise(usable, machine, threads)
    rows = tuple(
        {"name": t.name, "size": t.factor, "agreement": t.agreement, "evidence": evidence_of(t) or None}
        for t in found.tests
    )
    return CheckedBars(campaign, (*clocks, *found.mistakes), rows, corrected(timed, found.mistakes))


def _clocks(campaign: Campaign) -> list[Mistake]:
    """Mistakes that the times show, of single tests or, where all share one, of all."""
    spans = {
        t.name: (float(campaign.traces[t.name].time[0]), float(campaign.traces[t.name].time[-1]))
        for t in campaign.measured
    }
    wrong = [t for t in campaign.measured if not spans_fit(t, *spans[t.name])]
    out: list[Mistake] = []
    for t in wrong:
        partner = next(
            (u for u in wrong if u is not t and spans_fit(u, *spans[t.name]) and spans_fit(t, *spans[u.name])),
            None,
        )
        if partner is not None:
            if partner.name > t.name:
                out.append(Mistake("swapped", (t.name, partner.name), "each lasts as long as the other test's program"))
            continue
        mistake = explain(t, *spans[t.name])
        if mistake is None:
            begin, end = spans[t.name]
            out.append(
                Mistake(
                    "unclear", (t.name,), f"it runs from {begin:.2f} to {end:.2f} s, which is not this test's program"
                )
            )
        else:
            out.append(Mistake(mistake.kind, (t.name,), mistake.sentence, factor=mistake.value))
    if len(out) == len(campaign.measured) > 1 and len({(m.kind, m.factor, m.evidence) for m in out}) == 1:
        return [replace(out[0], tests=tuple(t.name for t in campaign.measured), every=True)]
    return out


def write_bars(result: CheckedBars, folder: str | Path) -> list[Path]:
    """Write the campaign's files into a new folder, with the mistakes put right.

    Raises:
        InputError: a mistake leaves a choice, there is none, or the folder has files in it.
    """
    source, out = result.campaign.folder, Path(folder)
    if not result.mistakes:
        raise InputError(f"{source}: nothing to put right")
    for m in result.mistakes:
        if not m.certain:
            raise InputError(f"{source / 'campaign.toml'}: {m.sentence}; correct it by hand, only you can tell")
    if out.exists() and any(out.iterdir() if out.is_dir() else [out]):
        raise InputError(f"{out}: exists; allowed: a new or empty folder for the corrected copy")
    document = tomlkit.parse(read_text(source / "campaign.toml"))
    tables = {str(t["name"]): t for t in document["test"]}
    contents: dict[Path, str | bytes] = {}
    for file in sorted(
        p for p in source.rglob("*") if p.is_file() and not p.is_relative_to(result.campaign.state_folder)
    ):
        contents[out / file.relative_to(source)] = file.read_bytes()
    edits: dict[str, list[Mistake]] = {}
    for m in result.mistakes:
        _put_right(m, tables, {t.name: t for t in result.campaign.tests})
        if m.kind in ("sign", "unit", "sign_and_unit", "time_unit", "origin"):
            for name in m.tests:
                edits.setdefault(str(tables[name]["trace"]), []).append(m)
    for file, mistakes in edits.items():
        raw = read_trace(source / file, replace(result.campaign.instrument, range=np.inf))
        time, deviation = raw.time, np.where(raw.valid, raw.deviation, np.nan)
        for m in mistakes:
            time, deviation = rewritten(m, time, deviation)
        contents[out / file] = trace_bytes(out / file, time, deviation)
    if result.campaign.machine_file.is_file() and not result.campaign.machine_file.resolve().is_relative_to(
        source.resolve()
    ):
        document["machine"] = str(result.campaign.machine_file.resolve())
    contents[out / "campaign.toml"] = tomlkit.dumps(document)
    write_all(contents)
    return list(contents)


def _put_right(m: Mistake, tables: dict, tests: dict[str, BallBarTest]) -> None:
    """What of a mistake stands in campaign.toml."""
    if m.kind == "swapped":
        a, b = (tables[name] for name in m.tests)
        a["trace"], b["trace"] = str(b["trace"]), str(a["trace"])
    for name in m.tests:
        t = tables[name]
        if m.kind == "direction":
            before, after = test_table(tests[name]), test_table(kind_of(tests[name]).turned(tests[name]))
            for key in before:
                if after[key] != before[key]:
                    t[key] = after[key]
        elif m.kind == "feed":
            t["feed_mm_min"] = float(f"{m.factor * 60e3:.9g}")
        elif m.kind == "revolutions":
            t["revolutions"] = round(m.factor)


#: Checks that compare recordings with the model.
_CHECK = {BallBarTest.instrument: check_bars}


@dataclass(frozen=True)
class CheckResult:
    """Mistakes of a campaign.

    Attributes:
        campaign: As read.
        parts: What is wrong with the tests of each instrument.
    """

    campaign: Campaign
    parts: tuple[CheckedPart, ...]

    @property
    def mistakes(self) -> tuple[Any, ...]:
        """All of them."""
        return tuple(m for part in self.parts for m in part.mistakes)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the record of temperatures shows, a sentence each."""
        return tuple(remarks_on(self.campaign))

    @property
    def bars(self) -> CheckedBars | None:
        """Of the ball-bar tests; ``None`` where none was measured."""
        return next((p for p in self.parts if isinstance(p, CheckedBars)), None)

    def to_json(self) -> dict:
        """As ``mjsim check --json`` prints it."""
        data = joined(self.campaign, {p.instrument: p.to_json() for p in self.parts})
        return data if self.campaign.temperatures is None else {**data, "temperature": list(self.remarks)}


def check(path: str | Path, machine: Machine | None = None, threads: int = 2) -> CheckResult:
    """Look for a wrong unit, sign, direction or feed, exchanged traces or columns, and wrong clocks.

    Args:
        path: Folder of the campaign, or its campaign.toml.
        machine: The model; ``None``: the campaign's.
        threads: Simulations side by side.

    Raises:
        InputError: A file cannot be read at all, or no test has a trace.
    """
    campaign = read_campaign(path, spans=False)
    campaign.need_traces("there is nothing to check")
    machine = in_campaign(machine or read_machine(campaign.machine_file), campaign)
    parts = campaign.measured_parts.items()
    return CheckResult(campaign, tuple(_CHECK.get(name, check_plainly)(part, machine, threads) for name, part in parts))


def write_corrected(result: CheckResult, folder: str | Path) -> list[Path]:
    """Write the campaign's files into a new folder, with the mistakes of ball-bar tests put right.

    Raises:
        InputError: A mistake leaves a choice, there is none that can be put right, or the folder has files in it.
    """
    if result.bars is None:
        raise InputError(f"{result.campaign.folder}: nothing to put right")
    return write_bars(result.bars, folder)
