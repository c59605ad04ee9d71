"""Generated shapes for worlds: the `[[shape]]` tables of a world's file. They need no mesh files.

[[shape]]
kind = "net_pen"
north = 20.0
east = 5.0
diameter = 20.0                # a key of this kind

Sensors, collisions, planners and the view treat them as a `[[mesh]]`. A net is a lattice of twines: rays of light and
sound pass between the twines, vehicles do not.
"""

from array import array
from collections.abc import Callable, Iterable, Iterator
from math import hypot
from typing import Annotated, Any, Literal, NamedTuple, get_args

from hil.common.schema import Range, check_rows, kind_in, parse_split, read_each
from sim.environment.mesh import MeshKeys, MeshObstacle, Share, place_triangles
from sim.environment.obstacles import Coordinate, Heading
from sim.environment.things import primitives
from sim.environment.things.primitives import Triangle

Size = Annotated[float, Range(0.01, 1000.0, "m")]
Reach = Annotated[float, Range(0.0, 1000.0, "m")]
Twine = Annotated[float, Range(1e-4, 0.5, "m")]
Sides = Annotated[int, Range(3, 256)]
Colour = tuple[float, float, float]
Net = tuple[float, float] | None  # mesh width and twine, m

RUST, STEEL, CONCRETE, BLACK, TWINE = (
    (0.25, 0.11, 0.05), (0.40, 0.40, 0.40), (0.33, 0.32, 0.29), (0.04, 0.04, 0.05), (0.12, 0.15, 0.12),
)  # fmt: skip
_MAX_LINKS = 4000  # of 48 triangles; all other shapes have fewer
_POINTS = 65  # of a hanging rope or chain


class Part(NamedTuple):
    """Triangles with a common colour and echo (dB above other objects), and the lattice of a net or None."""

    triangles: list[Triangle]
    colour: Colour
    echo: float = 0.0
    net: Net = None


class ShapeKeys(NamedTuple):
    """The keys that every `[[shape]]` has; each kind has further ones.

    `depth` is that of its origin; if left out it is the seabed's, or 0 (the surface) for kinds that hang (rope, chain,
    net, net_pen). `orientation` is roll, pitch and yaw: without them, forward is north. `colour` replaces that of the
    kind, `echo` (dB) is added to that of the kind; `hidden` and `name` are as for other obstacles.
    """

    kind: Literal["pipe", "pile", "rope", "chain", "net", "net_pen", "box_wreck"]
    north: Coordinate
    east: Coordinate
    depth: Annotated[float, Range(-100.0, 11_000.0, "m")] | None = None
    orientation: tuple[Heading, Heading, Heading] = (0.0, 0.0, 0.0)
    scale: Annotated[float, Range(1e-3, 1e3)] = 1.0
    colour: tuple[Share, Share, Share] | None = None
    echo: Annotated[float, Range(-60.0, 60.0, "dB")] = 0.0
    hidden: bool = False
    name: str = ""


class Pipe(NamedTuple):
    """A straight steel pipe along the forward axis; its origin is below its middle. 3 dB more echo."""

    length: Size = 12.0
    diameter: Size = 0.6
    sides: Sides = 16

    def parts(self) -> list[Part]:
        """Return the parts it consists of."""
        half, radius = 0.5 * self.length, 0.5 * self.diameter
        line = [(-half, 0.0, -radius), (half, 0.0, -radius)]
        return [Part(primitives.tube(line, (0.0, 0.0, 1.0), radius, self.sides), STEEL, 3.0)]


class Pile(NamedTuple):
    """An upright pile of concrete; its origin is the centre of its lower end."""

    height: Size = 10.0
    diameter: Size = 0.8
    sides: Sides = 16

    def parts(self) -> list[Part]:
        """Return the parts it consists of."""
        line = [(0.0, 0.0, 0.0), (0.0, 0.0, -self.height)]
        return [Part(primitives.tube(line, (0.0, 1.0, 0.0), 0.5 * self.diameter, self.sides), CONCRETE)]


