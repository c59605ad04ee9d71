"""The live view as a part of commands: the content from a scenario, and the address."""

import os
import secrets
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from hil.commands.view.tls import is_local
from hil.common.children import module_command, package_environment, start_child
from hil.common.errors import HilError, NetworkError
from hil.scenario.config import Scenario
from hil.scenario.fleet import hunt_plan
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle

if TYPE_CHECKING:
    from ssl import SSLContext

    from hil.view.live_view import LiveView
    from hil.view.scene.content import Hunt, SceneContent
    from hil.view.sources.source import Source

ANY_PORT = "127.0.0.1", 0  # for the view of another command: several can run at once
UNENCRYPTED = (
    "the view listens beyond this machine without encryption: anyone who reads this network's traffic gets "
    "the token, and can command the vehicle; give --cert and --key, or a scenario with [security]"
)


def new_token() -> str:
    """Return a random token."""
    return secrets.token_urlsafe(18)


@contextmanager
def open_view(
    source: "Source",
    content: "SceneContent",
    listen_at: tuple[str, int] = ANY_PORT,
    browser: bool = True,
    token: str = "",
    tls: "SSLContext | None" = None,
) -> Iterator["LiveView"]:
    """Serve a live view at `listen_at` (host, port), print its address, and open it in a browser if there is a screen.

    A browser needs `token`; by default it is a new one. A page beyond this machine without `tls` is not encrypted:
    this is reported. Raises NetworkError, MissingExtraError.
    """
    from hil.view.live_view import LiveView

    host, port = listen_at
    token = token or new_token()
    with LiveView(source, content, host, port, token, tls) as view:
        seen = "127.0.0.1" if host in ("0.0.0.0", "::") else host
        address = f"{'https' if tls else 'http'}://{seen}:{view.port}/?token={token}"
        if tls is None and not is_local(host):
            print(f"WARNING: {UNENCRYPTED}", file=sys.stderr, flush=True)
        print(f"watch at {address}", flush=True)
        if browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            import webbrowser

            webbrowser.open(address)
        yield view


def scene_content(scenario: Scenario | None) -> "SceneContent":
    """Return the world, the shapes and the planned path of a scenario. Raises ConfigError."""
    from hil.view.scene.content import SceneContent

    if scenario is None:
        return SceneContent()
    shown = {member.node: member.vehicle or scenario.vehicle for member in scenario.member}
    vehicles = {
        node: load_vehicle(name)[0] for node, name in (shown or {scenario.slave.node: scenario.vehicle}).items()
    }
    path: Sequence[Sequence[float]] = ()
    goal = None
    if not scenario.member:
        goal = scenario.master.goal
        try:
            from hil.master.flight import prepare

            path = prepare(scenario).planner.path
        except HilError as error:  # without a plan, the view has no path
            print(f"no path is shown: {error}", file=sys.stderr, flush=True)
    depth = scenario.master.depth
    world, sensors = load_world(scenario.world), scenario.sensors
    return SceneContent(world, vehicles, tuple(path), depth, goal, sensors, _hunt_of(scenario))


def _hunt_of(scenario: Scenario) -> "Hunt | None":
    """Return the hunt of a fleet, for the view; None without one."""
    if scenario.hunting is None:
        return None
    from hil.view.scene.content import Hunt

    nodes = tuple([member.node for member in scenario.member])
    reach = scenario.hunting.fields.communication_range
    return Hunt(nodes, hunt_plan(scenario), reach, scenario.master.depth)


@contextmanager
def view_process(scenario: Sequence[str], endpoints: Sequence[str], is_enabled: bool) -> Iterator[None]:
    """Serve a view of the slaves at `endpoints` in a process of its own, if `is_enabled`.

    It prints the address when the view is ready. `scenario` are the words of a command that name it. Raises
    NetworkError when the view cannot start.
    """
    if not is_enabled:
        yield
        return
    connections = [word for endpoint in endpoints for word in ("--connect", endpoint)]
    command = module_command("hil.cli", "view", "--scenario", *scenario, *connections, "--listen", "127.0.0.1:0")
    process = start_child(command, environment=package_environment(), stdout=subprocess.PIPE, text=True)
    assert process.stdout
    try:
        line = process.stdout.readline()
        if not line:
            raise NetworkError(f"the view ended with exit code {process.wait()}; leave out --view to run without it")
        print(line, end="", flush=True)
        yield
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()
