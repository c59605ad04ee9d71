"""Open the autopilot of a scenario."""

from importlib.util import find_spec
from typing import TYPE_CHECKING

from hil.autopilots.contract import Autopilot, Report
from hil.autopilots.inputs import HOME, SensorInputs
from hil.autopilots.motors import MotorOutputs
from hil.autopilots.parameters import Parameters, scenario_parameters
from hil.autopilots.start_options import start_hint
from hil.common.clock import seconds_ns
from hil.scenario.autopilot_records import COMPANION_PORT, STEP, AutopilotSettings
from hil.scenario.config import Scenario
from sim.environment.world import World
from sim.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from hil.autopilots.accessory_outputs import AccessoryOutputs
    from hil.autopilots.parameter_reader import ParameterReader
    from hil.autopilots.program import Program

REMEDIES = {
    "ardupilot": "start it with the --serial5 tcp:5 --defaults FILE of docs/how-to/ardusub.md; `uuv-hil autopilot "
    "parameters SCENARIO > FILE` writes the file",
    "px4": "load the file that `uuv-hil autopilot parameters SCENARIO -o FILE.params` writes, and start PX4 again: "
    "docs/how-to/px4.md",
}  # fmt: skip


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
    motor_map, parameters = scenario_parameters(scenario, vehicle)
    accessories = None
    if vehicle.accessories:
        from hil.autopilots.accessory_outputs import AccessoryOutputs

        accessories = AccessoryOutputs(parameters)
    address = settings.own_address(scenario.controller)
    if scenario.controller == "ardupilot":
        from hil.autopilots.ardupilot import ArduPilot

        companion = None
        if settings.positions != "simulated" or find_spec("pymavlink"):  # without it there is only less to know
            from hil.autopilots.companion import Companion

            port = COMPANION_PORT + STEP["ardupilot"] * settings.instance
            reader = _reader(scenario, parameters, accessories, report)
            companion = Companion(settings.positions, inputs, world.origin or HOME, port, report, reader)
        autopilot: Autopilot = ArduPilot(address, inputs, settings.lockstep, report, companion)
    else:
        from hil.autopilots.px4 import Px4

        autopilot = Px4(address, inputs, settings, report, _reader(scenario, parameters, accessories, report))
    motors = MotorOutputs(motor_map, seconds_ns(settings.silence), autopilot.name, report)
    motors.accessories = accessories
    return autopilot, motors


def _reader(
    scenario: Scenario, parameters: Parameters, accessories: "AccessoryOutputs | None", report: Report
) -> "ParameterReader":
    """Return the reader of the autopilot's parameters, which compares those of one that somebody else has started."""
    from hil.autopilots.parameter_reader import ParameterReader

    expected = {} if settings_of(scenario).program else parameters
    reader = ParameterReader(scenario.controller, expected, REMEDIES[scenario.controller], report)
    if accessories:
        reader.follow(accessories.names, accessories.set_parameter)
    return reader


def start_program(scenario: Scenario, vehicle: Vehicle, world: World, report: Report) -> "Program | None":
    """Start the autopilot's program if the scenario names one; it ends with this process. Raises ConfigError."""
    settings = settings_of(scenario)
    if not settings.program:
        report(f"waiting for the autopilot: {start_hint(scenario, settings, world)}, or name its [autopilot] program")
        return None
    from hil.autopilots.program import Program

    return Program(scenario, settings, vehicle, world, report)