class Rope(NamedTuple):
    """A rope, hose or cable from its origin to `span` m forward and `drop` m down, `length` m long.

    It sags as a catenary, but not below its end. With `length` 0 it is taut.
    """

    span: Reach = 0.0
    drop: Annotated[float, Range(-1000.0, 1000.0, "m")] = 10.0
    length: Reach = 0.0
    diameter: Size = 0.03
    sides: Sides = 6

    def parts(self) -> list[Part]:
        """Return the parts it consists of."""
        line = primitives.hanging(self.span, self.drop, self.length, _POINTS if self.length else 2)
        return [Part(primitives.tube(line, (0.0, 1.0, 0.0), 0.5 * self.diameter, self.sides), BLACK)]


class Chain(NamedTuple):
    """A steel anchor chain that hangs as a rope; `bar` is the bar diameter of its links, which are 6 bars long.

    6 dB more echo.
    """

    span: Reach = 0.0
    drop: Annotated[float, Range(-1000.0, 1000.0, "m")] = 10.0
    length: Reach = 0.0
    bar: Annotated[float, Range(0.005, 1.0, "m")] = 0.05

    def parts(self) -> list[Part]:
        """Return the parts it consists of."""
        line = primitives.hanging(self.span, self.drop, self.length, _POINTS if self.length else 2)
        return [Part(primitives.links(line, self.bar), RUST, 6.0)]

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        count = max(self.length, hypot(self.span, self.drop)) / (4.0 * self.bar)
        return f"{count:.0f} links are more than {_MAX_LINKS}: take a thicker bar" if count > _MAX_LINKS else None


class NetPanel(NamedTuple):
    """A flat net, `width` m forward from its origin and `height` m down. It hangs; with a pitch or roll it can lie.

    `mesh` is the distance between twines, `twine` their thickness.
    """

    width: Size = 20.0
    height: Size = 5.0
    mesh: Twine = 0.05
    twine: Twine = 0.003

    def parts(self) -> list[Part]:
        """Return the parts it consists of."""
        width, height = (_multiple_of(size, self.mesh) for size in (self.width, self.height))
        ends = [(0.0, 0.0, 0.0), (width, 0.0, 0.0), (width, 0.0, height), (0.0, 0.0, height)]
        line = [(0.0, 0.0, 0.0), (width, 0.0, 0.0)]
        head = primitives.tube(line, (0.0, 0.0, 1.0), max(0.012, 2.0 * self.twine), 6)
        return [
            Part(primitives.quad(*ends), TWINE, 0.0, (self.mesh, self.twine)),
            Part(head, BLACK),
        ]

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return None if self.twine < self.mesh else "twine is not thinner than mesh"


class NetPen(NamedTuple):
    """A round fish pen: a floating collar of two tubes, a net `height` m deep with a bottom, and a sinker tube.

    Its origin is the centre of the collar. `mesh` is the distance between twines, `twine` their thickness.
    """

    diameter: Size = 20.0
    height: Size = 10.0
    mesh: Twine = 0.03
    twine: Twine = 0.0025
    collar: Size = 0.35
    sides: Sides = 24

    def parts(self) -> list[Part]:
        """Return the parts it consists of."""
        radius, upright = 0.5 * self.diameter, (0.0, 0.0, 1.0)
        top, foot = (primitives.ring(radius, down, self.sides) for down in (0.0, _multiple_of(self.height, self.mesh)))
        net = [t for k in range(self.sides) for t in primitives.quad(top[k - 1], top[k], foot[k], foot[k - 1])]
        net += primitives.disc(foot, (0.0, 0.0, foot[0][2]))
        outer = primitives.ring(radius + 2.0 * self.collar, 0.0, self.sides)
        tubes = [t for line in (top, outer) for t in primitives.tube(line, upright, 0.5 * self.collar, 8, closed=True)]
        tubes += primitives.tube(foot, upright, 0.25 * self.collar, 6, closed=True)
        return [Part(net, TWINE, 0.0, (self.mesh, self.twine)), Part(tubes, BLACK)]

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return None if self.twine < self.mesh else "twine is not thinner than mesh"


