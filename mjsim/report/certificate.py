"""A certificate of one or two pages: what was measured, with what, what it shows and how well that is known.

One campaign, or two of the same machine: as found, and as left after a repair. A figure passes or fails by ISO 14253-1
with a guard band. Probabilities of conformity are those of JCGM 106.
"""

from __future__ import annotations

import hashlib
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from textwrap import wrap
from typing import Any

from mjsim.campaign.machine_file import machine_document
from mjsim.campaign.model import Campaign
from mjsim.commands.diagnose import diagnosable, diagnose
from mjsim.commands.diagnosis import VERDICTS, Diagnosis
from mjsim.digits import decimals_of, estimate, expanded, fixed
from mjsim.errors import InputError
from mjsim.inference.budget import NAMES, Budget
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.acceptance import RANGE, UNDECIDED, Acceptance, Judged, Limit, Measured, judge
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarData
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.inputs import file_bytes
from mjsim.machine.model import Machine
from mjsim.plots import style
from mjsim.progress import Progress, silent
from mjsim.report.content import plain
from mjsim.report.write import check_same_machine
from mjsim.units import UM, percent

#: Most numbers of the table, and most files that are listed by name.
_NUMBERS, _FILES = 24, 16
#: A4, inches; margins; leading over the size of the type.
_WIDTH, _HEIGHT, _LEFT, _TOP, _BOTTOM, _LEADING = 8.27, 11.69, 0.75, 0.7, 0.6, 1.32
_LARGEST_FILE = 200_000_000


