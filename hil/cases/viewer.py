"""Interface for a live view of the flights of a case."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

from hil.scenario.config import Scenario

if TYPE_CHECKING:
    from hil.cases.simulated import SimulatedVehicle


class Viewer:
    """Base that shows nothing. A command that shows flights sets a derived viewer in the case."""

    def show_simulated(
        self, _scenario: Scenario, _vehicles: "Mapping[str, SimulatedVehicle]"
    ) -> AbstractContextManager[Callable[[Any], None]]:
        """Return a context that shows the vehicles (by name) of a simulated flight.

        It yields the function to call after each step.
        """
        return nullcontext(lambda _: None)

    def show_slaves(self, _scenario: Scenario) -> AbstractContextManager[None]:
        """Return a context that shows the slaves of a flight, which listen at the endpoints of the scenario."""
        return nullcontext()
