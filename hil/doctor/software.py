"""Check the installation: packages, start, processor time of a step, and permitted scheduling."""

import json
import os
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import metadata
from importlib.util import find_spec

from boards.tree import Tree
from hil.common import __version__
from hil.common.children import python_command
from hil.common.clock import LOOP_PRIORITY
from hil.common.errors import ConfigError, HilError, MissingExtraError, NetworkError
from hil.doctor.findings import Case, Finding, Level, User, permits, realtime_remedy, user_prefix
from hil.install.check import assemble
from hil.install.units import UNIT
from hil.links.contract import PWM_NEUTRAL_US
from hil.scenario.attitude_warning import attitude_warning
from hil.scenario.config import Scenario, build_simulation
from hil.scenario.fleet import as_member
from hil.scenario.records import Recording

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
# name, distribution, purpose, argument of pip install
LIBRARIES = (
    ("zenoh", "eclipse-zenoh", "the network between slave and master", "eclipse-zenoh"),
    ("pyserial", "pyserial", "serial ports", "pyserial"),
    ("numpy", "numpy", "the master's maps", "'uuv-hil[master]'"),
)
# The same for packages that a value in a scenario requires.
REQUIRED_BY_VALUE = {
    "mavlink": ("pymavlink", "pymavlink", "[link] protocol", "'uuv-hil[mavlink]'"),
    "unicorn": ("unicorn", "unicorn", "the scenario's stm32", "'uuv-hil[unicorn]'"),
}
# C extensions besides that of the step
EXTENSIONS = ("sim.native._rays", "sim.native._picture", "hil.slave.native._firmware")
WARM_UP, STEPS = 40, 400


def check_packages(case: Case) -> Iterator[Finding]:
    """Return findings about this installation and the packages that a run needs."""
    yield Finding("ok", "uuv-hil", f"{__version__}, {ROOT}")
    yield Finding("ok", "Python", f"{platform.python_version()}, {sys.executable}")
    for name, distribution, purpose, package in LIBRARIES:
        needed: Level = case.severity if name == "zenoh" or (name == "pyserial" and case.device) else "note"
        yield check_library(name, distribution, purpose, package, needed)
    values = (case.scenario.link.protocol, case.scenario.stm32) if case.scenario else ()
    for value in values:
        if value in REQUIRED_BY_VALUE:
            yield check_library(*REQUIRED_BY_VALUE[value], case.severity)
    if case.scenario:
        yield from check_start(case.scenario, case.user)


def check_start(scenario: Scenario, user: User) -> Iterator[Finding]:
    """Check whether the slave would start, could record as `user`, and the planner would find a path."""
    checks: tuple[tuple[str, Callable[[], object]], ...] = (
        ("slave", lambda: _assemble(scenario)),
        ("link", lambda: _open_protocols(scenario)),
        ("recording", lambda: _require_disk_space(scenario.recording, user)),
        ("planner", lambda: _plan_path(scenario)),
    )
    reported = set()
    for topic, check in checks:
        fault = _fault(topic, check, scenario.path)
        if fault and fault.text not in reported:
            reported.add(fault.text)
            yield fault
    if not reported:
        yield Finding("ok", "start", f"the slave would start with {scenario.path}")
        warning = attitude_warning(scenario)
        if warning:
            yield Finding("note", "attitude", warning)


def _fault(topic: str, check: Callable[[], object], path: str) -> Finding | None:
    """Return the error that `check` raises as a problem with its remedy; None if it raises nothing."""
    try:
        check()
    except (NetworkError, MissingExtraError) as error:  # these name the remedy
        return Finding("problem", topic, str(error))
    except HilError as error:
        return Finding("problem", topic, str(error), f"correct it in {path}")
    except Exception as error:  # noqa: BLE001 - a user's class may raise anything
        return Finding(
            "problem",
            topic,
            f"{type(error).__name__}: {error}",
            f"correct it in {path}, or in a file or class that it names",
        )
    return None


def _assemble(scenario: Scenario) -> None:
    """Assemble all slaves, except their devices. Raises HilError if one would not start."""
    for each in [as_member(scenario, member.node) for member in scenario.member] or [scenario]:
        assemble(each)


def _open_protocols(scenario: Scenario) -> None:
    """Open the ends of the link that run here. Raises ConfigError or MissingExtraError."""
    from hil.links.protocols import Role
    from hil.slave.drivers.ends import end_protocol
    from sim.vehicle.vehicle import load_vehicle

    vehicle, _ = load_vehicle(scenario.vehicle)
    roles: tuple[Role, ...] = ("host", "device") if scenario.stm32 in ("python", "process") else ("host",)
    for role in roles:
        end_protocol(scenario.link, role, len(vehicle.channels))


def _require_disk_space(recording: Recording, user: User) -> None:
    """Check that the slave can write its recording, if it makes one. Raises ConfigError or MissingExtraError."""
    if not recording.slave:
        return
    from hil.recording.mcap_writer import require_library

    require_library()
    folder = existing = os.path.abspath(recording.folder)
    while not os.path.lexists(existing):
        existing = os.path.dirname(existing)
    where = f"[recording] folder {folder}"
    if not os.path.isdir(existing):
        raise ConfigError(f"{where} cannot be created: {existing} is not a folder")
    if not may_write(existing, user):
        raise ConfigError(f"{where} cannot be written: no permission for {user.name} in {existing}")
    disk = os.statvfs(existing)
    free = disk.f_bavail * disk.f_frsize / 2**20
    if free < recording.keep_free:
        raise ConfigError(f"{where} has {free:.0f} MiB free, but keep_free is {recording.keep_free:g} MiB")


