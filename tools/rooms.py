"""Draw the rooms of the code and the ways of a command and of a sample: docs/explanation/architecture.svg.

    python -m tools.rooms

`FLOORS` is the plan: a module imports from its own floor or from below, in annotations and lazily too.
The tests read the imports and hold them against it (tests/unit/test_rooms.py).
"""

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("hil", "sim", "boards", "firmware_stub")
PICTURE = ROOT / "docs" / "explanation" / "architecture.svg"

# From the ground up: room -> what it is for, as the picture says it.
FLOORS: list[dict[str, str]] = [
    {"hil.common": "errors, clock, schema"},
    {"boards": "one file a board", "hil.autonomy": "control, paths, tasks, fleets", "sim": "vehicle, water, sensors"},
    {"hil.links": "wires and thruster protocols", "hil.ros": "messages of ROS 2", "firmware_stub": "the STM32"},
    {"hil.scenario": "the scenario file", "hil.network": "zenoh sessions, certificates"},
    {"hil.recording": "MCAP: write, read, replay", "hil.client": "Python interface to vehicles"},
    {
        "hil.slave": "the daemon on the board", "hil.master": "the planner process", "hil.gateways": "JSON, MATLAB",
        "hil.autopilots": "ArduPilot, PX4",
        "hil.gateways.mavlink": "ground stations",
        "hil.view": "the live view in a browser",
    },
    {
        "hil.plots": "figures", "hil.charts": "worlds from charts", "hil.bench": "delay, load, start-up",
        "hil.tuning": "gains", "hil.cases": "experiments", "hil.doctor": "findings", "hil.install": "service",
        "hil.schemas": "JSON Schemas",
    },
    {"hil.commands": "arguments in, text out", "hil.cli": "the command uuv-hil", "hil": "hil.connect, lazily"},
]  # fmt: skip
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}

# Room by room: what a velocity command passes on its way to the thrusters, and a sample on its way to the planner.
COMMAND = ["hil.master", "hil.client", "hil.network", "hil.slave", "hil.autonomy", "hil.links", "firmware_stub", "sim"]
SAMPLE = ["sim", "hil.slave", "hil.ros", "hil.network", "hil.client", "hil.master"]


def modules() -> Iterator[tuple[str, Path]]:
    """Yield the dotted name and the file of every module that is installed."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            yield name.removesuffix(".__init__"), path


def room(module: str) -> str:
    """Return the room of a module: the longest name in `FLOORS` that it begins with. Raises KeyError."""
    module = module.removesuffix(".__main__")
    fitting = [name for name in FLOOR if module == name or module.startswith(f"{name}.")]
    if not fitting or (fitting == ["hil"] and module != "hil"):
        raise KeyError(f"{module} is in no room: add its folder to FLOORS in tools/rooms.py")
    return max(fitting, key=len)


@cache
def imports(path: Path) -> set[str]:
    """Return the dotted names that a file imports, at the top, lazily, and for annotations."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@cache
def graph() -> dict[str, set[str]]:
    """Return module -> the modules of ours that it imports."""
    known = dict(modules())
    edges: dict[str, set[str]] = {}
    for module, path in known.items():
        edges[module] = set()
        for name in imports(path):
            while name and name not in known:
                name = name.rpartition(".")[0]
            if name and name != module and name != "hil":
                edges[module].add(name)
    return edges


def arrows() -> set[tuple[str, str]]:
    """Return (room, room that it imports from) for all rooms that differ."""
    pairs = {(room(module), room(other)) for module, others in graph().items() for other in others}
    return {(one, other) for one, other in pairs if one != other}


def circles() -> list[list[str]]:
    """Return the sets of modules that import each other round in a circle, each sorted."""
    edges = graph()
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


WIDTH, HEIGHT, GAP, MARGIN = 168, 52, 10, 70


def draw() -> str:
    """Return the picture as SVG: floors from the ground up, and the two ways through them."""
    columns = max(map(len, FLOORS))
    width, height = MARGIN + columns * (WIDTH + GAP), len(FLOORS) * (HEIGHT + 2 * GAP) + 60
    boxes, corners = [], {}
    for number, rooms in enumerate(FLOORS):
        top = height - 60 - (number + 1) * (HEIGHT + 2 * GAP) + GAP
        boxes.append(f'<text x="8" y="{top + HEIGHT / 2 + 5:g}" class="floor">floor {number}</text>')
        for column, (name, purpose) in enumerate(rooms.items()):
            left = MARGIN + column * (WIDTH + GAP)
            corners[name] = left + WIDTH, top
            boxes.append(f'<rect x="{left}" y="{top}" width="{WIDTH}" height="{HEIGHT}" rx="5"/>')
            boxes.append(f'<text x="{left + 8}" y="{top + 22}" class="room">{name}</text>')
            boxes.append(f'<text x="{left + 8}" y="{top + 40}">{purpose}</text>')
    badges = [*_badges(COMMAND, corners, "command", 12), *_badges(SAMPLE, corners, "sample", 34)]
    legend = (
        f'<text x="{MARGIN}" y="{height - 28}" class="command">a command: {" → ".join(COMMAND)}</text>'
        f'<text x="{MARGIN}" y="{height - 10}" class="sample">a sample: {" → ".join(SAMPLE)}</text>'
    )
    return "\n".join([_head(width, height), *boxes, *badges, legend, "</svg>", ""])


def _badges(way: list[str], corners: Mapping[str, tuple[float, float]], kind: str, shift: float) -> list[str]:
    """Return a numbered circle for each room of a way, `shift` px left of the room's right edge."""
    elements = []
    for number, name in enumerate(way, 1):
        right, top = corners[name]
        place = f'x="{right - shift:g}" y="{top + 18:g}"'
        elements.append(f'<circle cx="{right - shift:g}" cy="{top + 14:g}" r="10" class="{kind}"/>')
        elements.append(f'<text {place} text-anchor="middle" class="number">{number}</text>')
    return elements


def _head(width: int, height: int) -> str:
    namespace = "http://www.w3.org/2000/svg"
    return f"""<svg xmlns="{namespace}" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11">
<style>
rect {{ fill: #f1f5f9; stroke: #64748b }} .room {{ font-weight: bold; font-size: 13px }} .floor {{ fill: #64748b }}
circle.command {{ fill: #c2410c }} circle.sample {{ fill: #1d4ed8 }} .number {{ fill: white; font-weight: bold }}
text.command {{ fill: #c2410c }} text.sample {{ fill: #1d4ed8 }}
</style>
<rect x="0" y="0" width="{width}" height="{height}" style="fill: white; stroke: none"/>"""


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
    print(PICTURE)
