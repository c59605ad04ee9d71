"""Live view of the flights of a case."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

from hil.scenario.config import Scenario

if TYPE_CHECKING:
    from hil.cases.simulated import SimulatedVehicle


class Viewer:
    """Base that shows nothing; a command that shows flights gives a case a viewer derived from it."""

    def show_simulated(
        self, _scenario: Scenario, _vehicles: "Mapping[str, SimulatedVehicle]"
    ) -> AbstractContextManager[Callable[[Any], None]]:
        """Show `_vehicles`, by name, of a simulated flight; return the function to call after each of its steps."""
        return nullcontext(lambda _: None)

    def show_slaves(self, _scenario: Scenario) -> AbstractContextManager[None]:
        """Show the slaves of a flight over the network: where they listen by its scenario."""
        return nullcontext()
