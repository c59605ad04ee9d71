"""`uuv-hil autopilot`: print motors and parameters of an autopilot, and test its link."""

from hil.autopilots.link_test import line_rate, measure_link
from hil.autopilots.parameters import format_parameters, scenario_parameters
from hil.autopilots.px4_files import encode_bson, format_for_qgroundcontrol
from hil.common.clock import NS_PER_MS
from hil.common.errors import ConfigError, DeviceError
from hil.common.options import Number, add_output, add_scenario, changes_of, new_parser
from hil.scenario.config import AUTOPILOTS, Scenario, load_single
from sim.vehicle.vehicle import Vehicle, load_vehicle

EXAMPLES = """\
`motors` prints which thruster each motor of the frame is, and where it pushes the vehicle. `link` exchanges states and
outputs with the autopilot, thrusters neutral, and measures losses, round trip, jitter and rate.
`parameters` prints the parameters that the autopilot needs for this vehicle: for ArduSub a .parm file, for PX4 the
.params file that QGroundControl loads. With -o FILE.bson it writes the file that `param import` of PX4 reads.

examples:
  uuv-hil autopilot motors ardusub
  uuv-hil autopilot link ardusub --seconds 20
  uuv-hil autopilot parameters px4_uuv -o bluerov2_heavy.params
"""
SLOW_MS = 10.0  # round trip beyond which an estimator of 250 Hz works with outdated values


def main(arguments: list[str]) -> int:
    """Print motors or parameters, or test the link; return the exit code."""
    parser = new_parser("autopilot", __doc__, EXAMPLES)
    parser.add_argument(
        "what", choices=("motors", "link", "parameters"), metavar="ACTION", help="motors, link or parameters; see below"
    )
    add_scenario(parser, None)
    parser.add_argument(
        "--seconds", type=Number(1.0, 3600.0, "s"), default=10.0, metavar="S", help="simulated time of a link test [10]"
    )
    add_output(parser, "FILE.params", "where to write the parameters; .bson for PX4's shell [the screen]")
    options = parser.parse_args(arguments)
    scenario = load_single(options.scenario, changes_of(options))
    if scenario.controller not in AUTOPILOTS:
        raise ConfigError(
            f"{scenario.path}: controller is {scenario.controller!r}, no autopilot: see `uuv-hil scenario show ardusub`"
        )
    vehicle, _ = load_vehicle(scenario.vehicle)
    if options.what == "motors":
        motors, _ = scenario_parameters(scenario, vehicle)
        print(f"{vehicle.name}, frame {motors.frame}", *motors.describe(vehicle), sep="\n  ")
        return 0
    if options.what == "link":
        return _link(scenario, options.seconds)
    return _parameters(scenario, vehicle, options.output)


def _link(scenario: Scenario, seconds: float) -> int:
    result = measure_link(scenario, seconds, lambda text: print(text, flush=True))
    print(f"states sent {result.states}, outputs {result.outputs}, lost {result.lost}, malformed {result.malformed}")
    trip = result.round_trip
    median, most, longest = (ns / NS_PER_MS for ns in (trip.quantile(0.5), trip.quantile(0.99), trip.maximum))
    print(
        f"round trip: median {median:.2f} ms, 99 % {most:.2f} ms, at most {longest:.2f} ms; "
        f"jitter {most - median:.2f} ms"
    )
    print(f"outputs {result.outputs / result.took_s:.0f} Hz, {result.simulated_s / result.took_s:.2f} times real time")
    if carried := line_rate(scenario):
        print(f"the line carries at most {carried:.0f} HIL_SENSOR a second")
    if not result.outputs:
        raise DeviceError(
            f"{scenario.path}: no outputs were received: the autopilot does not answer; start it, and let it reach "
            "the address of [autopilot]"
        )
    if median > SLOW_MS:
        print(f"WARNING: a round trip above {SLOW_MS:g} ms: the autopilot's estimator works with outdated values")
    return 0


def _parameters(scenario: Scenario, vehicle: Vehicle, output: str | None) -> int:
    _, parameters = scenario_parameters(scenario, vehicle)
    text = (format_for_qgroundcontrol if scenario.controller == "px4" else format_parameters)(parameters)
    if output is None:
        print(text, end="")
        return 0
    with open(output, "wb") as file:
        file.write(encode_bson(parameters) if output.endswith(".bson") else text.encode())
    return 0
