"""Temperatures that sensors recorded while a machine was measured."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

#: Samples inside such a time are averaged, s: no part of a machine warms up faster (assumed).
MEAN = 20.0
#: What a sensor may be called: its name stands in the key of an effect.
SENSOR = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,39}")
SENSOR_NAMES = "the name of a sensor, up to 40 letters, digits, blanks, _, - and . that begin with a letter or digit"


@dataclass(frozen=True, eq=False)
class Temperatures:
    """Temperatures over a campaign's clock.

    Attributes:
        time: Of the samples, growing, (n,) s on the campaign clock.
        names: Of the sensors.
        value: (n, sensors) °C.
    """

    time: np.ndarray
    names: tuple[str, ...]
    value: np.ndarray

    def rise(self, sensor: str) -> tuple[np.ndarray, np.ndarray]:
        """Means over :data:`MEAN`, less the temperature at the clock's zero: times (m,) s and rises (m,) K.

        Between them the temperature is a line. Before the first and after the last it stays as it is.
        """
        number = np.floor((self.time - self.time[0]) / MEAN)
        first = np.flatnonzero(np.diff(number, prepend=-1.0))
        count = np.diff(np.append(first, len(number)))
        time = np.add.reduceat(self.time, first) / count
        value = np.add.reduceat(self.value[:, self.names.index(sensor)], first) / count
        return time, value - np.interp(0.0, time, value)

    def uncertainty(self, sensor: str) -> float:
        """Standard uncertainty of a mean of a sensor, K: how far it is off the line between its neighbours, where the
        errors of all three are independent. So what happens between two samples is in it as well.
        """
        _, value = self.rise(sensor)
        bend = np.diff(value, 2)
        return float(np.sqrt(np.mean(bend**2) / 6.0)) if len(bend) else 0.0

    def weights(self, sensor: str, clock: np.ndarray) -> np.ndarray:
        """How the temperature of a sensor at some times depends on its means.

        Args:
            sensor: Its name.
            clock: (n,) s on the campaign clock.

        Returns:
            (n, k): one column for each mean that counts.
        """
        time, _ = self.rise(sensor)
        first = max(int(np.searchsorted(time, clock.min(), "right")) - 1, 0)
        last = min(int(np.searchsorted(time, clock.max(), "left")) + 1, len(time))
        unit = np.eye(len(time))[first:last]
        return np.column_stack([np.interp(clock, time, row) for row in unit])

    def rise_at(self, sensor: str, clock: np.ndarray) -> np.ndarray:
        """Temperature less that at the clock's zero, of a sensor at some times.

        Args:
            sensor: Its name.
            clock: (n,) s on the campaign clock.

        Returns:
            (n,) K.
        """
        return np.interp(clock, *self.rise(sensor))
