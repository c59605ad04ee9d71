"""Open the autopilot of a scenario."""

from importlib.util import find_spec
from typing import TYPE_CHECKING

from hil.autopilots.contract import Autopilot, Report
from hil.autopilots.frames import AUTO, CUSTOM, map_motors
from hil.autopilots.inputs import HOME, SensorInputs
from hil.autopilots.motors import MotorOutputs
from hil.autopilots.parameters import Parameters, all_parameters
from hil.autopilots.start_options import start_hint
from hil.common.clock import seconds_ns
from hil.scenario.autopilot_records import COMPANION_PORT, STEP, AutopilotSettings
from hil.scenario.config import Scenario
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from hil.autopilots.companion import Companion
    from hil.autopilots.program import Program


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

        companion = _companion(scenario, vehicle, inputs, world, report)
        autopilot: Autopilot = ArduPilot(address, inputs, settings.lockstep, settings.rc, report, companion)
    else:
        from hil.autopilots.px4 import Px4

        frame = CUSTOM if frame == AUTO else frame  # PX4 gets the vehicle's own geometry as parameters
        autopilot = Px4(address, inputs, settings, report)
    try:
        motors = MotorOutputs(map_motors(frame, vehicle), seconds_ns(settings.silence), autopilot.name, report)
        if vehicle.accessories and scenario.controller == "ardupilot":
            from hil.autopilots.accessory_outputs import AccessoryOutputs

            started = all_parameters(settings, scenario.controller, vehicle, motors.map, scenario.sensors)
            motors.accessories = AccessoryOutputs(started)
    except BaseException:
        autopilot.close()
        raise
    return autopilot, motors


def _companion(
    scenario: Scenario, vehicle: Vehicle, inputs: SensorInputs, world: World, report: Report
) -> "Companion | None":
    settings = settings_of(scenario)
    if settings.positions == "simulated" and not find_spec("pymavlink"):  # nothing to send, only an estimate to read
        return None
    from hil.autopilots.companion import Companion

    port = COMPANION_PORT + STEP["ardupilot"] * settings.instance
    expected: Parameters = {}
    if not settings.program:
        motors = map_motors(settings.frame, vehicle)
        expected = all_parameters(settings, scenario.controller, vehicle, motors, scenario.sensors)
    return Companion(settings.positions, inputs, world.origin or HOME, port, report, expected)


def start_program(scenario: Scenario, vehicle: Vehicle, world: World, report: Report) -> "Program | None":
    """Start the autopilot's program if the scenario names one; it ends with this process. Raises ConfigError."""
    settings = settings_of(scenario)
    if not settings.program:
        report(f"waiting for the autopilot: {start_hint(scenario, settings, world)}, or name its [autopilot] program")
        return None
    from hil.autopilots.program import Program

    return Program(scenario, settings, vehicle, world, report)
