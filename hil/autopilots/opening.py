"""Open the autopilot of a scenario."""

import os
from math import degrees
from typing import TYPE_CHECKING

from hil.autopilots.contract import Autopilot, Report
from hil.autopilots.frames import AUTO, CUSTOM, map_motors
from hil.autopilots.inputs import HOME, SensorInputs
from hil.autopilots.motors import MotorOutputs
from hil.common.clock import seconds_ns
from hil.links.address import parse_address
from hil.scenario.autopilot_records import COMPANION_PORT, STEP, AutopilotSettings
from hil.scenario.config import Scenario
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from hil.autopilots.companion import Companion
    from hil.autopilots.program import Program

SPEEDUP = 100  # faster than any run: this process sets the simulation time, the program waits for it


def settings_of(scenario: Scenario) -> AutopilotSettings:
    """Return the section [autopilot] of a scenario, or the defaults."""
    return scenario.autopilot or AutopilotSettings()


def open_autopilot(
    scenario: Scenario, vehicle: Vehicle, world: World, report: Report
) -> tuple[Autopilot, MotorOutputs]:
    """Return the scenario's autopilot, opened, and the converter of its outputs to pulse widths.

    Raises ConfigError, DeviceError, MissingExtraError.
    """
    settings, inputs = settings_of(scenario), SensorInputs(scenario, world)
    address = settings.own_address(scenario.controller)
    frame = settings.frame
    if scenario.controller == "ardupilot":
        from hil.autopilots.ardupilot import ArduPilot

        companion = _companion(settings, inputs, world, report)
        autopilot: Autopilot = ArduPilot(address, inputs, settings.lockstep, settings.rc, report, companion)
    else:
        from hil.autopilots.px4 import Px4

        frame = CUSTOM if frame == AUTO else frame  # PX4 gets the vehicle's own geometry as parameters
        autopilot = Px4(address, inputs, settings, report)
    try:
        motors = MotorOutputs(map_motors(frame, vehicle), seconds_ns(settings.silence), autopilot.name, report)
    except BaseException:
        autopilot.close()
        raise
    return autopilot, motors


def _companion(settings: AutopilotSettings, inputs: SensorInputs, world: World, report: Report) -> "Companion | None":
    if settings.positions == "simulated":
        return None
    from hil.autopilots.companion import Companion

    port = COMPANION_PORT + STEP["ardupilot"] * settings.instance
    return Companion(settings.positions, inputs, world.origin or HOME, port, report)


def ardusub_options(scenario: Scenario, world: World) -> list[str]:
    """Return the options of ArduSub's SITL program, without its file of parameters.

    Without --home it would start 584 m above the sea, and hold its depth by a pressure that is not that of water.
    """
    settings = settings_of(scenario)
    address = parse_address(settings.own_address("ardupilot"))
    latitude, longitude = world.origin or HOME
    home = f"{latitude:.7f},{longitude:.7f},0,{degrees(scenario.start.heading):.1f}"
    own = ["--model", f"JSON:{address.target}", "--speedup", str(SPEEDUP), "-I", str(settings.instance)]
    own += ["--serial0", "tcp:0"]  # the default port, but without waiting for a connection
    return [*own, "--sim-port-out", str(address.port), "--home", home]


def start_hint(scenario: Scenario, world: World) -> str:
    """Return what a person does who starts the autopilot without us: for ArduSub its whole command."""
    if scenario.controller != "ardupilot":
        return "start PX4's SITL for an underwater vehicle, with -i N for [autopilot] instance = N"
    name = os.path.splitext(os.path.basename(scenario.path))[0]
    return (
        f"start ArduSub with these options: {' '.join(ardusub_options(scenario, world))} --defaults {name}.parm; "
        f"the file is written by `uuv-hil autopilot parameters {scenario.path} > {name}.parm`"
    )


def start_program(scenario: Scenario, vehicle: Vehicle, world: World, report: Report) -> "Program | None":
    """Start the autopilot's program if the scenario names one; it ends with this process. Raises ConfigError."""
    settings = settings_of(scenario)
    if not settings.program:
        report(f"waiting for the autopilot: {start_hint(scenario, world)}, or name its [autopilot] program")
        return None
    from hil.autopilots.program import Program

    return Program(scenario, settings, vehicle, world, report)
