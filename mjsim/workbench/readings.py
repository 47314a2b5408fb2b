"""Simulated readings of the tests, by the drives alone at once and by the multibody model soon after, and kept."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mjsim.inference.samples import GRID, GRID_STEPS
from mjsim.inference.vibration import phased
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.simulation.drive import STEP
from mjsim.simulation.multibody import reading_of, simulate_each
from mjsim.simulation.stability import check_stable
from mjsim.workbench.opened import OpenCampaign

#: Names of the two ways to simulate, as the plots print them.
DRIVES, MULTIBODY = "drives alone", "multibody"
#: Multibody readings that are kept: so many models of a campaign of 13 tests, 0.3 MB a test.
_KEPT_MODELS = 12


@dataclass(frozen=True)
class Simulated:
    """A simulated reading.

    Attributes:
        deviation: (n,) m, from the program's start, without nuisances.
        spacing: s between its values.
        engine: What simulated it.
    """

    deviation: np.ndarray
    spacing: float
    engine: str

    @property
    def coarse(self) -> np.ndarray:
        """The reading on the grid of the fits, m."""
        return self.deviation[:: round(GRID / self.spacing)]


def key_of(machine: Machine) -> tuple:
    """What the readings of a machine depend on: its drives and the values of its effects, in their order."""
    effects = tuple((e.key, repr(e.values)) for e in machine.effects)
    return machine.configuration, tuple(map(repr, machine.drives.values())), effects


class Readings:
    """Readings of one open campaign, shared by all pages.

    Args:
        opened: The campaign.
    """

    def __init__(self, opened: OpenCampaign) -> None:
        self.opened = opened
        self._motions, self._bodies = threading.Lock(), threading.Lock()
        self._kept: OrderedDict[tuple, Simulated] = OrderedDict()
        self._change = threading.Lock()
        self._most = max(1, len(opened.tests)) * _KEPT_MODELS

    def plant(self, machine: Machine) -> Plant:
        """The plant of a machine, its vibrations with the phases that they have in the measured tests.

        Raises:
            InputError: An effect acts on what the machine does not have.
            SimulationError: A drive is unstable.
        """
        problem = self.opened.problem
        with self._motions:
            plant = build(phased(problem, machine) if problem is not None else machine)
        check_stable(plant)
        return plant

    def drives_alone(self, machine: Machine, names: Iterable[str] | None = None) -> dict[str, Simulated]:
        """Readings of some tests (all) by the drives alone, by the test's name.

        Raises:
            InputError: An effect acts on what the machine does not have.
            SimulationError: A drive is unstable.
        """
        plant = self.plant(machine)
        # a vibration does not survive the coarse grid
        every = 1 if any(e.kind == "vibration" and not e.is_neutral for e in machine.effects) else GRID_STEPS
        with self._motions:
            return {
                name: Simulated(self.opened.motions[name].reading(plant, every), STEP * every, DRIVES)
                for name in (names if names is not None else [t.name for t in self.opened.tests])
            }

    def multibody(self, machine: Machine, names: Sequence[str]) -> dict[str, Simulated]:
        """Readings of some tests in the multibody model, by the test's name; kept ones are not simulated again.

        Raises:
            InputError: There is no multibody model of such a machine.
            SimulationError: The simulation cannot be trusted.
        """
        out = self.kept(machine, names)
        missing = [self.opened.test(n) for n in names if n not in out]
        if missing:
            plant, key = self.plant(machine), key_of(machine)
            with self._bodies:
                done = simulate_each(plant, missing, reading_of, self.opened.threads)
            for s in done:
                out[s.test.name] = Simulated(s.deviation, STEP, MULTIBODY)
                self._keep((key, s.test.name), out[s.test.name])
        return out

    def kept(self, machine: Machine, names: Iterable[str] | None = None) -> dict[str, Simulated]:
        """Multibody readings that are there already, by the test's name."""
        key, out = key_of(machine), {}
        with self._change:
            for name in names if names is not None else [t.name for t in self.opened.tests]:
                if (key, name) in self._kept:
                    self._kept.move_to_end((key, name))
                    out[name] = self._kept[key, name]
        return out

    def _keep(self, key: tuple, reading: Simulated) -> None:
        with self._change:
            self._kept[key] = reading
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
