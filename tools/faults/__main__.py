"""The fault campaign: faults of link, process, network, clock, disk, memory, peer and file, against real processes.

    python -m tools.faults --quick                      a selection, 20 s
    python -m tools.faults --output build/faults        faults.json, faults.md
    python -m tools.faults --all                        on the emulated STM32s too
    python -m tools.faults --select "unplugged|noise"   rows whose name "ROOM FAULT LINK" matches
    python -m tools.faults decoders --count 1000000     random and damaged bytes to every decoder

The exit code is 1 when a row fails: outputs neutral too late, an old command executed, leaked resources.
"""

import argparse
import re
import sys
import time
from pathlib import Path

from tools.faults import campaign, decoders, report
from tools.faults.instruments import row_names, run_instruments
from tools.faults.rows import Row


def main(arguments: list[str]) -> int:
    """Run what was requested; return the exit code."""
    if arguments[:1] == ["decoders"]:
        return decoders.main(arguments[1:])
    options = _parser().parse_args(arguments)
    try:
        chosen = re.compile(options.select)
    except re.error as error:
        print(f"--select {options.select!r}: {error}", file=sys.stderr)
        return 2

    def choose(name: str) -> bool:
        return bool(chosen.search(name))

    plans = campaign.plans(choose, options.all, options.quick)
    files = campaign.bad_files(choose, options.quick)
    if options.list:
        for plan in plans:
            for fault in plan.faults:
                print(f"{fault.room} {fault.name} {plan.link.name}")
        print("\n".join(f"file {bad.name}" for bad in files))
        print("\n".join(row_names()))
        return 0
    if not plans and not files and not any(map(choose, row_names())):
        print(f"--select {options.select!r}: no row matches; see --list", file=sys.stderr)
        return 2
    began = time.monotonic()
    rows: list[Row] = []
    sources = [campaign.run_plan(plan, options.attempts) for plan in plans]
    for source in (*sources, campaign.run_files(files), run_instruments(choose) if not options.quick else ()):
        for row in source:
            print(report.line_of(row), flush=True)
            rows.append(row)
    seconds = time.monotonic() - began
    print(f"{report.summary(rows)}; {seconds:.0f} s")
    if options.output:
        report.save(rows, options.output, seconds)
    return int(not all(row.passed for row in rows))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tools.faults", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--quick", action="store_true", help="a selection, on one link")
    which.add_argument("--all", action="store_true", help="on the emulated STM32s too")
    parser.add_argument("--select", default="", metavar="REGEX", help="rows whose name matches")
    parser.add_argument("--attempts", type=int, default=1, help="how often a row that fails is measured [%(default)s]")
    parser.add_argument("--list", action="store_true", help="name the rows and run none")
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="write the result there")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
