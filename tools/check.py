"""Run parts of the check one after the other, also after a failure, and list all failures at the end.

    python -m tools.check                          everything, as `make check` does
    python -m tools.check test                     one part, as `make test` does
    python -m tools.check --jobs 4 test system

A test that fails in parallel with others may have been late on a busy machine: it runs once more, alone, after its
part. If it then passes, the part passes, and the last lines list the test as a defect, because it depends on the
machine. At most `MAX_SECOND` tests of a whole run may pass so: when more fail, none of them runs again. Tests that
run beside a part (`Part.beside`), which are those of logic alone, never run again.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO, NamedTuple

ROOT = Path(__file__).parent.parent
MAX_SECOND = 2
TESTS_FAILED = 1  # pytest's exit status; others say that tests could not be collected, or that there was none
# The tests of a file share what is expensive to start, and run one after the other.
PARALLEL = ("--dist", "loadfile", "--no-loadscope-reorder")


class Part(NamedTuple):
    """A part of the check: arguments of pytest, or commands of Python modules."""

    tests: tuple[str, ...] = ()
    at_once: int = 0  # tests that run at a time on each processor; 0: one after the other
    # Tests that run beside them in workers of their own, one on each processor, and take the time that they leave.
    beside: tuple[str, ...] = ()
    modules: tuple[tuple[str, ...], ...] = ()
    again: bool = True  # failed tests run once more


PARTS: dict[str, Part] = {
    # The former mostly wait. Each worker collects all tests of its run, so two runs collect half as much as one.
    "test": Part(("tests/process",), at_once=3, beside=("tests/unit",)),
    "search": Part(("-m", "hypothesis", "--hypothesis-profile=search"), at_once=2),
    "lint": Part(modules=(("ruff", "check", "."), ("ruff", "format", "--check", "."), ("mypy",))),
    "system": Part(("tests/system",), at_once=2),
    "uml": Part(("tests/system/uml",)),
    # One emulated board after the other: two at a time are starved of their processors. They boot for minutes.
    "board": Part(("-m", "board", "tests/system/boards"), again=False),
}


class Outcome(NamedTuple):
    """Result of one part."""

    seconds: float
    failed: list[str]  # tests, or commands
    passed_alone: list[str]  # tests that failed in their first attempt only


def run(command: Sequence[str], folder: Path = ROOT, output: IO[str] | None = None) -> int:
    """Run a Python module with the arguments given; return its exit status.

    With `output`, a file for all that it prints, it gives way to others.
    """
    print("+ python -m", *command, file=output, flush=True)
    # Bytecode is saved even where the environment forbids it: each worker would compile all tests again (6 s).
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    line = [*(["nice", "-n4"] if output else []), sys.executable, "-m", *command]
    done = subprocess.run(line, cwd=folder, env=environment, stdout=output, stderr=output, check=False)
    return done.returncode


def last_failed(cache: Path) -> list[str]:
    """Return the names of the tests that failed in the last run with this cache."""
    try:
        return sorted(json.loads((cache / "v/cache/lastfailed").read_text(encoding="utf-8")))
    except FileNotFoundError:
        return []


def run_tests(
    arguments: Sequence[str],
    apart: Sequence[str] = (),
    folder: Path = ROOT,
    again: int = MAX_SECOND,
    output: IO[str] | None = None,
) -> tuple[list[str], list[str]]:
    """Run pytest, then the failed tests alone; return the tests that failed twice, and those that then passed.

    `apart` are arguments of the first run only, and `output` is where it prints, if not to standard output. `folder`
    is where pytest starts. If more than `again` tests fail, nothing runs twice.
    Another failure (an error while tests are collected, no test at all) is reported by pytest's exit status.
    """
    with tempfile.TemporaryDirectory(prefix="uuv-hil-check-") as cache:  # of its own: parts do not mix
        pytest = ["pytest", "-o", f"cache_dir={cache}", *arguments]
        status = run([*pytest, *apart], folder, output)
        if status == 0:
            return [], []
        first = last_failed(Path(cache))
        if status != TESTS_FAILED or not 0 < len(first) <= again:
            return first or [f"pytest: exit status {status}"], []
        print(f"{len(first)} failed beside others; once more, alone:", *first, sep="\n  ", flush=True)
        status = run([*pytest, "--last-failed", "--last-failed-no-failures", "none", "-n", "0"], folder)
        second = last_failed(Path(cache)) or (first if status else [])
        return second, sorted({*first} - {*second})


def run_part(name: str, jobs: int | None, seed: int, again: int = MAX_SECOND, results: str = "") -> Outcome:
    """Run a part by its name; `jobs`: number of tests at a time, if they do not run one after the other.

    At most `again` failed tests run once more. The outcomes of the first attempts go to a file in `results`, "" none.
    """
    check, began = PARTS[name], time.monotonic()
    failed = [" ".join(command) for command in check.modules if run(command)]
    passed_alone: list[str] = []
    if check.tests:
        processors = os.cpu_count() or 1
        apart = ["-n", str(jobs or check.at_once * processors), *PARALLEL] if check.at_once else []
        aside = ["-n", str(min(jobs or processors, processors)), *PARALLEL]
        random = [f"--hypothesis-seed={seed}"] if name == "search" else []
        if results:
            apart.append(f"--junitxml={results}/{name}.xml")
            aside.append(f"--junitxml={results}/{name}_beside.xml")
        with tempfile.TemporaryFile("w+") as output, ThreadPoolExecutor(1) as pool:
            beside = pool.submit(run_tests, check.beside, aside, again=0, output=output) if check.beside else None
            failed, passed_alone = run_tests([*check.tests, *random], apart, again=again if check.again else 0)
            if beside:
                failed += beside.result()[0]
                output.seek(0)
                print(output.read(), flush=True)
    return Outcome(time.monotonic() - began, failed, passed_alone)


def summary(outcomes: Mapping[str, Outcome]) -> str:
    """Return the duration of each part, each test or command that failed, and a table of second attempts."""
    lines = []
    for name, outcome in outcomes.items():
        lines.append(f"{name:8} {'FAILED' if outcome.failed else 'passed'} in {outcome.seconds:.0f} s")
        lines += [f"  failed: {test}" for test in outcome.failed]
    second = [f"  {name:8} {test}" for name, outcome in outcomes.items() for test in outcome.passed_alone]
    if second:
        lines.append(f"passed in a second attempt, alone ({len(second)} of at most {MAX_SECOND}; to be corrected):")
        lines += second
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the requested parts; return 1 if any failed."""
    parser = argparse.ArgumentParser(prog="tools.check", description="Run parts of the check, by default all.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--jobs", type=int, help="tests that run at a time, by default two or three on each processor")
    parser.add_argument("--results", default="", metavar="FOLDER", help="keep the outcomes, for tools.reference")
    parser.add_argument("--seed", type=int, default=1, help="of the random search")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.parts if name not in PARTS]:
        parser.error(f"no part {unknown[0]!r}; there are {', '.join(PARTS)}")
    outcomes: dict[str, Outcome] = {}
    again = MAX_SECOND
    for name in options.parts or PARTS:
        outcomes[name] = run_part(name, options.jobs, options.seed, again, options.results)
        again -= len(outcomes[name].passed_alone)
    print(f"\n{summary(outcomes)}", flush=True)
    return int(any(outcome.failed for outcome in outcomes.values()))


if __name__ == "__main__":
    sys.exit(main())