@dataclass(frozen=True)
class Table:
    """A table of the certificate.

    Attributes:
        title: Above it.
        columns: Heads.
        rows: Cells, as they are printed.
        note: Below it.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclass(frozen=True)
class Certificate:
    """What the certificate says.

    Attributes:
        title: In one line.
        about: Machine, instrument and conditions: name and text.
        answers: Of each campaign what it is and what it shows.
        tables: Figures, numbers, budget, files.
    """

    title: str
    about: Sequence[tuple[str, str]]
    answers: Sequence[tuple[str, str]]
    tables: Sequence[Table]

    def to_json(self) -> dict:
        """Every text of the certificate."""
        return plain(self)

    def pdf(self) -> bytes:
        """The certificate as a file; the same content gives the same bytes."""
        from matplotlib import rc_context
        from matplotlib.backends.backend_pdf import PdfPages

        out = io.BytesIO()
        about = {"Title": self.title, "Creator": "mjsim", "CreationDate": None}
        with rc_context({"pdf.fonttype": 42}), PdfPages(out, metadata=about) as file:
            for figure in drawn(self):
                file.savefig(figure)
        return out.getvalue()


def make_certificate(
    campaigns: Campaign | Sequence[Campaign],
    machines: Machine | Sequence[Machine],
    threads: int = 2,
    progress: Progress = silent,
) -> Certificate:
    """The certificate of a campaign, or of two of the same machine: as found and as left. Nothing is written.

    Args:
        campaigns: One or two.
        machines: The model of each.
        threads: Tests simulated side by side.
        progress: Called as work gets on.

    Raises:
        InputError: Nothing measured, more than two campaigns, or of different machines.
    """
    every = [campaigns] if isinstance(campaigns, Campaign) else list(campaigns)
    models = [machines] * len(every) if isinstance(machines, Machine) else list(machines)
    if len(every) > 2:
        raise InputError(f"a certificate is of one campaign, or of two, as found and as left; found: {len(every)}")
    if len(every) == 2:
        check_same_machine(list(zip(every, models, strict=True)))
    for c in every:
        c.of(*diagnosable()).need_traces("a certificate needs measured tests")
    found = [diagnose(c.of(*diagnosable()), m, None, threads, progress) for c, m in zip(every, models, strict=True)]
    return certificate(found)


def certificate(results: Sequence[Diagnosis]) -> Certificate:
    """The certificate of a diagnosis, or of two: as found and as left.

    Args:
        results: Of ball-bar tests or of what was measured at rest, in order.

    Raises:
        InputError: A campaign of axis logs alone.
    """
    for r in results:
        if not r.has_bars and not r.at_rest:
            *most, last = (f"{INSTRUMENTS[i].test_noun}s" for i in diagnosable() if i != LogTest.instrument)
            needs = f"a certificate needs {', '.join(most)} or {last}"
            raise InputError(f"{r.campaign.folder / 'campaign.toml'}: {needs}")
    names = ["as found", "as left"] if len(results) == 2 else [""]
    last = results[-1]
    tables = [_figures(results, names), _numbers(results, names), _budget(last), *map(_files, results)]
    return Certificate(
        f"Measurement of {last.before.machine.name}",
        _about(results, names),
        [_answer(r, name) for r, name in zip(results, names, strict=True)],
        [t for t in tables if t.rows],
    )


def _about(results: Sequence[Diagnosis], names: Sequence[str]) -> list[tuple[str, str]]:
    machine, campaign = results[-1].before.machine, results[-1].campaign
    out = [("Machine", f"{machine.name}, configuration {machine.configuration}")]
    out.append(("Serial number", campaign.serial_number or "not stated"))
    for r, name in zip(results, names, strict=True):
        c = r.campaign
        day = c.measured_on.isoformat() if c.measured_on else "day not stated"
        setups = len({t.setup for t in c.measured})
        said = f"{c.name}, {day}: {_counted(len(c.measured), 'test')} in {_counted(setups, 'set-up')}"
        out.append((f"Campaign {name}".strip(), said))
    for kind, part in campaign.measured_parts.items():
        out.append((INSTRUMENTS[kind].noun.capitalize(), _instrument(results[-1], kind)))
        if isinstance(part.instruments[kind], BallBarData):
            feeds = sorted({round(t.feed / 1e-3 * 60.0) for t in part.measured})
            temperature = part.instruments[kind].temperature
            warm = "temperature not stated" if temperature is None else f"bar at {temperature:g} °C"
            speed = f"{feeds[0]} to {feeds[-1]}" if len(feeds) > 1 else f"{feeds[0]}"
            out.append(("Conditions", f"feed {speed} mm/min, no cutting; {warm}"))
    return out


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _instrument(r: Diagnosis, kind: str) -> str:
    data = r.campaign.instruments[kind]
    if isinstance(data, BallBarData):
        return (
            f"{data.source}: {data.form / UM:g} µm + {100.0 * data.gain_uncertainty:g} % of the reading, "
            f"{data.hysteresis / UM:g} µm between growing and falling readings (k = 2)"
        )
    rests = (rest for rest in r.at_rest if rest.after.instrument == kind)
    return next((f"noise of one value {x.noise / UM:.2g} µm, {x.noise_source}" for x in rests), "as stated")


def _answer(r: Diagnosis, name: str) -> tuple[str, str]:
    said, found = VERDICTS[r.verdict], []
    for e in r.effects:
        others = "".join(f", or {i} {percent(p)}" for i, p in e.others.items())
        found.append(e.effect.id + (f" ({percent(e.probability)}{others})" if e.probability is not None else ""))
    if found:
        said += f" {', '.join(found)}."
    if r.unexplained is not None:
        said += f" {r.unexplained.summary}"
    left = f"RMS of what the model leaves {r.before.rms / UM:.2f} µm as given, {r.after.rms / UM:.2f} µm with what was"
    return name or "Result", f"{said} {left} found; noise {r.noise / UM:.2f} µm."


# -- tables ------------------------------------------------------------------------------------------------------------


def _judged(r: Diagnosis) -> Iterator[Judged]:
    """Every figure with a limit, then the circular error or range of each other ball-bar test."""
    if not r.has_bars:
        return
    stated, data = r.campaign.acceptance, r.before.campaign.instruments
    tests = [t for t in r.before.tests if t.iso or not kind_of(t.test).goes_round]
    traces = [Measured(t.test.name, t.phi[t.valid], t.measured[t.valid]) for t in tests]
    limited = {(row.tests, row.figure) for row in stated.limits} if stated else set()
    if stated:
        yield from judge(stated, traces, r.noise)
    shown = {(name, figure) for names, figure in limited for name in names}
    for t in tests:
        figure = "circular_error" if kind_of(t.test).goes_round else RANGE
        if (t.test.name, figure) not in shown:
            form = stated.instrument if stated else data[t.test.instrument].form
            free = Acceptance((Limit((t.test.name,), figure, math.inf, ""),), form)
            yield from judge(free, traces, r.noise)


def _figures(results: Sequence[Diagnosis], names: Sequence[str]) -> Table:
    """Measured figures of the tests, side by side where there are two campaigns."""
    rows: dict[tuple, list[Judged | None]] = {}
    for i, r in enumerate(results):
        for j in _judged(r):
            key = (j.tests, j.limit.figure)
            rows.setdefault(key, [None] * len(results))[i] = j
    limited = any(j is not None and math.isfinite(j.limit.limit) for judged in rows.values() for j in judged)
    columns, cells = ["Test", "Figure", *(["Limit, µm"] if limited else [])], []
    for name in names:
        columns += [f"{name.capitalize() or 'Value'}, µm", *(["Guard", "Decision", "P(beyond)"] if limited else [])]
    for (tests, figure), judged in rows.items():
        limit = next(j.limit.limit / UM for j in judged if j is not None)
        line = [" / ".join(tests), figure.replace("_", " ")]
        line += [f"{limit:g}" if math.isfinite(limit) else "–"] if limited else []
        for j in judged:
            more = ["–"] * 3
            if j is not None:
                ends = j.value_um - 2.0 * j.uncertainty_um, j.value_um + 2.0 * j.uncertainty_um
                if math.isfinite(limit):
                    guard = fixed(j.guard_um, decimals_of(None, ends))
                    more = [guard, "open" if j.decision == UNDECIDED else j.decision, percent(j.probability_beyond)]
                line.append(f"{estimate(j.value_um, ends)} {expanded(ends)}")
            else:
                line.append("–")
            line += more if limited else []
        cells.append(line)
    sources = dict.fromkeys(j.limit.source for judged in rows.values() for j in judged if j and j.limit.source)
    note = "Values with expanded uncertainty, k = 2, from repeatability, noise and instrument."
    if sources:
        note += f" Limits: {'; '.join(sources)}. Guard band by ISO 14253-1: within it a figure is open."
    return Table("Figures as measured", columns, cells, note)


def _numbers(results: Sequence[Diagnosis], names: Sequence[str]) -> Table:
    """Numbers of the machine: findings first, then what uses most of its limit."""
    known = [{(b.effect_id, b.number): b for b in r.budget} for r in results]
    found = {e.effect.id for r in results for e in r.effects}
    keys = list(dict.fromkeys(key for table in known for key in table))

    def rank(key: tuple[str, str]) -> tuple[bool, float]:
        used = [abs(b.value - b.expected) / b.limit for t in known if (b := t.get(key)) and b.limit]
        return key[0] not in found, -max(used, default=0.0)

    shown = [k for k in sorted(keys, key=rank) if k[0] in found or any(t[k].limit for t in known if k in t)][:_NUMBERS]
    columns = ["Number", "Unit", "Limit"]
    for name in names:
        columns += [name.capitalize() or "Value", "P(beyond)", "Decision"]
    cells = []
    for key in shown:
        one: Budget = next(t[key] for t in known if key in t)
        limit = "–" if one.limit is None else f"± {one.limit:.4g}"
        line = [f"{one.effect_id} {one.number}", one.unit or "ratio", limit]
        for r, table in zip(results, known, strict=True):
            b = table.get(key)
            if b is None:
                line += ["not found", "–", "–"]
                continue
            ends = b.value - 2.0 * b.standard, b.value + 2.0 * b.standard
            finding = next((e.probability for e in r.effects if e.effect.id == b.effect_id), None)
            chance = b.beyond if b.beyond is not None else finding
            line.append(f"{estimate(b.value, ends)} {expanded(ends)}")
            line += ["–" if chance is None else percent(chance), b.decision or ("finding" if finding else "–")]
        cells.append(line)
    left = len(keys) - len(shown)
    note = (
        "Fitted to all tests together, with expanded uncertainty, k = 2. P(beyond): probability that a number is "
        "farther from the machine file than its limit; of a finding without a limit, that it is there. Beyond or "
        "within: with at least 95 %; otherwise open."
    )
    return Table("Errors of the machine", columns, cells, note + (f" {left} more are in the report." if left else ""))


def _budget(r: Diagnosis) -> Table:
    """The budget of the findings, or of the numbers that use most of their limits."""
    found = {e.effect.id for e in r.effects}
    rows = [b for b in r.budget if b.effect_id in found]
    limited = [b for b in r.budget if b.limit and b.effect_id not in found]
    rows += sorted(limited, key=lambda b: -abs(b.value - b.expected) / (b.limit or 1.0))
    rows = rows[: _NUMBERS // 2]
    used = [name for name in NAMES if any(name in b.rows for b in rows)]
    cells = []
    for b in rows:
        decimals = decimals_of(None, (-2.0 * b.standard, 2.0 * b.standard))
        parts = [fixed(b.rows.get(name, 0.0), decimals) for name in used]
        cells.append([f"{b.effect_id} {b.number}", b.unit or "ratio", fixed(b.standard, decimals), *parts])
    note = (
        "Standard uncertainties. Set-up, instrument, data sheet and other errors: what would go if these were known "
        "exactly (law of total variance). They depend on each other, so the squares need not add up."
    )
    if rows:
        note += f" {rows[0].effect_id}: {rows[0].sentence}."
    return Table("Uncertainty budget", ["Number", "Unit", "Total", *(_HEADS[name] for name in used)], cells, note)


_HEADS = {
    "noise": "Noise",
    "set_up": "Set-up",
    "instrument": "Instrument",
    "data_sheet": "Data sheet",
    "machine_model": "Model of the machine",
    "other_errors": "Other errors",
    "not_understood": "Not under-stood",
    "choice_of_model": "Choice of model",
    "other_instrument": "Other instrument",
}


def _files(r: Diagnosis) -> Table:
    """What went in, by its content."""
    c, machine = r.campaign, r.before.machine
    paths = [c.folder / "campaign.toml", *([machine.path] if machine.path else [])]
    traces = [c.folder / t.trace for t in c.measured if t.trace]
    rows = [[p.name, _digest(p)] for p in paths]
    if len(traces) <= _FILES:
        rows += [[str(p.relative_to(c.folder)), _digest(p)] for p in traces]
    else:
        every = hashlib.sha256("".join(map(_digest, traces)).encode()).hexdigest()
        rows.append([f"{len(traces)} traces, hash of their hashes in order", every])
    text = machine_document(r.machine, machine.path) if machine.path else repr(r.machine)
    rows.append(["fitted machine", hashlib.sha256(text.encode()).hexdigest()])
    made = ", ".join(f"{name} {version(name)}" for name in ("mjsim", "mujoco", "numpy", "scipy"))
    return Table(f"What went in: {c.name}", ["File", "SHA-256"], rows, f"Computed by {made}.")


def _digest(path: Path) -> str:
    return hashlib.sha256(file_bytes(path, _LARGEST_FILE, "200 MB")).hexdigest()


# -- pages -------------------------------------------------------------------------------------------------------------


class _Pages:
    """Pages that are filled from the top; measures in inches."""

    def __init__(self) -> None:
        self.figures: list = []
        self.new_page()

    def new_page(self) -> None:
        """Go on at the top of another page."""
        self.figures.append(style.new_figure(_WIDTH, _HEIGHT))
        self.y = _TOP

    def room(self, height: float) -> bool:
        """Begin another page where that much does not fit any more, and say so."""
        full = self.y + height > _HEIGHT - _BOTTOM
        if full:
            self.new_page()
        return full

    def put(self, x: float, text: str, size: float, **more: Any) -> None:
        """A line of text, whose top is here."""
        look = {"ha": "left", "va": "baseline", "fontsize": size, "color": style.INK} | more
        self.figures[-1].text(x / _WIDTH, 1.0 - (self.y + size / 72.0) / _HEIGHT, text, **look)

    def paragraph(self, text: str, size: float, x: float = _LEFT, **more: Any) -> None:
        """Text over the width that is left, broken into lines."""
        for line in wrap(text, _letters(_WIDTH - _LEFT - x, size)):
            self.room(size / 72.0)
            self.put(x, line, size, **more)
            self.y += _LEADING * size / 72.0

    def rule(self) -> None:
        """A line across the page."""
        from matplotlib.lines import Line2D

        at = [1.0 - self.y / _HEIGHT] * 2
        ends = [_LEFT / _WIDTH, 1.0 - _LEFT / _WIDTH]
        self.figures[-1].add_artist(Line2D(ends, at, color=style.GRID, linewidth=0.6))

    def table(self, t: Table, size: float = 6.6) -> None:
        """A table with columns as wide as what is in them, as far as the page allows."""
        line = _LEADING * size / 72.0
        self.room(0.55 + 2.0 * line)
        self.y += 0.1
        self.put(_LEFT, t.title, 9.0, fontweight="bold")
        self.y += 0.21
        needed = [max(len(r[i]) for r in (*t.rows, [*(_longest(h) for h in t.columns)])) for i in range(len(t.columns))]
        wide = [max(n, len(_longest(h))) for n, h in zip(needed, t.columns, strict=True)]
        most = _letters(_WIDTH - 2.0 * _LEFT, size) - 2 * (len(wide) - 1)
        while sum(wide) > most and max(wide) > 6:
            wide[wide.index(max(wide))] -= 1
        step = (_WIDTH - 2.0 * _LEFT) / max(sum(wide) + 2 * (len(wide) - 1), 0.75 * most)
        places = [_LEFT + step * (sum(wide[:i]) + 2 * i) for i in range(len(wide))]
        head = [wrap(cell, max(w, 4)) for cell, w in zip(t.columns, wide, strict=True)]

        def put_row(cells: list[list[str]], **look: Any) -> None:
            top = self.y
            for x, text in zip(places, cells, strict=True):
                for i, words in enumerate(text):
                    self.y = top + i * line
                    self.put(x, words, size, **look)
            self.y = top + line * max(map(len, cells)) + 0.015

        def put_head() -> None:
            put_row(head, fontweight="bold")
            self.y += 0.02
            self.rule()
            self.y += 0.02

        put_head()
        for row in t.rows:
            cells = [wrap(cell, max(w, 4)) or [""] for cell, w in zip(row, wide, strict=True)]
            if self.room(line * max(map(len, cells))):
                put_head()
            put_row(cells)
        if t.note:
            self.y += 0.03
            self.paragraph(t.note, 6.4, color=style.SOFT)
        self.y += 0.08


def _longest(head: str) -> str:
    return max(head.replace("-", "- ").split(), key=len)


def _letters(inches: float, size: float) -> int:
    """How many letters fit: one is 0.56 of the size wide on average."""
    return int(inches * 72.0 / (0.56 * size))


def drawn(c: Certificate) -> list:
    """The pages as figures."""
    pages = _Pages()
    pages.put(_LEFT, c.title, 15.0, fontweight="bold")
    pages.y += 0.36
    for name, text in c.about:
        pages.put(_LEFT, name, 7.8, color=style.SOFT)
        pages.paragraph(text, 7.8, _LEFT + 1.35)
        pages.y += 0.02
    pages.y += 0.06
    for name, text in c.answers:
        pages.put(_LEFT, name[:1].upper() + name[1:], 8.6, fontweight="bold")
        pages.paragraph(text, 8.6, _LEFT + 1.35)
        pages.y += 0.05
    for t in c.tables:
        pages.table(t)
    pages.room(0.5)
    pages.y = max(pages.y + 0.3, _HEIGHT - _BOTTOM - 0.25)
    for x, what in ((_LEFT, "Place and date"), (_LEFT + 2.4, "Measured by"), (_LEFT + 4.8, "Signature")):
        pages.put(x, f"{what} ………………………………", 7.0, color=style.SOFT)
    for number, figure in enumerate(pages.figures, start=1):
        said = f"{c.title} · page {number} of {len(pages.figures)} · mjsim {version('mjsim')}"
        figure.text(0.5, 0.3 / _HEIGHT, said, ha="center", fontsize=6.5, color=style.SOFT)
    return pages.figures
