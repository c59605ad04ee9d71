"""Change the code in small ways, one at a time, and see whether a test notices each change.

A room's unit tests run once, to record which of them execute each line. Then, for each change of a sample, these tests
run, and the process tests of the room if none of them fails. Survivors are printed; fewer than `LEAST` caught fail.
What only tells a person something is not changed: texts, errors, lines of the log.

mutmut and cosmic-ray would change all 27,000 places, run all tests for each or none in processes, and take days.
"""

import argparse
import ast
import contextlib
import itertools
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from coverage import CoverageData

ROOT = Path(__file__).parent.parent
LEAST, LIMIT_S = 0.9, 600  # share of changes that tests must catch; for one change: tests that hang have caught it
MAVLINK = "-k=mavlink or qgroundcontrol"
SLAVE = "slave", "autopilots", "test_failsafe.py", "ros/test_ros_descriptions.py"
ROOMS = {  # the unit tests of each, and its process tests
    "hil/slave": (["tests/unit/slave"], [f"tests/process/{name}" for name in SLAVE]),
    "hil/links": (["tests/unit/links", "tests/unit/commands/test_frame_command.py"], ["tests/process/links"]),
    "hil/gateways/mavlink": (["tests/unit/gateways", MAVLINK], ["tests/process/gateways", MAVLINK]),
    "sim": (["tests/unit/sim", "tests/unit/autonomy"], ["tests/process/sim"]),
}
TALK = re.compile(r"(\b|_)(report|print|complain|write_line|warn)$|texts\.(append|extend)$")
SIGNS = [ast.Lt, ast.Gt, ast.Eq, ast.Is, ast.In, ast.Add, ast.Mult, ast.And]
OPPOSITE = [ast.LtE, ast.GtE, ast.NotEq, ast.IsNot, ast.NotIn, ast.Sub, ast.Div, ast.Or]
OTHER: dict[type, type] = {**dict(zip(SIGNS, OPPOSITE, strict=True)), **dict(zip(OPPOSITE, SIGNS, strict=True))}


class Mutant(NamedTuple):
    """A change of a file: the bytes of `place` become `after`."""

    path: str
    line: int
    place: slice
    after: str


def changes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what a node may become."""
    if isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER:
        yield ast.Compare(node.left, [OTHER[type(node.ops[0])](), *node.ops[1:]], node.comparators)
    elif isinstance(node, (ast.BinOp, ast.BoolOp)) and type(node.op) in OTHER:
        yield type(node)(**{**vars(node), "op": OTHER[type(node.op)]()})
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        yield node.operand
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("min", "max"):
        yield ast.Call(ast.Name({"min": "max", "max": "min"}[node.func.id]), node.args, node.keywords)
    elif isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        yield ast.Constant(not node.value if isinstance(node.value, bool) else node.value + 1)
    elif isinstance(node, ast.Assign) and isinstance(node.targets[0], (ast.Attribute, ast.Subscript)):
        yield ast.Pass()  # a state is not set
    elif isinstance(node, ast.If) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)):
        yield ast.Pass()  # a guard or a call is removed


def nodes_of(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield all nodes of a function but those of annotations, texts, errors, and of functions within it."""
    for name, value in ast.iter_fields(tree):
        for node in value if isinstance(value, list) else [value]:
            call = node.value if isinstance(node, ast.Expr) else node
            talks = isinstance(call, ast.Call) and TALK.search(ast.unparse(call.func))
            inner = isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.JoinedStr, ast.Raise, ast.Assert))
            form = isinstance(node, ast.keyword) and node.arg in ("strict", "daemon")  # for faults of our own only
            skipped = inner or talks or form or name in ("annotation", "returns", "decorator_list")
            if isinstance(node, ast.AST) and not skipped:
                yield node
                yield from nodes_of(node)


def mutants(path: str, source: bytes) -> Iterator[Mutant]:
    """Yield every change of the functions in a file."""
    starts = [0, *itertools.accumulate(map(len, source.splitlines(keepends=True)))]
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    for function in [one for one in functions if one.name not in ("__repr__", "__str__")]:
        for node, after in [(one, other) for one in nodes_of(function) for other in changes(one)]:
            assert isinstance(node, (ast.expr, ast.stmt))
            begin = starts[node.lineno - 1] + node.col_offset
            end = starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
            text = "pass" if isinstance(after, ast.Pass) else f"({ast.unparse(after)})"
            yield Mutant(path, node.lineno, slice(begin, end), text)


