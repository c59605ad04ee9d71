"""The live view of flights: of `sim`, and of a case."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from hil.cases.viewer import Viewer
from hil.commands.view.opening import ANY_PORT, new_token, open_view, scene_content, view_process
from hil.scenario.config import Scenario
from hil.scenario.fleet import endpoints_of
from hil.view.sources.simulated import SimulatedSource

if TYPE_CHECKING:
    from hil.view.sources.simulated import SimulatedVehicle


class FlightViewer(Viewer):
    """Shows each flight in a view of its own, and prints where to watch it.

    Simulated flights share one address and one token, so that an open page shows the next flight too.
    """

    def __init__(self) -> None:
        self._token = new_token()
        self._address = ANY_PORT

    @contextmanager
    def show_simulated(
        self, scenario: Scenario, vehicles: "Mapping[str, SimulatedVehicle]"
    ) -> Iterator[Callable[[Any], None]]:
        """Show a flight that the view paces: it can be paused, stepped and sped up."""
        source = SimulatedSource(vehicles)
        with open_view(source, scene_content(scenario), self._address, token=self._token) as view:
            self._address = self._address[0], view.port
            yield source.pace(view.update, time.sleep)

    @contextmanager
    def show_slaves(self, scenario: Scenario) -> Iterator[None]:
        """Show a flight over the network, from a process of its own."""
        with view_process([scenario.path], endpoints_of(scenario), True):
            yield
