"""Draw a vehicle: its box and thrusters from above, from starboard and from ahead, and its top speeds."""

import os
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.common.palette import SERIES, START
from hil.plots.plotting import pyplot, save_figure
from sim.vehicle.terminal_speed import AxisCapability
from sim.vehicle.vehicle import Point, Vehicle

if TYPE_CHECKING:
    from sim.vehicle.fins import Fin

BODY, GRAVITY = "#e3e8ed", START
BUOYANCY, ARROW, FIN, BALLAST = SERIES[:4]
# Cosine above which a thruster counts as pointing towards the viewer or away (circle with a dot or a cross)
_FACING = 0.9


class View(NamedTuple):
    """Projection of one view: the FRD components, with signs, that point right, up and towards the viewer."""

    title: str
    right: tuple[int, int, str]
    up: tuple[int, int, str]
    eye: tuple[int, int]

    def flat(self, vector: tuple[float, float, float]) -> tuple[float, float]:
        """Return the components to the right and up of a vector in FRD."""
        return self.right[1] * vector[self.right[0]], self.up[1] * vector[self.up[0]]


VIEWS = (
    View("from above", (1, 1, "y, starboard (m)"), (0, 1, "x, forward (m)"), (2, -1)),
    View("from starboard", (0, 1, "x, forward (m)"), (2, -1, "-z, up (m)"), (1, 1)),
    View("from ahead", (1, -1, "-y, port (m)"), (2, -1, "-z, up (m)"), (0, 1)),
)


def draw(vehicle: Vehicle, capabilities: tuple[AxisCapability, ...], path: str) -> None:
    """Draw `vehicle` and its top speeds into the image file `path`. Raises MissingExtraError, ConfigError."""
    plt = pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(12, 10), layout="constrained")
    for view, place in zip(VIEWS, axes.flat, strict=False):
        _draw_view(place, vehicle, view)
    _draw_speeds(axes[1][1], capabilities)
    figure.suptitle(f"{vehicle.name}: {vehicle.mass:g} kg, {_parts(vehicle)}", fontsize=15)
    _name_thrusters(figure, vehicle)
    save_figure(figure, os.path.abspath(path))


def _draw_view(axes: Any, vehicle: Vehicle, view: View) -> None:
    from matplotlib.patches import Polygon, Rectangle

    wide, high = vehicle.dimensions[view.right[0]], vehicle.dimensions[view.up[0]]
    axes.add_patch(Rectangle((-wide / 2, -high / 2), wide, high, facecolor=BODY, edgecolor="0.55", zorder=0))
    for fin in vehicle.fins:
        axes.add_patch(Polygon([view.flat(corner) for corner in _corners(fin)], facecolor=FIN, edgecolor=FIN, zorder=2))
    _draw_ballast(axes, vehicle, view)
    reach = 0.2 * max(vehicle.dimensions)
    for spot, numbers in _stacks(vehicle, view).items():
        for number in numbers:
            _draw_thruster(axes, vehicle, view, number, reach)
        axes.annotate(
            ",".join(str(number + 1) for number in numbers), spot, xytext=_behind(vehicle, view, numbers),
            textcoords="offset points", fontsize=10, fontweight="bold", color=ARROW, ha="center", va="center", zorder=5,
        )  # fmt: skip
    for point, colour, name in (
        (vehicle.center_of_gravity, GRAVITY, "centre of gravity"),
        (vehicle.center_of_buoyancy, BUOYANCY, "centre of buoyancy"),
    ):
        axes.plot(*view.flat(point), marker="+", markersize=11, markeredgewidth=2, color=colour, label=name, zorder=4,
                  linestyle="none")  # fmt: skip
    half = [0.5 * max(size, 0.6 * max(wide, high)) + 1.25 * reach for size in (wide, high)]
    axes.set(title=view.title, xlabel=view.right[2], ylabel=view.up[2], aspect="equal",
             xlim=(-half[0], half[0]), ylim=(-half[1], half[1]))  # fmt: skip
    if view is VIEWS[0]:
        axes.legend(loc="upper right", fontsize=8, framealpha=0.9)


def _corners(fin: "Fin") -> list[Point]:
    """Return the corners of a rectangle with the fin's area, centred where its force acts."""
    length = sum(x * x for x in fin.axis) ** 0.5
    span = (fin.area * (fin.aspect_ratio or 1.0)) ** 0.5
    along, chord = [0.5 * span * x / length for x in fin.axis], [0.5 * fin.area / span * x for x in fin.frame[0]]
    corners = []
    for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
        x, y, z = (p + i * a + j * c for p, a, c in zip(fin.position, along, chord, strict=True))
        corners.append((x, y, z))
    return corners