def run_tests(folder: Path, arguments: Sequence[str], limit_s: float = LIMIT_S) -> bool:
    """Run pytest in a copy of the repository; return whether all tests pass in time."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *arguments]
    with contextlib.suppress(subprocess.SubprocessError):
        subprocess.run(command, cwd=folder, env=environment, capture_output=True, timeout=limit_s, check=True)
        return True
    return False


def lines_run(folder: Path, room: str) -> dict[tuple[str, int], list[str]]:
    """Return the unit tests that execute each line (file, number) of a room. Raises SystemExit if one fails.

    A line that runs while a test is set up belongs to its whole file, whose tests may share what was set up.
    """
    if not run_tests(folder, [f"--cov={room}", "--cov-context=test", "--cov-report=", *ROOMS[room][0]], 6 * LIMIT_S):
        raise SystemExit(f"{room}: its unit tests fail without a change")
    data = CoverageData(str(folder / ".coverage"))
    data.read()
    return {
        (str(Path(file).relative_to(folder)), line): sorted(set(map(_tests_of, contexts)) - {""})
        for file in data.measured_files()
        for line, contexts in data.contexts_by_lineno(file).items()
    }


def _tests_of(context: str) -> str:
    name, _, phase = context.partition("|")
    return name if phase == "run" else name.partition("::")[0] if phase == "setup" else ""


def survives(folder: Path, mutant: Mutant, *stages: Sequence[str]) -> bool:
    """Return whether the tests of all stages pass with the change; report it if so."""
    path = folder / mutant.path
    source = path.read_bytes()
    path.write_bytes(source[: mutant.place.start] + mutant.after.encode() + source[mutant.place.stop :])
    for compiled in path.parent.glob(f"__pycache__/{path.stem}.*"):
        compiled.unlink()  # it may have the same time and size
    passed = all(run_tests(folder, tests) for tests in stages if tests)
    path.write_bytes(source)
    if passed:
        print(f"  {mutant.path}:{mutant.line}: {source[mutant.place].decode()} -> {mutant.after}", flush=True)
    return passed


def main(arguments: Sequence[str] | None = None) -> int:
    """Sample changes of the rooms; return 1 if the tests catch too few."""
    parser = argparse.ArgumentParser(prog="tools.mutants", description="Change the code, and see whether tests notice.")
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help=f"of {', '.join(ROOMS)}; by default all")
    parser.add_argument("--sample", type=int, default=25, help="changes of each room [%(default)s]")
    parser.add_argument("--seed", type=int, default=1, help="chooses the sample [%(default)s]")
    parser.add_argument("--unit", action="store_true", help="only lines that unit tests execute, and no process tests")
    options = parser.parse_args(arguments)
    total = survived = 0
    with tempfile.TemporaryDirectory(prefix="uuv-hil-mutants-") as name:
        folder = Path(name).resolve() / "copy"
        shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "__pycache__"))
        for room in options.rooms or ROOMS:
            tests, slow = lines_run(folder, room), [] if options.unit else ROOMS[room][1]
            files = [(path, str(path.relative_to(folder))) for path in sorted((folder / room).rglob("*.py"))]
            found = [mutant for path, name in files for mutant in mutants(name, path.read_bytes())]
            chosen = [mutant for mutant in found if tests.get(mutant[:2]) or not options.unit]
            sample = random.Random(options.seed).sample(chosen, min(options.sample, len(chosen)))
            print(f"{room}: {len(sample)} of {len(chosen)} changes; these survive:", flush=True)
            survived += sum(survives(folder, mutant, tests.get(mutant[:2], []), slow) for mutant in sample)
            total += len(sample)
    print(f"{total - survived} of {total} caught; at least {LEAST:.0%} are needed")
    return int(total - survived < LEAST * total)


if __name__ == "__main__":
    sys.exit(main())
