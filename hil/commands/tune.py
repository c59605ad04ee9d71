"""`uuv-hil tune`: find gains for a vehicle's controller from step responses in the simulator."""

from math import isnan

from hil.autonomy.control.controller import AxisGains, HoldGains
from hil.common.columns import aligned
from hil.common.errors import ConfigError
from hil.common.options import SEED, add_output, add_plot, new_parser
from hil.common.schema import find_preset
from hil.common.streams import ProgressLine
from hil.common.tables import read_table
from hil.plots.plotting import check_picture
from hil.tuning.picture import draw
from hil.tuning.search import Tuned, Tuner
from hil.tuning.step_response import AXES
from hil.tuning.tuned_file import write_tuned
from sim.vehicle.vehicle import load_vehicle

EXAMPLES = """\
Each axis that thrusters or fins drive gets a step input; lag and delay are identified from the response, and gains are
computed and flown. Gains that are no better than the present ones are not used. The table shows a step of each axis
before and after: its size, the rise time from 10 to 90 %, overshoot, settling time to 5 %, and the steady error.

examples:
  uuv-hil tune paper_six                               find better gains, and print them
  uuv-hil tune paper_six --axis surge --axis heading   only these
  uuv-hil tune vehicle.toml -o tuned.toml --plot steps.png
then, in a scenario: vehicle = "tuned.toml"
"""
HEADER = ("axis", "step", "", "rise", "overshoot", "settling", "steady error")


def main(arguments: list[str]) -> int:
    """Tune a controller and return the exit code. Raises HilError."""
    parser = new_parser("tune", __doc__, EXAMPLES)
    parser.add_argument("vehicle", metavar="VEHICLE", help="a preset, or a .toml file")
    parser.add_argument(
        "--axis",
        action="append",
        choices=list(AXES),
        help="axis to tune; repeatable [all that its thrusters and fins drive]",
    )
    parser.add_argument("--seed", type=SEED, default=1, metavar="N", help="seed of the sensors' noise [1]")
    add_output(parser, "FILE.toml", "the vehicle with the new gains")
    add_plot(parser, "draw the responses")
    options = parser.parse_args(arguments)
    _check_output(options.output)
    _check_vehicle(options.vehicle)
    if options.plot:
        check_picture(options.plot)
    vehicle, control = load_vehicle(options.vehicle)
    tuner = Tuner(options.vehicle, vehicle, control, options.seed)
    axes = options.axis or tuner.axes()
    line = ProgressLine()
    tuned = tuner.tune(axes, lambda axis: line.show(f"{axis} of {', '.join(axes)}"))
    line.clear()
    print("\n".join(filter(None, [report(tuned), "" if options.axis else tuner.untuned()])))
    note = "Gains (hil/autonomy/control/controller.py) found by step responses of this model: uuv-hil tune."
    if options.output:
        write_tuned(find_preset("sim/vehicles", options.vehicle), vehicle, tuner.gains, note, options.output)
        print(f"written: {options.output}")
    if options.plot:
        draw(f"{vehicle.name}: step responses", tuned, options.plot)
    return 0


def report(results: list[Tuned]) -> str:
    """Return the table of steps before and after, the identified processes, and the gains."""
    rows = [HEADER, *(row for tuned in results for row in _rows(tuned))]
    processes: list[tuple[str, ...]] = [("axis", "slope", "damping", "delay")]
    processes += [
        (tuned.axis, f"{slope:.2f}", f"{damping:.2f} 1/s", f"{delay * 1e3:.0f} ms")
        for tuned in results
        for slope, damping, delay in (tuned.process,)
    ]
    gains = [f"{key} = {{ {_gain(row)} }}" for tuned in results if tuned.better for key, row in tuned.gains.items()]
    proposal = ["[control]", *gains] if gains else ["no better gains found: the present gains stay"]
    return "\n".join([*aligned(rows), "", *aligned(processes), "", *proposal])


def _gain(row: AxisGains | HoldGains) -> str:
    return ", ".join(f"{name} = {getattr(row, name):g}" for name in ("p", "i", "limit") if name in row._fields)


def _rows(tuned: Tuned) -> list[tuple[str, ...]]:
    unit = AXES[tuned.axis].unit
    lines: list[tuple[str, ...]] = []
    for word, response in (("before", tuned.before), ("after" if tuned.better else "unchanged", tuned.after)):
        figures = response.figures()
        first = (tuned.axis, f"{response.size:.2f} {unit}") if word == "before" else ("", "")
        rest = (_seconds(figures.rise), f"{figures.overshoot:.1%}", _seconds(figures.settling))
        lines.append((*first, word, *rest, f"{figures.steady:+.3f} {unit}"))
    return lines


def _seconds(value: float) -> str:
    return "never" if isnan(value) else f"{value:.2f} s"


def _check_output(path: str | None) -> None:
    if path is not None and not path.endswith(".toml"):
        raise ConfigError(f"--output {path!r}: a vehicle's file ends in .toml")


def _check_vehicle(name: str) -> None:
    scenario = read_table(name) if name.endswith(".toml") else {}
    if "vehicle" in scenario:
        raise ConfigError(f"{name}: is a scenario, not a vehicle; its vehicle is {scenario['vehicle']!r}")