def _draw_ballast(axes: Any, vehicle: Vehicle, view: View) -> None:
    marks = [(weight.position, "v", weight.name) for weight in vehicle.drop_weights]
    if vehicle.buoyancy_engine:
        marks.append((vehicle.buoyancy_engine.position, "s", "buoyancy engine"))
    for place, marker, name in marks:
        axes.plot(*view.flat(place), marker=marker, markersize=7, color=BALLAST, label=name, linestyle="none", zorder=2)


def _stacks(vehicle: Vehicle, view: View) -> dict[tuple[float, float], list[int]]:
    """Return the numbers of the thrusters at each point of the drawing, where several may coincide."""
    stacks: dict[tuple[float, float], list[int]] = {}
    for number, thruster in enumerate(vehicle.thrusters):
        across, up = view.flat(thruster.position)
        stacks.setdefault((round(across, 3) + 0.0, round(up, 3) + 0.0), []).append(number)
    return stacks


def _behind(vehicle: Vehicle, view: View, numbers: list[int]) -> tuple[float, float]:
    """Return the offset (points) of the numbers from their thrusters: opposite to the arrows, or below."""
    along = [view.flat(vehicle.thrusters[number].unit_direction) for number in numbers]
    x, y = sum(arrow[0] for arrow in along), sum(arrow[1] for arrow in along)
    length = (x * x + y * y) ** 0.5
    return (0.0, -17.0) if length < 2.0 * (1.0 - _FACING) else (-19.0 * x / length, -17.0 * y / length)


def _draw_thruster(axes: Any, vehicle: Vehicle, view: View, number: int, reach: float) -> None:
    thruster = vehicle.thrusters[number]
    x, y = view.flat(thruster.position)
    along = view.flat(thruster.unit_direction)
    towards = view.eye[1] * thruster.unit_direction[view.eye[0]]
    if abs(towards) < 1.0 - 1e-6:
        axes.annotate(
            "", (x + reach * along[0], y + reach * along[1]), (x, y), zorder=3,
            arrowprops={"arrowstyle": "-|>", "color": ARROW, "linewidth": 2.0, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
    facing = abs(towards) > _FACING
    axes.plot(x, y, marker="o", markersize=13 if facing else 6, markerfacecolor="white" if facing else ARROW,
              markeredgecolor=ARROW, markeredgewidth=1.6, zorder=3.5)  # fmt: skip
    if facing:
        axes.plot(
            x, y, marker="." if towards > 0.0 else "x", markersize=6, color=ARROW, markeredgewidth=1.6, zorder=3.6
        )


def _draw_speeds(axes: Any, capabilities: tuple[AxisCapability, ...]) -> None:
    """Draw bars for the four commanded axes, with m/s and rad/s on one scale."""
    drawn = [capability for capability in capabilities if capability.axis in ("surge", "sway", "heave", "yaw")]
    ticks = {"surge": ("ahead", "astern"), "sway": ("starboard", "port"), "heave": ("down", "up"),
             "yaw": ("to starboard", "to port")}  # fmt: skip
    names, speeds, units = [], [], []
    for capability in drawn:
        for way, speed in zip(ticks[capability.axis], capability.speed, strict=True):
            names.append(f"{capability.axis} {way}")
            speeds.append(abs(speed) if capability.driven and abs(speed) < float("inf") else 0.0)
            units.append(("rad/s" if capability.axis == "yaw" else "m/s") if capability.driven else "")
    colours = [SERIES[2] if unit != "rad/s" else SERIES[6] for unit in units]
    bars = axes.barh(range(len(names)), speeds, color=colours, height=0.7)
    labels = [f"{speed:.2f} {unit}" if unit else "cannot" for speed, unit in zip(speeds, units, strict=True)]
    axes.bar_label(bars, labels, padding=4, fontsize=9)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set(title="top speeds, one axis at a time", xlabel="m/s (yaw: rad/s)")
    axes.margins(x=0.18)
    axes.spines[["top", "right"]].set_visible(False)


def _parts(vehicle: Vehicle) -> str:
    counts = ((len(vehicle.thrusters), "thruster"), (len(vehicle.fins), "fin"))
    return ", ".join(f"{count} {name}{'s' if count > 1 else ''}" for count, name in counts if count)


def _name_thrusters(figure: Any, vehicle: Vehicle) -> None:
    names = [f"{number} {thruster.name}" for number, thruster in enumerate(vehicle.thrusters, 1)]
    lines = ["    ".join(names[start : start + 4]) for start in range(0, len(names), 4)]
    note = "arrows: positive thrust;  circle with dot: towards you, with cross: away from you"
    if vehicle.fins:
        lines.append("fins: " + ", ".join(fin.name for fin in vehicle.fins))
    figure.supxlabel("\n".join([*lines, note]), fontsize=10, color="0.25")
