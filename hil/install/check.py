"""Check, before a service is installed, whether its slave would start as the service's user."""

import os
import pwd
import subprocess
import sys
from collections.abc import Sequence

from boards.tree import Tree
from hil.common.children import python_command
from hil.common.errors import ConfigError, HilError
from hil.common.tables import settings as settings_of
from hil.install.units import Service, python_path
from hil.network.settings import settings
from hil.scenario.config import Scenario, build_simulation, load_scenario
from hil.scenario.fleet import as_member
from hil.slave.imaging.sensors import Imaging
from hil.slave.pilot import build_pilot
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle

PRIVATE_FOLDERS = ("/tmp/", "/var/tmp/")  # the service has its own ones
CODE = "import sys; from hil.install.check import main; main(*sys.argv[1:])"


def load_slave_scenario(
    name: str, listen: str | None = None, member: str | None = None, changes: Sequence[str] = ()
) -> Scenario:
    """Return the scenario that the slave loads with these options. Raises HilError."""
    scenario = load_scenario(name, settings_of(changes, "--set"))
    if member or scenario.member:
        scenario = as_member(scenario, member or "")
    return scenario._replace(slave=scenario.slave._replace(listen=listen)) if listen else scenario


def assemble(scenario: Scenario) -> None:
    """Assemble a slave, without opening a device. Raises HilError."""
    router = scenario.network.router
    settings("slave", (scenario.slave.listen,), (router,) if router else (), scenario.network, scenario.security)
    if any(sensor.offloaded for sensor in scenario.sensors.values()):
        scenario = Imaging(scenario, print).scenario
    vehicle, control = load_vehicle(scenario.vehicle)
    world = load_world(scenario.world)
    build_simulation(scenario, vehicle, world)
    if scenario.controller == "builtin":
        build_pilot(scenario, vehicle, control, world)


def check(tree: Tree, service: Service) -> None:
    """Check that the service's slave would start here, apart from devices and network. Raises HilError.

    On another machine's files, only the scenario is checked.
    """
    if not tree.live:
        assemble(service.scenario)
        return
    for path in (service.scenario.path, service.scenario.vehicle, service.scenario.world):
        if path.endswith(".toml") and os.path.realpath(path).startswith(PRIVATE_FOLDERS):
            raise ConfigError(f"{path}: the service has a private /tmp and cannot read it; move it, such as to /opt")
    if os.geteuid() == 0:
        _check_as_user(service)
    else:
        assemble(service.scenario)


def _check_as_user(service: Service) -> None:
    entry = pwd.getpwnam(service.user)
    name = service.scenario_words[0]
    # The same XDG_CACHE_HOME as in the unit.
    environment = {"PATH": os.environ.get("PATH", ""), "PYTHONPATH": python_path(), "XDG_CACHE_HOME": "/var/cache"}
    arguments = python_command("-c", CODE, name, service.listen or "", service.member or "", *service.changes)
    try:
        completed = subprocess.run(
            arguments, user=entry.pw_uid, group=entry.pw_gid, extra_groups=os.getgrouplist(service.user, entry.pw_gid),
            cwd="/", env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
    except OSError as error:
        text = f"{service.user} may not execute it ({error.strerror}); install the project elsewhere, such as in /opt"
        raise ConfigError(f"{sys.executable}: {text}") from None
    if completed.returncode:
        last = (completed.stderr.strip() or f"exit code {completed.returncode}").splitlines()[-1]
        raise ConfigError(f"the slave would not start as {service.user}: {last}")


def main(name: str, listen: str, member: str, *changes: str) -> None:
    """Run the check in a process of the service's user; exit with the reason on standard error."""
    try:
        assemble(load_slave_scenario(name, listen, member, changes))
    except HilError as error:
        sys.exit(str(error))
