"""The live view as a part of commands: what it shows of a scenario, and where to watch it."""

import os
import secrets
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from hil.common.children import module_command, package_environment, start_child
from hil.common.errors import HilError, NetworkError
from hil.scenario.config import Scenario

if TYPE_CHECKING:
    from hil.view.live_view import LiveView, Shown
    from hil.view.sources.source import Source

DEFAULT_PLACE = "127.0.0.1", 7480


@contextmanager
def open_view(
    source: "Source", shown: "Shown", place: tuple[str, int] = DEFAULT_PLACE, browser: bool = True
) -> Iterator["LiveView"]:
    """Serve a live view at `place` (host, port), print its address, and open it in a browser if there is a screen.

    Raises NetworkError, MissingExtraError.
    """
    from hil.view.live_view import LiveView

    host, port = place
    token = secrets.token_urlsafe(18)
    with LiveView(source, shown, host, port, token) as view:
        seen = "127.0.0.1" if host in ("0.0.0.0", "::") else host
        address = f"http://{seen}:{view.port}/?token={token}"
        print(f"watch at {address}", flush=True)
        if browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            import webbrowser

            webbrowser.open(address)
        yield view


def shown_of(scenario: Scenario | None) -> "Shown":
    """Return the world, the shapes and the planned path of a scenario. Raises ConfigError."""
    from hil.view.live_view import Shown
    from sim.environment.world import load_world
    from sim.vehicle.vehicle import load_vehicle

    if scenario is None:
        return Shown()
    vehicle = load_vehicle(scenario.vehicle)[0]
    vehicles = dict.fromkeys([member.node for member in scenario.member] or [scenario.slave.node], vehicle)
    path: Sequence[Sequence[float]] = ()
    goal = None
    if not scenario.member:
        goal = scenario.master.goal
        try:
            from hil.master.flight import prepare

            path = prepare(scenario).planner.path
        except HilError as error:  # what cannot be planned is shown without a path
            print(f"no path is shown: {error}", file=sys.stderr, flush=True)
    return Shown(load_world(scenario.world), vehicles, tuple(path), scenario.master.depth, goal)


@contextmanager
def view_process(scenario: Sequence[str], endpoint: str, wanted: bool) -> Iterator[None]:
    """Serve a view of a slave in a process of its own, if it is `wanted`; print where to watch once it can be.

    `scenario` are the words of a command that name it. Raises NetworkError when the view cannot start.
    """
    if not wanted:
        yield
        return
    command = module_command(
        "hil.cli", "view", "--scenario", *scenario, "--connect", endpoint, "--listen", "127.0.0.1:0"
    )
    process = start_child(command, environment=package_environment(), stdout=subprocess.PIPE, text=True)
    assert process.stdout
    try:
        line = process.stdout.readline()
        if not line:
            raise NetworkError(f"the view ended with exit code {process.wait()}; leave out --view to go on without it")
        print(line, end="", flush=True)
        yield
    finally:
        process.terminate()
        process.wait()
