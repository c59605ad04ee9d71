"""Fly the reference platform's cases and write docs/reference/cases.md with its pictures.

    python tools/pages/cases.py [--out docs/reference] [--seeds 50] [--hil 1] [--only NAME ...]

Each set of HIL flights takes about ten minutes, and the simulated flights some minutes. Run nothing else meanwhile:
otherwise the figures of processor time and delay are those of a busy machine.
Needs the packages of `pip install -e '.[dev]'`.
"""

import argparse
import os
import sys
import tempfile
from pathlib import Path

import psutil
from PIL import Image

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.cases import table  # noqa: E402 - works from a bare checkout too
from hil.cases.case import CASES  # noqa: E402
from hil.cases.flights import fly_all  # noqa: E402
from hil.cases.report import Flights, write_report  # noqa: E402

COLOURS = 64
HEAD = """\
# The reference platform's cases, flown again

`python tools/pages/cases.py` makes this page. It flies each case of the reference platform (Zhang et al. 2022):

- SIL, software in the loop: {seeds} seeds, in one process and in simulated time;
- HIL, as with real hardware: {hil} of the seeds, with slaves and masters as processes that communicate over zenoh. Each
  slave has an emulated STM32.

`uuv-hil case NAME` flies one case.

Both fly the same code and read the same files. Seed 1 is the scenario file unchanged. Other seeds change the noise, the
start, and those obstacles that are not in the map. The paper gives neither the positions of obstacles nor the durations
of tasks: ours are in the scenario files. [The reference platform](../explanation/reference_platform.md) compares each
equation.

| Row | Meaning |
| --- | --- |
| collisions | flights in which the distance to an obstacle was at most the vehicle's radius ({radius:.2f} m), or in \
which the hull touched something |
| over optimum | length of the true path divided by that of the shortest for a vehicle of this size, without a \
safety margin |
| energy | electrical energy of the thrusters, without electronics. It is computed from the pulse widths, as for \
T200 thrusters of the same thrust at 16 V, because the paper gives no power. In HIL the pulse widths are those of \
the telemetry at 1 Hz |
| off path | true distance from the path; in target hunting from the assigned place in the formation |
| least clearance | least distance from the vehicle's centre to an obstacle; in target hunting to the hull of \
another vehicle or to the target |
| master CPU | processor time of the master's process during the flight, as a share of one core; in target hunting \
of all four agents together |
| delay | from publishing a command to applying its pulse widths at the STM32 end |

Rows with ± give the mean and the standard deviation. The other rows give the worst flight.

The HIL figures are from {cores} cores of a shared x86-64 server with {ram:.0f} GiB. Master and slaves all ran on it
and communicated over loopback. So these figures do not apply to a board or a wireless network."""


def main() -> int:
    """Fly the cases, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", metavar="DIR", default=str(ROOT / "docs" / "reference"))
    parser.add_argument("--seeds", type=int, metavar="N", default=50)
    parser.add_argument("--hil", type=int, metavar="N", default=1)
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=list(CASES), default=list(CASES))
    options = parser.parse_args()
    flights: Flights = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in options.only:
            flights[name] = fly_all(name, folder, range(1, options.seeds + 1), range(1, options.hil + 1))
            print(table.render([run.result for run in flights[name]]) + "\n", flush=True)
        pictures = os.path.join(options.out, "cases")
        files = write_report(
            os.path.join(options.out, "cases.md"), flights, pictures, page_head(options.seeds, options.hil)
        )
    for path in files[1:]:
        Image.open(path).convert("RGB").quantize(COLOURS).save(path, optimize=True)
    print(f"wrote {files[0]} and {len(files) - 1} pictures")
    return 0


def page_head(seeds: int, hil: int) -> str:
    """Return the text above the table."""
    from hil.cases.single import radius_of
    from sim.vehicle.vehicle import load_vehicle

    radius = radius_of(load_vehicle("paper_six")[0])
    return HEAD.format(
        seeds=seeds, hil=hil, radius=radius, cores=os.cpu_count(), ram=psutil.virtual_memory().total / 2**30
    )


if __name__ == "__main__":
    sys.exit(main())
