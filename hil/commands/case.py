"""`uuv-hil case`: repeat the reference platform's experiments, in the simulation and with slaves, and measure them."""

import os

from hil.cases import table
from hil.cases.case import CASES, find_case
from hil.cases.flights import fly_all
from hil.cases.report import Flights, write_report
from hil.commands.view.flights import FlightViewer
from hil.common.columns import paragraph
from hil.common.errors import MissingExtraError
from hil.common.options import JOBS, MAX_SEEDS, SEEDS, add_output, add_view, integer, new_parser
from hil.master.recorder import make_folder
from hil.recording.recorder import new_folder

HIL_SEEDS = integer(0, MAX_SEEDS)
EXAMPLES = f"""\
NAME is one of: {", ".join(CASES)}, or all.

Seed 1 is the case unchanged; other seeds change the noise, the start and the obstacles that are not in the map.
With --hil every vehicle is a `uuv-hil slave` in a process of its own with an emulated STM32, and this process is
the master, over the network. A flight then takes as long as its mission.

examples:
  uuv-hil case path_planning
  uuv-hil case path_planning_unknown --seeds 50
  uuv-hil case task_scheduling --hil                    one flight each, side by side
  uuv-hil case target_hunting --view                    a fleet in a browser
  uuv-hil case all --seeds 50 --hil 2 --output runs/all

DIR then contains report.md with its pictures, results.json, and a folder for every flight.
"""


def main(arguments: list[str]) -> int:
    """Fly a case; return 0 when every flight succeeded, else 6."""
    parser = new_parser("case", __doc__, EXAMPLES)
    parser.add_argument("name", metavar="NAME", help="the experiment, see below, or all")
    parser.add_argument(
        "--seeds", type=SEEDS, default=1, metavar="N", help="seeds 1 to N in the simulation [%(default)s]"
    )
    parser.add_argument(
        "--hil",
        type=HIL_SEEDS,
        nargs="?",
        const=1,
        default=0,
        metavar="N",
        help="also fly seeds 1 to N with slaves [1]",
    )
    parser.add_argument("--jobs", type=JOBS, default=-1, metavar="N", help="simulations at once [all cores]")
    add_view(parser, "show each flight in a browser, one after the other")
    add_output(parser, "DIR", "where to put the results [runs/NAME-TIME]")
    options = parser.parse_args(arguments)
    names = list(CASES) if options.name == "all" else [find_case(options.name).name]
    folder = make_folder(options.output) if options.output else new_folder(options.name)
    flights: Flights = {}
    seeds, hil_seeds = range(1, options.seeds + 1), range(1, options.hil + 1)
    viewer = FlightViewer() if options.view else None
    for name in names:
        flights[name] = fly_all(name, folder, seeds, hil_seeds, options.jobs, viewer)
    return _report(flights, folder)


def _report(flights: Flights, folder: str) -> int:
    results = [run.result for runs in flights.values() for run in runs]
    table.write_json(os.path.join(folder, "results.json"), results)
    print(table.render(results))
    try:
        write_report(os.path.join(folder, "report.md"), flights, folder)
    except MissingExtraError as error:
        print(f"no report: {error}")
    print(paragraph(f"results in {folder}/: {', '.join(sorted(n for n in os.listdir(folder) if '.' in n))}"))
    return 0 if all(result.success for result in results) else 6
