"""The plan of the code's rooms and floors, as docs/explanation/architecture.svg shows it, and the actual imports.

A room is a part of a package, a floor a layer of rooms. `FLOORS` is the plan: a module imports only from its own floor
or from lower ones, also in annotations and in functions. tests/unit/test_rooms.py compares the imports with the plan.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("hil", "sim", "boards", "firmware_stub")
PICTURE = ROOT / "docs" / "explanation" / "architecture.svg"

# From the lowest floor to the highest: room -> its purpose, as the picture shows it.
FLOORS: list[dict[str, str]] = [
    {"hil.common": "errors, clock, schema"},
    {"boards": "one file a board", "hil.autonomy": "control, paths, tasks, fleets", "sim": "vehicle, water, sensors"},
    {"hil.links": "wires and thruster protocols", "hil.ros": "messages of ROS 2", "firmware_stub": "the STM32"},
    {"hil.scenario": "the scenario file", "hil.network": "zenoh sessions, certificates"},
    {"hil.recording": "MCAP: write, read, replay", "hil.client": "Python interface to vehicles"},
    {
        "hil.slave": "the daemon on the board", "hil.master": "the planner process",
        "hil.gateways": "JSON, Foxglove, ROS 1",
        "hil.autopilots": "ArduPilot, PX4",
        "hil.gateways.mavlink": "ground stations",
        "hil.view": "the live view in a browser",
        "hil.instruments": "devices at their wire",
    },
    {
        "hil.plots": "figures of runs", "hil.charts": "worlds from charts", "hil.bench": "delay, load, start-up",
        "hil.tuning": "gains from responses",
        "hil.cases": "reference experiments",
        "hil.doctor": "checks of a machine", "hil.install": "the slave as a service",
        "hil.schemas": "JSON Schemas",
    },
    {"hil.commands": "arguments in, text out", "hil.cli": "the command uuv-hil", "hil": "hil.connect, lazily"},
]  # fmt: skip
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}

# The rooms that a velocity command passes from the planner to the thrusters, and a sample from a sensor to the planner.
COMMAND = ["hil.master", "hil.client", "hil.network", "hil.slave", "hil.autonomy", "hil.links", "firmware_stub", "sim"]
SAMPLE = ["sim", "hil.slave", "hil.ros", "hil.network", "hil.client", "hil.master"]


def modules(packages: tuple[str, ...] = PACKAGES) -> Iterator[tuple[str, Path]]:
    """Yield the dotted name and the file of every module of these packages. The default: the installed packages."""
    for package in packages:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            yield name.removesuffix(".__init__"), path


def room(module: str) -> str:
    """Return the room of a module: the longest name in `FLOORS` that it begins with. Raises KeyError."""
    module = module.removesuffix(".__main__")
    candidates = [name for name in FLOOR if module == name or module.startswith(f"{name}.")]
    if not candidates or (candidates == ["hil"] and module != "hil"):
        raise KeyError(f"{module} is in no room: add its folder to FLOORS in tools/pages/rooms.py")
    return max(candidates, key=len)


@cache  # to parse all files takes seconds
def imports_and_functions(path: Path) -> tuple[set[str], list[tuple[str, int]]]:
    """Return the dotted names that a file imports, anywhere, and the name and length (lines) of each function."""
    names, functions = set[str](), list[tuple[str, int]]()
    for node in _statements(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            functions.append((node.name, (node.end_lineno or node.lineno) - node.lineno + 1))
    return names, functions


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield all statements, also nested ones. Expressions are left out: they have no imports, and take most time."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        for node in ast.iter_child_nodes(waiting.pop()):
            if isinstance(node, (ast.stmt, ast.ExceptHandler, ast.match_case)):
                waiting.append(node)
                yield node


@cache
def graph(packages: tuple[str, ...] = PACKAGES) -> dict[str, set[str]]:
    """Return module -> the modules among these packages that it imports."""
    known = dict(modules(packages))
    edges: dict[str, set[str]] = {}
    for module, path in known.items():
        edges[module] = set()
        for name in imports_and_functions(path)[0]:
            while name and name not in known:
                name = name.rpartition(".")[0]
            if name and name != module:
                edges[module].add(name)
    return edges


@cache
def is_public(module: str) -> bool:
    """Return whether another room may import a module: the `__init__` of its folder names it as public.

    It does so in backticks behind "Public:". "every module here" names those of the folders inside too.
    """
    folder, _, name = module.rpartition(".")
    if (ROOT / Path(*module.split("."))).is_dir() or module in FLOOR:
        return True
    names = {word.removeprefix(f"{folder}.").partition(".")[0] for word in re.findall("`(.*?)`", _interface(folder))}
    parts = folder.split(".")
    above = [".".join(parts[:count]) for count in range(1, len(parts) + 1)]
    return name in names or any("every module here" in _interface(each) for each in above)


@cache
def _interface(folder: str) -> str:
    """Return what the `__init__` of a folder says behind "Public:", up to what it must not know."""
    text = (ROOT / Path(*folder.split("."), "__init__.py")).read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(text)) or "").partition("Public:")[2].partition("must not")[0]


def arrows() -> set[tuple[str, str]]:
    """Return (room, room that it imports from) for all rooms that differ."""
    pairs = {(room(module), room(other)) for module, others in graph().items() for other in others}
    return {(one, other) for one, other in pairs if one != other}


def import_cycle() -> list[str]:
    """Return the modules of an import cycle, [] if there is none. Tools and tests are included."""
    try:
        TopologicalSorter(graph((*PACKAGES, "tools", "tests"))).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []
