"""Draw the rooms of the code and the paths of a command and of a sample: docs/explanation/architecture.svg.

    python -m tools.pages.rooms

A room is a part of a package, a floor a layer of rooms. `FLOORS` is the plan: a module imports only from its own floor
or from lower ones, also in annotations and in functions. tests/unit/test_rooms.py compares the imports with the plan.
"""

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from textwrap import wrap

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


@cache
def imports(path: Path) -> set[str]:
    """Return the dotted names that a file imports, at the top, lazily, and for annotations."""
    names: set[str] = set()
    for node in statements(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def statements(tree: ast.Module) -> Iterator[ast.AST]:
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
        for name in imports(path):
            while name and name not in known:
                name = name.rpartition(".")[0]
            if name and name != module:
                edges[module].add(name)
    return edges


def arrows() -> set[tuple[str, str]]:
    """Return (room, room that it imports from) for all rooms that differ."""
    pairs = {(room(module), room(other)) for module, others in graph().items() for other in others}
    return {(one, other) for one, other in pairs if one != other}


def import_cycles() -> list[list[str]]:
    """Return the import cycles, each as a sorted list of modules. Tools and tests are included."""
    edges = graph((*PACKAGES, "tools", "tests"))
    reached = {module: _reached(module, edges) for module in edges}
    components = {
        tuple(sorted({module} | {other for other in reached[module] if module in reached[other]})) for module in edges
    }
    return sorted(list(members) for members in components if len(members) > 1)


def _reached(start: str, edges: dict[str, set[str]]) -> set[str]:
    reached: set[str] = set()
    waiting = [start]
    while waiting:
        new = edges[waiting.pop()] - reached
        reached |= new
        waiting.extend(new)
    return reached


# What each room of a path does, in words that fit into its box.
COMMAND_STEPS = [
    "planner sets a velocity", "numbers and stamps it", "carries it", "checks age and sender", "wrench, then thrusts",
    "encodes a frame", "sets pulse widths", "moves the vehicle",
]  # fmt: skip
SAMPLE_STEPS = [
    "measures in NED, FRD", "passes it to a thread", "encodes in ENU, FLU", "carries it", "decodes it",
    "passes it to the planner",
]  # fmt: skip

WIDTH, HEIGHT, GAP, MARGIN, COLUMNS = 184, 46, 8, 76, 4
PAGE = MARGIN + COLUMNS * (WIDTH + GAP) + GAP
STEP_HEIGHT = 56  # of a box in a path


def draw() -> str:
    """Return the picture as SVG: the floors, and below them the paths of a command and of a sample."""
    title = "Rooms by floor: a room imports from its own floor or from lower ones"
    elements = [f'<text x="{MARGIN}" y="24" class="title">{title}</text>']
    corners: dict[str, tuple[float, float]] = {}
    top = 40
    for number, rooms in reversed(list(enumerate(FLOORS))):
        rows = -(-len(rooms) // COLUMNS)
        height = rows * (HEIGHT + GAP) + GAP
        elements.append(f'<rect x="8" y="{top}" width="{PAGE - 16}" height="{height}" class="floor"/>')
        elements.append(f'<text x="18" y="{top + height / 2 + 4:g}" class="floor">floor {number}</text>')
        for place, (name, purpose) in enumerate(rooms.items()):
            row, column = divmod(place, COLUMNS)
            left, upper = MARGIN + column * (WIDTH + GAP), top + GAP + row * (HEIGHT + GAP)
            corners[name] = left + WIDTH, upper
            elements.append(f'<rect x="{left}" y="{upper}" width="{WIDTH}" height="{HEIGHT}" rx="4" class="room"/>')
            elements.append(f'<text x="{left + 8}" y="{upper + 19}" class="room">{name}</text>')
            elements.append(f'<text x="{left + 8}" y="{upper + 36}">{purpose}</text>')
        top += height + 4
    elements += [*_badges(COMMAND, corners, "command", 13), *_badges(SAMPLE, corners, "sample", 35)]
    elements += _draw_path("Path of a command", COMMAND, COMMAND_STEPS, "command", top + 12)
    elements += _draw_path("Path of a sample", SAMPLE, SAMPLE_STEPS, "sample", top + 64 + STEP_HEIGHT)
    return "\n".join([_head(PAGE, top + 2 * (52 + STEP_HEIGHT) + 8), *elements, "</svg>", ""])


def _badges(path: list[str], corners: Mapping[str, tuple[float, float]], kind: str, shift: float) -> list[str]:
    """Return a numbered circle for each room of a path, `shift` px left of the room's right edge."""
    elements = []
    for number, name in enumerate(path, 1):
        right, top = corners[name]
        elements += _badge(number, right - shift, top + 14, kind)
    return elements


def _badge(number: int, x: float, y: float, kind: str) -> list[str]:
    return [
        f'<circle cx="{x:g}" cy="{y:g}" r="10" class="{kind}"/>',
        f'<text x="{x:g}" y="{y + 4:g}" text-anchor="middle" class="number">{number}</text>',
    ]


def _draw_path(title: str, rooms: list[str], steps: list[str], kind: str, top: float) -> list[str]:
    """Return one path as a row of boxes joined by arrows. A box has a number, the room, and what the room does."""
    elements = [f'<text x="16" y="{top + 14:g}" class="title {kind}">{title}</text>']
    pitch = (PAGE - 16) / len(COMMAND)
    for number, (name, step) in enumerate(zip(rooms, steps, strict=True), 1):
        left, upper, width = 10 + (number - 1) * pitch, top + 34, pitch - 16
        elements.append(
            f'<rect x="{left:g}" y="{upper:g}" width="{width:g}" height="{STEP_HEIGHT}" rx="4" class="{kind}"/>'
        )
        elements += _badge(number, left + 12, upper, kind)
        middle = f'x="{left + width / 2:g}" text-anchor="middle"'
        elements.append(f'<text {middle} y="{upper + 21:g}" class="step">{name.removeprefix("hil.")}</text>')
        for line, words in enumerate(wrap(step, 14)):
            elements.append(f'<text {middle} y="{upper + 36 + 12 * line:g}" class="small">{words}</text>')
        if number < len(rooms):
            x, y = left + width + 3, upper + STEP_HEIGHT / 2
            elements.append(f'<path d="M{x:g} {y:g} h7 m-4 -5 l5 5 l-5 5" class="{kind}"/>')
    return elements


def _head(width: float, height: float) -> str:
    namespace = "http://www.w3.org/2000/svg"
    return f"""<svg xmlns="{namespace}" viewBox="0 0 {width:g} {height:g}" font-family="sans-serif" font-size="11">
<style>
rect.floor {{ fill: #eef2f7 }} rect.room {{ fill: white; stroke: #64748b }} text.floor {{ fill: #475569 }}
rect.command {{ fill: white; stroke: #c2410c }} rect.sample {{ fill: white; stroke: #1d4ed8 }}
text.room {{ font-weight: bold; font-size: 13px }} .title {{ font-weight: bold; font-size: 13px }}
.step {{ font-weight: bold; font-size: 10px }} .small {{ font-size: 10px }}
.number {{ fill: white; font-weight: bold }}
circle.command {{ fill: #c2410c }} circle.sample {{ fill: #1d4ed8 }}
text.command {{ fill: #c2410c }} text.sample {{ fill: #1d4ed8 }}
path {{ fill: none; stroke-width: 2 }} path.command {{ stroke: #c2410c }} path.sample {{ stroke: #1d4ed8 }}
</style>
<rect x="0" y="0" width="{width:g}" height="{height:g}" style="fill: white"/>"""


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
    print(PICTURE)
