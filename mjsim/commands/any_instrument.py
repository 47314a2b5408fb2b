"""What the commands do with an instrument that brings nothing of its own for them.

The axes are simulated with the drives alone. The instrument says what it shows of their motion. What its set-up does to
the reading is fitted linearly with its priors, over all tests of a set-up together; the machine is taken as it is.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.comparison import CheckedPart, ComparedChannel, ComparedPart, ComparedTest, significant
from mjsim.errors import InputError
from mjsim.instruments.base import INSTRUMENTS, Nuisances, Observation
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.progress import Progress, silent
from mjsim.simulation.axes import load_of
from mjsim.simulation.drive import STEP
from mjsim.simulation.stability import check_stable
from mjsim.simulation.standing import standing
from mjsim.threads import one_blas_thread

#: Header and cells of a table.
Rows = list[list[str]]
#: File of the figures of the first instrument; those of others have the instrument's name as well.
FIGURES = "figures.csv"
#: How often the size of what is left is taken anew in the fit of a set-up.
_ROUNDS = 4


@dataclass(frozen=True)
class PlainTest(ComparedTest):
    """One test.

    Attributes:
        test: As the campaign has it.
        shown: Measured and simulated, channel by channel.
        set_up: What was fitted of its set-up, by name with the unit.
        figures: Of measured and of simulated, by name with the unit.
        recording: As its instrument has read it.
    """

    test: Any
    shown: tuple[ComparedChannel, ...]
    set_up: dict[str, float]
    figures: dict[str, dict[str, float]]
    recording: Any

    @property
    def channels(self) -> tuple[ComparedChannel, ...]:
        """Measured and simulated, channel by channel."""
        return self.shown

    def to_json(self) -> dict:
        """Plain numbers in the units of the channels."""
        first, alike = self.channels[0], _alike(self)
        rms, largest = float(np.sqrt(np.mean([c.rms**2 for c in alike]))), max(c.maximum for c in alike)
        return {
            "name": self.test.name,
            "kind": self.test.instrument,
            "setup": self.test.setup,
            "samples": len(first.time),
            f"rms_{first.channel.suffix}": significant(rms / first.channel.size),
            f"max_{first.channel.suffix}": significant(largest / first.channel.size),
            "channels": [_channel_json(c) for c in self.channels],
            "set_up": {k: significant(v) for k, v in self.set_up.items()},
            "figures": {who: {k: significant(v) for k, v in f.items()} for who, f in self.figures.items()},
        }


def _alike(t: PlainTest) -> list[ComparedChannel]:
    """Channels of a test with the unit of its first one."""
    return [c for c in t.channels if c.channel.suffix == t.channels[0].channel.suffix]


def _channel_json(c: ComparedChannel) -> dict:
    size, suffix = c.channel.size, c.channel.suffix
    numbers = {"rms": c.rms, "max": c.maximum, "noise": c.noise}
    return {"name": c.channel.name} | {f"{k}_{suffix}": significant(v / size) for k, v in numbers.items()}


@dataclass(frozen=True)
class PlainComparison(ComparedPart):
    """The tests of one instrument against a machine, or of several of which each was compared by itself.

    Attributes:
        campaign: What was measured, the tests of these instruments alone.
        machine: As compared.
        tests: One per measured test.
    """

    campaign: Campaign
    machine: Machine
    tests: tuple[PlainTest, ...]

    @property
    def rms(self) -> float:
        """RMS of the residuals of all channels with the unit of the first one, SI."""
        return float(np.sqrt(np.mean([c.rms**2 for t in self.tests for c in _alike(t)])))

    @property
    def noise(self) -> float:
        """Largest noise of the first channel, SI."""
        return max(t.channels[0].noise for t in self.tests)

    def to_json(self) -> dict:
        """As ``mjsim compare --json`` prints it."""
        channel = self.tests[0].channels[0].channel
        return {
            "campaign": self.campaign.name,
            "machine": self.machine.name,
            "effects": [e.id for e in self.machine.effects],
            f"noise_{channel.suffix}": significant(self.noise / channel.size),
            f"rms_{channel.suffix}": significant(self.rms / channel.size),
            "warnings": self.warnings,
            "not_measured": [t.name for t in self.campaign.planned],
            "tests": [t.to_json() for t in self.tests],
        }


@one_blas_thread
def compare_plainly(
    campaign: Campaign, machine: Machine, threads: int = 2, progress: Progress = silent
) -> PlainComparison:
    """Simulate every measured test of one instrument and lay it over what was measured.

    Args:
        campaign: With tests of one instrument.
        machine: As it is.
        threads: Not used: a test takes milliseconds.
        progress: Called as work gets on.

    Raises:
        InputError: A recording shows a mistake.
        SimulationError: A drive is unstable.
    """
    instrument = INSTRUMENTS[campaign.tests[0].instrument]
    refuse_mistakes(campaign)
    plant = build(machine)
    check_stable(plant, moving=False)
    seen: list[tuple[Any, Observation, np.ndarray, Nuisances]] = []
    for i, test in enumerate(campaign.measured):
        progress("simulating", i, len(campaign.measured))
        observed = instrument.observe(test, campaign.traces[test.name])
        shown = shown_by(plant, test, campaign.traces[test.name], observed.time)
        set_up = instrument.nuisances_of(test, campaign.traces[test.name], observed.time, campaign.instrument)
        seen.append((test, observed, shown, set_up))
    fitted = _fit(seen)
    tests = []
    for test, observed, shown, set_up in seen:
        simulated = shown + set_up.columns @ fitted[test.name]
        noise = instrument.noise(test, campaign.traces[test.name], campaign.instrument)
        columns = zip(instrument.channels(test), observed.value.T, simulated.T, observed.valid.T, noise, strict=True)
        channels = tuple(ComparedChannel(c, observed.time, m, s, v, float(n)) for c, m, s, v, n in columns)
        both = {"measured": observed.value, "simulated": simulated}
        recording = campaign.traces[test.name]
        figures = {k: f for k, v in both.items() if (f := instrument.figures_of(test, recording, observed.time, v))}
        numbers = dict(zip(set_up.names, map(float, fitted[test.name]), strict=True))
        tests.append(PlainTest(test, channels, numbers, figures, recording))
    return PlainComparison(campaign, machine, tuple(tests))


def together(campaign: Campaign, machine: Machine, parts: Sequence[PlainComparison]) -> PlainComparison:
    """The tests of several instruments in one comparison.

    Args:
        campaign: What they measured.
        machine: As compared.
        parts: What each shows.
    """
    return PlainComparison(campaign, machine, tuple(t for part in parts for t in part.tests))


def shown_by(plant: Plant, test: Any, recording: Any, time: np.ndarray) -> np.ndarray:
    """What an ideal instrument shows of a machine in one test, (n, channels) SI.

    Args:
        plant: The machine's numbers.
        test: What is run.
        recording: What was recorded.
        time: Of the samples, (n,) s.
    """
    instrument = INSTRUMENTS[test.instrument]
    stops = instrument.stops(test, recording)
    if stops is not None:
        return instrument.reading_at(test, standing(plant, stops, test.name), plant.geometry, stops)
    fine = np.arange(int(np.ceil(time[-1] / STEP)) + 2) * STEP
    moved = load_of(plant, fine, instrument.command(test, fine), name=test.name)
    shown = instrument.reading(test, moved, plant.geometry)
    return np.column_stack([np.interp(time, fine, column) for column in shown.T])


def _fit(rows: list[tuple[Any, Observation, np.ndarray, Nuisances]]) -> dict[str, np.ndarray]:
    """Numbers of all set-ups by name of the test, by least squares over all tests; a prior counts as one more
    measurement of its number.

    A residual counts as much as the spread of all of them says: what the model does not explain is no noise, but it is
    not known better either.
    """
    places: dict[tuple[str, str], int] = {}
    own = {
        t.name: [places.setdefault(("" if k in n.shared else t.setup, k), len(places)) for k in n.names]
        for t, _, _, n in rows
    }
    spread = np.zeros(len(places))
    blocks = []
    for t, o, _, n in rows:
        spread[own[t.name]] = n.spread
        block = np.zeros((int(o.valid.sum()), len(places)))
        block[:, own[t.name]] = n.columns[o.valid] * n.spread
        blocks.append(block)
    design = np.vstack(blocks)
    rest = np.concatenate([(o.value - shown)[o.valid] for _, o, shown, _ in rows])
    left, x = rest, np.zeros(len(places))
    for _ in range(_ROUNDS):
        size = max(float(np.std(left)), 1e-12)
        whole = np.vstack([design / size, np.eye(len(places))])
        x = np.linalg.lstsq(whole, np.concatenate([rest / size, np.zeros(len(places))]), rcond=None)[0]
        left = rest - design @ x
    return {name: (x * spread)[at] for name, at in own.items()}


def refuse_mistakes(campaign: Campaign) -> None:
    """Stop where a recording shows a mistake, unless the campaign is taken as it is.

    Raises:
        InputError: The first mistake.
    """
    found = [] if campaign.as_is else mistakes_of(campaign)
    if found:
        raise InputError(f"{campaign.folder / 'campaign.toml'}: {found[0].sentence}, or say --as-is")


def mistakes_of(campaign: Campaign) -> list[Any]:
    """What the recordings of one instrument show to be wrong."""
    instrument = INSTRUMENTS[campaign.tests[0].instrument]
    return list(instrument.mistakes(campaign.measured, campaign.traces, campaign.instrument))


def check_plainly(campaign: Campaign, machine: Machine, threads: int = 2) -> CheckedPart:
    """Mistakes that the recordings of one instrument show by themselves; the machine is not asked."""
    instrument, found, rows = INSTRUMENTS[campaign.tests[0].instrument], mistakes_of(campaign), []
    for test in campaign.measured:
        recording = campaign.traces[test.name]
        time = instrument.observe(test, recording).time
        row = {"name": test.name, "samples": len(time), "duration_s": round(float(time[-1] - time[0]), 4)}
        mine = [m.kind for m in found if test.name in m.tests]
        rows.append(row | instrument.facts(test, recording) | {"finding": mine or ["ok"]})
    remarks = instrument.remarks(campaign.measured, campaign.traces, campaign.instruments[instrument.name])
    return CheckedPart(campaign, tuple(found), tuple(rows), remarks=tuple(remarks))


def plain_tables(result: ComparedPart, names: Collection[str]) -> dict[str, Rows]:
    """A table per test, and the errors of its channels, by file.

    Args:
        result: All tests of one instrument.
        names: Of the tests whose tables are wanted.
    """
    out: dict[str, Rows] = {}
    figures = [["test", "channel", "unit", "rms", "max", "noise"]]
    for t in (t for t in result.tests if t.test.name in names):
        head, columns = ["time_s"], [t.channels[0].time]
        over = INSTRUMENTS[t.test.instrument].over(t.test, t.recording) if isinstance(t, PlainTest) else None
        if over is not None:
            head.append(f"{over.name}_{over.unit}".replace(" ", "_").replace("°", "deg"))
            columns.append(over.value)
        for c in t.channels:
            size, suffix, name = c.channel.size, c.channel.suffix, c.channel.name.replace(" ", "_")
            for what in ("measured", "simulated", "residual"):
                head.append(f"{name}_{what}_{suffix}")
                columns.append(np.where(c.valid, getattr(c, what), np.nan) / size)
            numbers = (c.rms, c.maximum, c.noise)
            figures.append([t.test.name, c.channel.name, suffix, *(f"{v / size:.4f}" for v in numbers)])
        rows = np.column_stack(columns)
        out[f"{t.test.name}.csv"] = [head, *(["" if np.isnan(v) else f"{v:.6f}" for v in row] for row in rows)]
    return out | {FIGURES: figures}