def may_write(folder: str, user: User) -> bool:
    """Return whether `user` may make files in a folder. For another user the folder's mode decides; root always may."""
    if user.uid in (0, os.getuid()):
        return os.access(folder, os.W_OK | os.X_OK)
    return permits(os.stat(folder), user, 3)


def _plan_path(scenario: Scenario) -> None:
    """Plan the mission's path, if numpy is installed for a master. Raises HilError if there is no path."""
    has_mission = scenario.planner or scenario.master.goal  # otherwise a Python program or ROS commands the vehicle
    if not has_mission or scenario.member or scenario.controller == "external" or find_spec("numpy") is None:
        return
    from hil.master.flight import prepare

    prepare(scenario)


def check_step(case: Case) -> Iterator[Finding]:
    """Report whether the step of the dynamics runs in C or Python and why, and its processor time for a scenario."""
    from sim.native import COMPILE_AGAIN, REMEDY, SWITCH, NativeDynamics, StaleExtensionError, choose, load

    try:
        dynamics, text = choose()
    except StaleExtensionError as error:
        yield Finding(case.severity, "step", str(error), COMPILE_AGAIN)
        return
    except ConfigError as error:  # the variable is invalid, or requires an extension that is not installed
        yield Finding(case.severity, "step", str(error), f"unset {SWITCH}")
        return
    if dynamics is NativeDynamics:
        yield Finding("ok", "step", text)
    else:
        is_switched_off = os.environ.get(SWITCH) == "0"
        yield Finding("note", "step", text, f"unset {SWITCH}" if is_switched_off else REMEDY)
    for name in EXTENSIONS:
        topic = name.rpartition("._")[2]
        try:
            load(name)
        except StaleExtensionError as error:
            yield Finding(case.severity, topic, str(error), COMPILE_AGAIN)
        except ImportError as error:
            yield Finding("note", topic, f"Python; the C extension is not installed: {error}", REMEDY)
    if scenario := case.scenario:
        share = case.board.recommended.core_share if case.board else 0.5
        try:
            yield check_step_cost(scenario, share)
        except HilError:  # `check_start` has reported it
            return
        except Exception as error:  # noqa: BLE001 - a user's sensor may raise anything
            text = f"a step failed: {type(error).__name__}: {error}"
            yield Finding("problem", "step", text, "correct the sensor or force that raised it")


def check_step_cost(scenario: Scenario, allowed: float) -> Finding:
    """Return the simulation's share of a core on this machine, compared with the allowed share (0..1)."""
    cost, period = measure_step_s(scenario), scenario.slave.step
    text = f"{cost * 1e6:.0f} µs of every {period * 1e6:.0f} µs, {cost / period:.1%} of a core"
    if cost < allowed * period:
        return Finding("ok", "step cost", text)
    remedy = "use a longer [slave] step, or fewer sensors"
    return Finding("problem", "step cost", f"{text}; at most {allowed:.0%} is recommended", remedy)


def check_library(name: str, distribution: str, purpose: str, package: str, needed: Level) -> Finding:
    """Return the version of an installed distribution, or how to install it."""
    try:
        return Finding("ok", name, metadata.version(distribution))
    except metadata.PackageNotFoundError:
        return Finding(needed, name, f"not installed; needed for {purpose}", f"pip install {package}")


def check_scheduling(case: Case) -> Iterator[Finding]:
    """Report the scheduling and locked memory that a process of the slave's user gets."""
    if case.scenario and not case.scenario.slave.realtime:
        return
    prefix = user_prefix(case.user)
    if prefix is None:
        remedy = f"run the same command with sudo and --user {case.user.name}"
        yield Finding("note", "scheduling", f"that of {case.user.name} cannot be determined", remedy)
        return
    request = f"[clock.schedule_fifo({LOOP_PRIORITY}), clock.lock_memory()]"
    code = f"import json; from hil.common import clock; print(json.dumps({request}))"
    environment = os.environ | {"PYTHONPATH": ROOT}
    try:
        command = [*prefix, *python_command("-c", code)]
        output = subprocess.run(command, capture_output=True, text=True, check=False, env=environment).stdout
    except OSError:  # no runuser, or an emulator that cannot start another program
        output = ""
    if not output:
        text = f"cannot be determined: {case.user.name} cannot start {sys.executable}"
        yield Finding("note", "scheduling", text, f"see: {shlex.join([*prefix, sys.executable, '-V'])}")
        return
    for is_granted, text in json.loads(output):
        topic, _, result = text.partition(": ")
        if is_granted:
            yield Finding("ok", topic, result)
        elif topic == "scheduling" and f"LimitRTPRIO={LOOP_PRIORITY}" in _unit_of(case.user, case.tree):
            yield Finding("note", topic, f"{result}; as the installed service it is", realtime_remedy(case))
        else:
            yield Finding(case.severity if topic == "scheduling" else "note", topic, result, realtime_remedy(case))


def _unit_of(user: User, tree: Tree) -> list[str]:
    """Return the lines of the installed unit; none if it is not this user's."""
    lines = tree.text(UNIT).splitlines()
    return lines if f"User={user.name}" in lines else []


def measure_step_s(scenario: Scenario) -> float:
    """Return the processor time (s) of one step of the scenario's simulation on this machine, after its start."""
    from sim.environment.world import load_world
    from sim.vehicle.vehicle import load_vehicle

    vehicle, _ = load_vehicle(scenario.vehicle)
    simulation = build_simulation(scenario, vehicle, load_world(scenario.world))
    pwm_us = (PWM_NEUTRAL_US,) * len(vehicle.channels)
    for _ in range(WARM_UP):
        simulation.step(pwm_us)
    start = time.process_time()  # psutil reports it in steps of 10 ms only
    for _ in range(STEPS):
        simulation.step(pwm_us)
    return (time.process_time() - start) / STEPS
