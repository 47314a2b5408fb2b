"""The open campaign and the browser tabs that show it, each with a state of its own."""

from __future__ import annotations

import threading
from collections import OrderedDict

from mjsim.campaign.model import Campaign
from mjsim.machine.bodies import has_model
from mjsim.machine.model import Machine
from mjsim.workbench.bodies import MachineBodies, stl_of
from mjsim.workbench.live import Live, RecordingsLive
from mjsim.workbench.page.desk import Desk
from mjsim.workbench.page.recordings import RecordingsDesk
from mjsim.workbench.state import Shared, Workbench, bench_of, shared_of

#: Tabs whose state is kept, the ones closed last included.
_TABS = 12


class Tabs:
    """Opens a campaign; it takes a second.

    Args:
        campaign: As it was read.
        machine: The model to begin with.
        threads: Tests that are worked on side by side.

    Raises:
        InputError: The traces show a mistake.
        SimulationError: The machine cannot be simulated.
    """

    def __init__(self, campaign: Campaign, machine: Machine, threads: int) -> None:
        self._live: OrderedDict[str, Live | RecordingsLive] = OrderedDict()
        self._bodies: MachineBodies | None = None
        self._meshes: dict[str, bytes] = {}
        self._lock = threading.Lock()
        self._shared = shared_of(campaign, machine, threads)
        if isinstance(self._shared, Shared) and has_model(machine.chain):
            self._bodies = MachineBodies(machine.chain)

    def build(self, tab: str, meshes: str, dark: bool) -> None:
        """Build the page of a tab in the present element.

        Args:
            tab: A reload of the page keeps the state that belongs to this name.
            meshes: Address of the folder with the machine's meshes.
            dark: Light on dark to begin with.
        """
        live = self._of(tab)
        if isinstance(live, RecordingsLive):
            RecordingsDesk(live, dark)
        else:
            Desk(live, meshes, self._bodies, dark)

    def mesh(self, name: str) -> bytes | None:
        """STL data of a part of the machine; ``None`` where there is no such part."""
        geoms = self._bodies.meshes.get(name) if self._bodies is not None else None
        if self._bodies is None or geoms is None:
            return None
        with self._lock:
            if name not in self._meshes:
                self._meshes[name] = stl_of(self._bodies.model, geoms)
            return self._meshes[name]

    def close(self) -> None:
        """End what goes on in the background."""
        for live in self._live.values():
            live.close()

    def _of(self, tab: str) -> Live | RecordingsLive:
        if tab not in self._live:
            bench = bench_of(self._shared)
            self._live[tab] = Live(bench) if isinstance(bench, Workbench) else RecordingsLive(bench)
        self._live.move_to_end(tab)
        while len(self._live) > _TABS:
            self._live.popitem(last=False)[1].close()
        return self._live[tab]
