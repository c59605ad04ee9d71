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
HEAD = Path(__file__).with_suffix(".md").read_text(encoding="utf-8")


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
