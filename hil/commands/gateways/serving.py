"""The fleet, and all that its vehicles publish, for a gateway that shows both to other software."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import hil
from hil.client.fleet import Fleet
from hil.commands.listening import connect_arguments, network_of, presence
from hil.common.stop import StopSignals, is_stopped
from hil.recording.mcap_file import Message
from hil.recording.tap import Tap, save_resources

POLL_S = 0.02  # between two checks for messages


class Served(NamedTuple):
    """A fleet, the messages of its vehicles at `endpoints`, and the descriptor of a request to stop."""

    fleet: Fleet
    tap: Tap
    endpoints: list[str]
    stop_fd: int

    def forward(self, show: Callable[[list[Message]], None], has_ended: Callable[[], bool] = lambda: False) -> None:
        """Show what vehicles publish until a stop is requested; print the connected vehicles whenever they change."""
        names: list[str] | None = None
        while not has_ended() and not is_stopped(self.stop_fd, POLL_S):
            show(self.tap.receive())
            if self.fleet.names != names:
                names = self.fleet.names
                print(presence(names, self.endpoints), flush=True)


@contextmanager
def serve_fleet(options: Any) -> Iterator[Served]:
    """Provide the fleet of `add_fleet` and `add_take_over`. Raises ConfigError, NetworkError."""
    scenario, (endpoints, routed, keys) = connect_arguments(options)
    save_resources()
    with (
        StopSignals() as stop_fd,
        hil.connect(*endpoints, routed=routed, keys=keys, take_over=options.take_over) as fleet,
        Tap(endpoints, network_of(scenario)[0], fleet.security) as tap,
    ):
        yield Served(fleet, tap, endpoints, stop_fd)