class BoxWreck(NamedTuple):
    """A small sunken steel ship: a hull with a bow, an open hold, a deck house and an inclined mast.

    It stands upright on its keel, unless `orientation` gives roll and pitch. Its origin is below its middle.
    """

    length: Size = 24.0
    width: Size = 6.0
    height: Size = 4.0

    def parts(self) -> list[Part]:
        """Return the parts it consists of."""
        x, y, deck = 0.5 * self.length, 0.5 * self.width, -self.height
        plan = [(-x, -y), (0.5 * x, -y), (x, 0.0), (0.5 * x, y), (-x, y)]
        rail = [(a, b, deck) for a, b in plan]
        keel = [(0.88 * a, 0.7 * b, 0.0) for a, b in plan]
        hull = primitives.prism(rail, keel, with_rim=False)
        half = 0.5 * y
        for low, high in (((-x, -y), (0.0, y)), ((0.0, -y), (0.4 * x, -half)), ((0.0, half), (0.4 * x, y)),
                          ((0.4 * x, -y), (0.5 * x, y))):  # fmt: skip
            (a, b), (c, d) = low, high
            hull += primitives.quad((a, b, deck), (c, b, deck), (c, d, deck), (a, d, deck))
        hull.append(((0.5 * x, -y, deck), (x, 0.0, deck), (0.5 * x, y, deck)))
        house = primitives.cuboid((-0.8 * x, -0.6 * y, 1.7 * deck), (-0.35 * x, 0.6 * y, deck))
        line = [(0.6 * x, 0.0, deck), (0.75 * x, 0.0, 2.4 * deck)]
        mast = primitives.tube(line, (0.0, 1.0, 0.0), 0.02 * self.width, 8)
        return [Part(hull + house + mast, RUST, 5.0)]


KINDS: dict[str, Any] = {
    "pipe": Pipe, "pile": Pile, "rope": Rope, "chain": Chain, "net": NetPanel, "net_pen": NetPen,
    "box_wreck": BoxWreck,
}  # fmt: skip
HANGS = {"rope", "chain", "net", "net_pen"}
assert set(get_args(ShapeKeys.__annotations__["kind"])) == set(KINDS)


def parse_shapes(rows: Any, where: str) -> list[tuple[ShapeKeys, Any]]:
    """Return of each `[[shape]]` table its common keys and those of its kind. Raises ConfigError."""
    check_rows(rows, where)
    return read_each([(row, f"{where}[{i}]") for i, row in enumerate(rows)], _parse_shape)


def _parse_shape(row: dict[str, Any], where: str) -> tuple[ShapeKeys, Any]:
    return parse_split(row, ShapeKeys, KINDS[kind_in(row, KINDS, where)], where)


def place_shapes(
    shapes: Iterable[tuple[ShapeKeys, Any]], seabed: Callable[[float, float], float]
) -> Iterator[MeshObstacle]:
    """Yield the meshes of the shapes that `parse_shapes` returned."""
    for placing, shape in shapes:
        depth = placing.depth
        if depth is None:
            depth = 0.0 if placing.kind in HANGS else seabed(placing.north, placing.east)
        name = placing.name or f"the {placing.kind.replace('_', ' ')} at ({placing.north:g}, {placing.east:g})"
        yield from (_place_part(part, placing, depth, name) for part in shape.parts())


def _place_part(part: Part, placing: ShapeKeys, depth: float, name: str) -> MeshObstacle:
    """Return one part as a mesh at the position of its shape."""
    scale = placing.scale
    triangles = array("d", [scale * x for triangle in part.triangles for corner in triangle for x in corner])
    net = (scale * part.net[0], scale * part.net[1]) if part.net else None
    keys = MeshKeys(
        "", placing.north, placing.east, depth, placing.orientation, colour=placing.colour or part.colour,
        echo=part.echo + placing.echo, hidden=placing.hidden, name=name,
    )  # fmt: skip
    return place_triangles(keys, triangles, net)


def _multiple_of(size: float, mesh: float) -> float:
    """Return the nearest size (m) that is a multiple of `mesh`, so that the lattice continues from panel to panel."""
    return max(1, round(size / mesh)) * mesh
