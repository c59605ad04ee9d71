"""Draw what is real and what is simulated: docs/overview.svg.

    python -m tools.pages.overview

The tables hold the texts of the picture. Its columns of boxes lead from the planner to the thrusters; an arrow is a
link.
"""

from pathlib import Path

PICTURE = Path(__file__).parents[2] / "docs" / "overview.svg"

# Columns: title, and boxes of (name, lines, kind); kinds: real, simulated, either.
COLUMNS = [
    (
        "Laptop",
        [
            ("Planner (master)", ["A*, VFH+, tasks,", "or your planner"], "real"),
            ("Ground station", ["browser, QGroundControl,", "Foxglove, ROS 2"], "real"),
        ],
    ),
    (
        "Single-board computer",
        [
            ("Controller (slave)", ["speed, heading, depth,", "or ArduSub, PX4"], "real"),
            ("Simulator (slave)", ["thrusters, 6-DOF vehicle,", "water, seabed, all sensors"], "simulated"),
        ],
    ),
    (
        "STM32",
        [
            ("Firmware", ["sets the outputs,", "neutral without commands"], "either"),
            ("PWM outputs", ["to the thrusters; their widths", "drive the simulation"], "either"),
        ],
    ),
]
LINKS = ["network", "UART or CAN"]
LEGEND = {
    "real": "real: the software and the computers of the vehicle",
    "simulated": "simulated: the vehicle and the water around it",
    "either": "real or emulated: one key of the scenario selects it",
}
TAGS = {"real": "REAL", "simulated": "SIMULATED", "either": "REAL OR EMULATED"}
COLOURS = {"real": "#dcfce7", "simulated": "#dbeafe", "either": "#fef3c7"}
BOX_WIDTH, BOX_HEIGHT, GAP, MARGIN, TOP, LINE = 216, 92, 132, 20, 58, 18


def draw() -> str:
    """Return the picture as SVG."""
    rows = max(len(boxes) for _, boxes in COLUMNS)
    width = 2 * MARGIN + len(COLUMNS) * BOX_WIDTH + (len(COLUMNS) - 1) * GAP
    height = TOP + rows * (BOX_HEIGHT + 2 * MARGIN) + 20 + LINE * len(LEGEND) + MARGIN
    parts = [_head(width, height)]
    for number, (title, boxes) in enumerate(COLUMNS):
        left = MARGIN + number * (BOX_WIDTH + GAP)
        parts += _column(left, title, boxes, TOP + rows * (BOX_HEIGHT + 2 * MARGIN) - 34)
        if number < len(LINKS):
            parts += _links(left + BOX_WIDTH + 14, LINKS[number], number)
    parts += _inner_arrows()
    parts += _legend(height - LINE * len(LEGEND) - 6)
    return "\n".join([*parts, "</svg>", ""])


def _column(left: int, title: str, boxes: list[tuple[str, list[str], str]], height: int) -> list[str]:
    parts = [
        f'<rect x="{left - 14}" y="34" width="{BOX_WIDTH + 28}" height="{height}" rx="8" class="machine"/>',
        f'<text x="{left + BOX_WIDTH / 2:g}" y="24" class="title">{title}</text>',
    ]
    for row, (name, lines, kind) in enumerate(boxes):
        top = _top(row)
        parts.append(
            f'<rect x="{left}" y="{top}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}" rx="6" fill="{COLOURS[kind]}"/>'
        )
        parts.append(f'<text x="{left + 12}" y="{top + 18}" class="tag">{TAGS[kind]}</text>')
        parts.append(f'<text x="{left + 12}" y="{top + 40}" class="name">{name}</text>')
        parts += [f'<text x="{left + 12}" y="{top + 61 + LINE * i}">{line}</text>' for i, line in enumerate(lines)]
    return parts


def _links(left: int, name: str, number: int) -> list[str]:
    """Return the arrows of one link: commands to the right, sensor data or pulse widths to the left."""
    right, middle = left + GAP - 28, _top(0) + BOX_HEIGHT / 2
    back = "sensor data" if number == 0 else "pulse widths"
    return [
        f'<text x="{(left + right) / 2:g}" y="{middle - 36:g}" class="link">{name}</text>',
        _arrow(left, middle - 10, right, middle - 10, "command"),
        f'<text x="{(left + right) / 2:g}" y="{middle - 16:g}" class="link command">commands</text>',
        _arrow(right, middle + 16, left, middle + 16, "sample"),
        f'<text x="{(left + right) / 2:g}" y="{middle + 32:g}" class="link sample">{back}</text>',
    ]


def _inner_arrows() -> list[str]:
    """Return the arrows inside the board: pulse widths to the simulator, sensor data to the controller."""
    middle = MARGIN + BOX_WIDTH + GAP + BOX_WIDTH / 2
    below, above = _top(0) + BOX_HEIGHT, _top(1)
    text = (below + above) / 2 + 5
    return [
        _arrow(middle - 20, below, middle - 20, above, "command"),
        f'<text x="{middle - 28:g}" y="{text:g}" text-anchor="end" class="command">pulse widths</text>',
        _arrow(middle + 20, above, middle + 20, below, "sample"),
        f'<text x="{middle + 28:g}" y="{text:g}" class="sample">sensor data</text>',
    ]


def _legend(top: float) -> list[str]:
    return [
        f'<rect x="{MARGIN}" y="{top + LINE * row - 11:g}" width="14" height="14" fill="{COLOURS[kind]}"/>'
        f'<text x="{MARGIN + 22}" y="{top + LINE * row:g}">{text}</text>'
        for row, (kind, text) in enumerate(LEGEND.items())
    ]


def _top(row: int) -> int:
    return TOP + row * (BOX_HEIGHT + 2 * MARGIN)


def _arrow(x: float, y: float, to_x: float, to_y: float, kind: str) -> str:
    return f'<line x1="{x:g}" y1="{y:g}" x2="{to_x:g}" y2="{to_y:g}" class="{kind}" marker-end="url(#{kind})"/>'


def _head(width: int, height: int) -> str:
    heads = "".join(
        f'<marker id="{kind}" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        f'<path d="M0 0L8 4L0 8z" fill="{colour}"/></marker>'
        for kind, colour in (("command", "#c2410c"), ("sample", "#1d4ed8"))
    )
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" \
font-family="sans-serif" font-size="13">
<style>
rect {{ stroke: #64748b }} .machine {{ fill: #f8fafc; stroke-dasharray: 5 4 }}
.title {{ font-weight: bold; font-size: 15px; text-anchor: middle }} .name {{ font-weight: bold; font-size: 15px }}
.tag {{ font-size: 10px; letter-spacing: 1px; fill: #475569 }}
.link {{ text-anchor: middle; font-size: 12px }} line {{ stroke-width: 2 }}
line.command {{ stroke: #c2410c }} line.sample {{ stroke: #1d4ed8 }}
text.command {{ fill: #c2410c }} text.sample {{ fill: #1d4ed8 }}
</style>
<defs>{heads}</defs>
<rect x="0" y="0" width="{width}" height="{height}" style="fill: white; stroke: none"/>"""


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
    print(PICTURE)
