"""Temperatures of a campaign: ``temperature.csv`` beside campaign.toml, what it shows to be wrong, and the machine that
follows it.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.inputs import csv_table, shown
from mjsim.io.times import check_growing
from mjsim.machine.model import Machine
from mjsim.machine.temperatures import MEAN, SENSOR, SENSOR_NAMES, Temperatures

#: Name of the file, and what a column's name may end in beside the sensor's.
FILE, _ENDING = "temperature.csv", "_degC"
#: Most sensors; temperatures that a machine tool may have, °C.
MOST, COLDEST, HOTTEST = 20, -50.0, 200.0
#: Time without a sample that is a gap: so many usual steps, and longer than what a machine's temperature is averaged
#: over.
_GAP = 5.0
#: Readings closer to each other than what a usual sensor resolves, K, are one sensor's, and a sensor that changes less
#: says nothing.
_RESOLUTION = 0.1


def read_temperatures(folder: Path) -> Temperatures | None:
    """Temperatures of the campaign in a folder; ``None`` where none were recorded.

    Raises:
        InputError: A column, time or value is wrong.
    """
    path = folder / FILE
    if not path.is_file():
        return None
    names, table, lines = csv_table(path, lambda columns: _check_names(path, columns))
    return temperatures_of(path, names, table, lines)


def temperatures_of(path: Path, names: list[str], table: np.ndarray, lines: np.ndarray) -> Temperatures:
    """Temperatures from a table of numbers.

    Args:
        path: Of the file, for messages.
        names: Of the columns: ``time_s``, and one for each sensor.
        table: s and °C, (n, columns).
        lines: Of the rows in the file, (n,).

    Raises:
        InputError: A column, time or value is wrong.
    """
    _check_names(path, names)
    if len(table) < 2:
        raise InputError(f"{path}: {len(table)} rows of numbers; allowed: two or more")
    check_growing(path, table[:, 0], lambda i: int(lines[i]))
    value = table[:, 1:]
    if len(wrong := np.argwhere((value < COLDEST) | (value > HOTTEST))):
        i, k = wrong[0]
        raise InputError(
            f"{path}, line {lines[i]}: {names[k + 1]} = {value[i, k]:g}; allowed: {COLDEST:g} to {HOTTEST:g} °C"
        )
    return Temperatures(table[:, 0], tuple(n.removesuffix(_ENDING) for n in names[1:]), value)


def _check_names(path: Path, columns: list[str]) -> None:
    if columns[:1] != ["time_s"]:
        raise InputError(
            f"{path}, line 1: the first column is {shown(columns[0])}; allowed: time_s, then one column a sensor, °C"
        )
    sensors = [c.removesuffix(_ENDING) for c in columns[1:]]
    if not 1 <= len(sensors) <= MOST:
        raise InputError(f"{path}, line 1: {len(sensors)} sensors behind time_s; allowed: 1 to {MOST}")
    for name in sensors:
        if not SENSOR.fullmatch(name):
            raise InputError(f"{path}, line 1: column {shown(name)}; allowed: {SENSOR_NAMES}")
        if sensors.count(name) > 1:
            raise InputError(f"{path}, line 1: the sensor {name} has {sensors.count(name)} columns; allowed: one")


def in_campaign(machine: Machine, campaign: Campaign) -> Machine:
    """A machine with the temperatures of a campaign.

    Args:
        machine: As read.
        campaign: Whose tests are simulated.

    Raises:
        InputError: An effect of the machine follows a sensor that the campaign does not have.
    """
    have = campaign.temperatures.names if campaign.temperatures is not None else ()
    for effect in machine.effects:
        sensor = effect.values.get("sensor")
        if sensor is not None and sensor not in have and campaign.measured and not effect.is_neutral:
            found = f"has the sensors {', '.join(have)}" if have else "is missing"
            raise InputError(
                f"{campaign.folder / FILE}: {found}, but the machine has {effect.key}; allowed: a record with a column "
                f"{sensor}, or a machine without that effect"
            )
    is_so = machine.temperatures is campaign.temperatures  # callers tell by the object whether a model is still theirs
    return machine if is_so else replace(machine, temperatures=campaign.temperatures)


def remarks_on(campaign: Campaign) -> list[str]:
    """What the record of temperatures shows of itself and of the tests' times, a sentence each."""
    t = campaign.temperatures
    if t is None:
        return []
    out, path = [], campaign.folder / FILE
    steps = np.diff(t.time)
    usual = float(np.median(steps))
    for i in np.flatnonzero(steps > max(_GAP * usual, MEAN)):
        out.append(
            f"{path}: {steps[i] / 60.0:.0f} min without a sample from {t.time[i]:g} s on; the temperature is taken as "
            f"a line there."
        )
    for a, b in combinations(range(len(t.names)), 2):
        if np.ptp(t.value[:, a] - t.value[:, b]) < _RESOLUTION:
            out.append(
                f"{path}: the sensors {t.names[a]} and {t.names[b]} show the same to {_RESOLUTION:g} K, so a diagnosis "
                f"cannot tell them apart; take one out where it is a copy."
            )
    for k, name in enumerate(t.names):
        if np.ptp(t.value[:, k]) < _RESOLUTION:
            out.append(f"{path}: the sensor {name} changes by less than {_RESOLUTION:g} K, so it explains no drift.")
    return out + _times(campaign, t, path)


def _times(campaign: Campaign, t: Temperatures, path: Path) -> list[str]:
    """What is wrong with the times of the tests on the clock of the temperatures."""
    spans = {test.name: span for test in campaign.measured if (span := span_of(campaign, test)) is not None}
    out = []
    outside = [name for name, (first, last) in spans.items() if first < t.time[0] - MEAN or last > t.time[-1] + MEAN]
    if outside:
        out.append(
            f"{path}: recorded from {t.time[0]:g} to {t.time[-1]:g} s, but {', '.join(outside)} "
            f"{'lies' if len(outside) == 1 else 'lie'} outside; the nearest temperature is taken there. Look at "
            f"started_s and at time_s: both count from the same instant."
        )
    starts = [first for first, _ in spans.values()]
    if len(starts) > 1 and len(set(starts)) == 1:
        out.append(
            f"{campaign.folder / 'campaign.toml'}: all tests start at {starts[0]:g} s; state started_s of each, on the "
            f"clock of {FILE}."
        )
    return out


def span_of(campaign: Campaign, test) -> tuple[float, float] | None:
    """First and last instant of a measured test on the campaign clock, s; ``None`` of one that has no place on it."""
    started = getattr(test, "started", None)
    if started is None:
        return None
    time = INSTRUMENTS[test.instrument].observe(test, campaign.traces[test.name]).time
    return started, started + float(time[-1] - time[0])
