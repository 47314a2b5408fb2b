"""The open campaign and the browser tabs that show it, each with a state of its own."""

from __future__ import annotations

import threading
from collections import OrderedDict

from mjsim.campaign.model import Campaign
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.machine.bodies import has_model
from mjsim.machine.model import Machine
from mjsim.workbench.bodies import MachineBodies
from mjsim.workbench.live import Live
from mjsim.workbench.log_live import LogLive
from mjsim.workbench.log_state import LogBench, SharedLogs
from mjsim.workbench.opened import OpenCampaign
from mjsim.workbench.page.desk import Desk
from mjsim.workbench.page.log_desk import LogDesk
from mjsim.workbench.state import Workbench
from mjsim.workbench.tried import Shared

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
        self._live: OrderedDict[str, Live | LogLive] = OrderedDict()
        self._bodies: MachineBodies | None = None
        self._meshes: dict[str, bytes] = {}
        self._lock = threading.Lock()
        if set(campaign.measured_parts) == {LogTest.instrument}:
            self._shared: Shared | SharedLogs = SharedLogs(campaign, machine, threads)
            return
        self._shared = Shared(OpenCampaign.of(campaign, machine, threads))
        if has_model(machine.chain):
            self._bodies = MachineBodies(machine.chain)

    def build(self, tab: str, meshes: str, dark: bool) -> None:
        """Build the page of a tab in the present element.

        Args:
            tab: A reload of the page keeps the state that belongs to this name.
            meshes: Address of the folder with the machine's meshes.
            dark: Light on dark to begin with.
        """
        live = self._of(tab)
        if isinstance(live, LogLive):
            LogDesk(live, dark)
        else:
            Desk(live, meshes, self._bodies, dark)

    def mesh(self, name: str) -> bytes | None:
        """STL data of a part of the machine; ``None`` where there is no such part."""
        geoms = self._bodies.meshes.get(name) if self._bodies is not None else None
        if self._bodies is None or geoms is None:
            return None
        with self._lock:
            if name not in self._meshes:
                from mjsim.workbench.meshes import stl_of  # slow to load, and the traces come first

                self._meshes[name] = stl_of(self._bodies.model, geoms)
            return self._meshes[name]

    def close(self) -> None:
        """End what goes on in the background."""
        for live in self._live.values():
            live.close()

    def _of(self, tab: str) -> Live | LogLive:
        if tab not in self._live:
            shared = self._shared
            self._live[tab] = LogLive(LogBench(shared)) if isinstance(shared, SharedLogs) else Live(Workbench(shared))
        self._live.move_to_end(tab)
        while len(self._live) > _TABS:
            self._live.popitem(last=False)[1].close()
        return self._live[tab]
