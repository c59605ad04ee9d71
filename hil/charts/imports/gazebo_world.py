"""Convert a Gazebo world (SDF) to a world file: its static shapes, its water, and its position on the earth."""

import os
from collections.abc import Sequence
from math import atan2, cos, hypot, pi, sin
from re import sub
from typing import Any, NamedTuple

from hil.charts.grid import write_file
from hil.charts.imports.gazebo_shapes import Shape, read_shapes
from hil.charts.imports.meshes import MeshJob, read_meshes
from hil.charts.world_file import keys_of
from hil.common.errors import ConfigError
from hil.common.text import clean
from sim.environment.world import World, load_world
from sim.matrices import product
from sim.sdf.files import SdfFiles
from sim.vehicle.urdf.pose import Pose
from sim.vehicle.urdf.text import Element, child_text, number_of, numbers_of, plain, read_xml

MARGIN = 5.0  # m of the world around all of its shapes
_UPRIGHT = 0.9999  # cosine of the greatest tilt at which a shape counts as upright
_DEFAULT_DEPTH = 50.0  # m, of a world that gives none
_THIN, _WIDE = 1.5, 20.0  # m: a shape that shows the water's surface is within _THIN of it and wider than _WIDE
_NEAR = 500.0  # m: a world of this size around the file's origin is extended to contain the origin
_SMALLEST = 100.0  # m, of a world whose file gives no floor with a size
_ENDLESS = 1e4  # m: a plane is taken to be no larger
_SHALLOW = 2.0  # m: no seabed is put just below shapes that reach no deeper
# Parts of the names of shapes and files that are the ground: without one that is missing, a world is not complete.
_GROUND = (
    "heightmap", "height_map", "terrain", "seabed", "sea_bed", "seafloor", "sea_floor", "ocean_floor", "sea_bottom",
    "bathymetry", "ground", "sand", "model://ocean", "model://lake",
)  # fmt: skip
_FARTHEST = 9e4  # m from the file's origin: greatest coordinate of a world
_COVERS = 0.9  # least share of the world's area that a floor covers
_HIGHEST, _MIN_SIDE = -100.0, 0.01  # m: limits of an obstacle's top and of its sides
_NED = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]  # of east, north, up
_FRD = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]  # of forward, left, up


class _PlacedShape(NamedTuple):
    """A shape, the corners of its bounding box (east, north, up from the water; m), and its STL file."""

    shape: Shape
    low: tuple[float, ...]
    high: tuple[float, ...]
    mesh: str = ""


class ImportedWorld(NamedTuple):
    """Result of an import: the loaded world, notes on what was assumed or left out, and what ground is `missing`."""

    world: World
    notes: list[str]
    missing: str = ""


def import_world(path: str, output: str, surface: float | None = None, text: bytes | None = None) -> ImportedWorld:
    """Write the world of the SDF at `path` to `output` (.toml), with meshes and depths beside it, and load the result.

    `surface`: height (m, z) of the water's surface in the file; by default that of its graded buoyancy, or 0. `text`
    is parsed instead of the file. Raises ConfigError, MissingExtraError.
    """
    root = read_xml(path, text, "sdf")
    world = root.find("world")
    if world is None:
        raise ConfigError(
            f"{path}: has no <world>: import a vehicle with `uuv-hil vehicle --import`, and another model with a world "
            "that has an <include> of it"
        )
    notes: list[str] = []
    files = SdfFiles(path)
    level = _surface(world, path) if surface is None else surface
    shapes = read_shapes(world, os.path.dirname(os.path.abspath(path)), files, notes, root.get("version", "1.12"))
    placed = _near(_placed(shapes, output, level, notes), notes)
    placed, floors, terrain, floor = _floors(placed, shapes, output, level, path, notes)
    extent = _extent(placed, floors, terrain)
    stem = os.path.splitext(os.path.basename(output))[0]
    table: dict[str, Any] = {
        "name": plain(world.get("name") or stem), "source": f"imported from {plain(os.path.basename(path))}",
        "extent": extent, "depth": _depth(placed, terrain, floor, path, level, notes),
        **_environment_keys(world, path, notes),
    }  # fmt: skip
    placed = _in_water(placed, table["depth"], notes)
    lines = [*(f"# {clean(note)}" for note in notes), *keys_of(table)]
    if terrain is not None:
        lines += ["", "[terrain]", *keys_of(terrain)]
    for each in placed:
        kind, keys = _obstacle(each, level, os.path.dirname(os.path.abspath(output)))
        lines += ["", f"[[{kind}]]", *keys_of(keys)]
    write_file(output, ("\n".join(lines) + "\n").encode())
    lost = [name for name in files.missing if any(word in name.lower() for word in _GROUND)]
    missing = f"{'; '.join(dict.fromkeys(lost))}: not found in {files.places()}" if lost else ""
    return ImportedWorld(load_world(output), notes, missing)


def _surface(world: Element, path: str) -> float:
    """Return the height (m) of the lowest change of density in the world's graded buoyancy, 0 if there is none."""
    for plugin in world.iter("plugin"):
        changes = [child_text(change, "above_depth") for change in plugin.findall("graded_buoyancy/density_change")]
        heights = [number_of(text, path) for text in changes if text is not None]
        if heights:
            return min(heights)
    return 0.0


def _placed(shapes: Sequence[Shape], output: str, level: float, notes: list[str]) -> list[_PlacedShape]:
    """Return the shapes with their bounding boxes; all but upright boxes and cylinders are written as meshes."""
    meshes = [shape for shape in shapes if shape.kind not in ("plane", "heightmap") and not _is_simple(shape)]
    keys = list(dict.fromkeys((shape.kind, shape.file, shape.sizes) for shape in meshes))
    folder = os.path.splitext(output)[0] + "_meshes"
    if keys:
        os.makedirs(folder, exist_ok=True)
    stems = [sub(r"\W", "_", os.path.splitext(os.path.basename(file or kind))[0])[:40] for kind, file, _ in keys]
    names = [os.path.join(folder, f"{number}_{stem}.stl") for number, stem in enumerate(stems)]
    jobs = [
        MeshJob(file, sizes if file else (1.0, 1.0, 1.0), None, name, None if file else {"kind": kind, "sizes": sizes})
        for (kind, file, sizes), name in zip(keys, names, strict=True)
    ]
    results = dict(zip(keys, zip(read_meshes(jobs), names, strict=True), strict=True)) if jobs else {}
    placed = []
    for shape in shapes:
        if shape.kind in ("plane", "heightmap"):
            continue
        if _is_simple(shape):
            radius, half = (shape.sizes[0], 0.5 * shape.sizes[-1])
            side = [0.5 * x for x in shape.sizes] if shape.kind == "box" else [radius, radius, half]
            placed.append(_boxed(shape, [-x for x in side], side, level))
            continue
        result, name = results[shape.kind, shape.file, shape.sizes]
        if "error" in result:
            notes.append(
                f"Left out: {shape.name}: {clean(os.path.basename(shape.file) or shape.kind)}: {result['error']}."
            )
        else:
            placed.append(_boxed(shape, result["low"], result["high"], level)._replace(mesh=name))
    return placed


def _is_simple(shape: Shape) -> bool:
    """True for an upright, solid box or cylinder, which is an obstacle of its own kind in a world."""
    return shape.is_solid and _is_upright(shape)


def _is_upright(shape: Shape) -> bool:
    return shape.kind in ("box", "cylinder") and abs(shape.pose.rotation[2][2]) > _UPRIGHT


def _boxed(shape: Shape, low: Sequence[float], high: Sequence[float], level: float) -> _PlacedShape:
    """Return a shape with its bounding box; `low` and `high` (m) are corners in its own axes."""
    corners = [shape.pose.transform([(high if n >> axis & 1 else low)[axis] for axis in range(3)]) for n in range(8)]
    columns = list(zip(*corners, strict=True))
    least, most = [min(column) for column in columns], [max(column) for column in columns]
    least[2], most[2] = least[2] - level, most[2] - level
    return _PlacedShape(shape, tuple(least), tuple(most))


def _near(placed: Sequence[_PlacedShape], notes: list[str]) -> list[_PlacedShape]:
    """Return the shapes within the greatest size of a world."""
    near = [each for each in placed if max(map(abs, (*each.low, *each.high))) < _FARTHEST]
    if far := [each.shape.name for each in placed if each not in near]:
        notes.append(f"Left out: more than {_FARTHEST:g} m from the file's origin: {', '.join(far)}.")
    return near


def _floors(
    placed: list[_PlacedShape], shapes: Sequence[Shape], output: str, level: float, path: str, notes: list[str]
) -> tuple[list[_PlacedShape], list[_PlacedShape], dict[str, Any] | None, float | None]:
    """Return the shapes that are neither floor nor water, those that are, the `[terrain]`, and the floor's z (m)."""
    terrain, floors, others, flat = None, [], [], []
    for shape in shapes:
        if shape.kind == "plane":
            height, (long, wide) = shape.pose.position[2] - level, (0.5 * min(x, _ENDLESS) for x in shape.sizes)
            if long and wide:
                flat.append(_boxed(shape, (-long, -wide, 0.0), (long, wide, 0.0), level))
            if shape.is_water or (not shape.is_solid and abs(height) < _THIN):
                notes.append(f"Left out: {shape.name}, which shows the water.")
            else:
                floors.append(height)
        elif shape.kind == "heightmap":
            if terrain is not None:
                notes.append(f"Left out: {shape.name}, a second heightmap.")
            else:
                terrain = _heightmap(shape, output, level, path, notes)
    area = _area(placed)
    for each in placed:
        sides = [b - a for a, b in zip(each.low, each.high, strict=True)]
        is_wide = min(sides[0], sides[1]) > _WIDE
        is_surface = is_wide and not each.shape.is_solid and max(abs(each.low[2]), abs(each.high[2])) < _THIN
        if is_surface or (each.shape.is_water and each.shape.is_clear):
            notes.append(f"Left out: {each.shape.name}, which shows the water.")
            flat.append(each)
        elif is_wide and _is_upright(each.shape) and each.high[2] < 0.0 and sides[0] * sides[1] > _COVERS * area:
            floors.append(each.high[2])
            flat.append(each)
            notes.append(f"{each.shape.name} is used as the floor.")
        else:
            others.append(each)
    return others, flat, terrain, min(floors, default=None) if terrain is None else None


def _area(placed: Sequence[_PlacedShape]) -> float:
    if not placed:
        return 0.0
    east, north = ([(p.low[axis], p.high[axis]) for p in placed] for axis in (0, 1))
    sides = [max(high for _, high in column) - min(low for low, _ in column) for column in (east, north)]
    return sides[0] * sides[1]


def _extent(
    placed: Sequence[_PlacedShape], floors: Sequence[_PlacedShape], terrain: dict[str, Any] | None
) -> tuple[float, float, float, float]:
    """Return south, north, west and east (m) of the world: that of its floors, and around all shapes, to 0.1 m."""
    margins = [(p, MARGIN) for p in placed] + [(p, 0.0) for p in floors]
    norths = [x for p, margin in margins for x in (p.low[1] - margin, p.high[1] + margin)]
    easts = [x for p, margin in margins for x in (p.low[0] - margin, p.high[0] + margin)]
    if terrain is not None:
        step, south, west = terrain["resolution"], terrain["north_min"], terrain["east_min"]
        norths += [south, south + step * (terrain["rows"] - 1)]
        easts += [west, west + step * (terrain["columns"] - 1)]
    if max(map(abs, (*norths, *easts)), default=0.0) < _NEAR:  # the vehicles of the file start near its origin
        norths, easts = [*norths, -MARGIN, MARGIN], [*easts, -MARGIN, MARGIN]
    if not floors and terrain is None:
        for ends in (norths, easts):
            middle = 0.5 * (min(ends) + max(ends))
            ends += [middle - 0.5 * _SMALLEST, middle + 0.5 * _SMALLEST]
    south, north, west, east = (round(end, 1) for end in (min(norths), max(norths), min(easts), max(easts)))
    return south, north, west, east


def _depth(
    placed: Sequence[_PlacedShape], terrain: dict[str, Any] | None, floor: float | None, path: str, level: float,
    notes: list[str],
) -> float:  # fmt: skip
    """Return the depth (m) of the flat seabed: that of the floor, or just below all shapes.

    Raises ConfigError for a floor above the water's surface.
    """
    wide_or_solid = [p for p in placed if p.shape.is_solid or min(p.high[0] - p.low[0], p.high[1] - p.low[1]) > _WIDE]
    lowest = min((p.low[2] for p in wide_or_solid), default=0.0)
    if terrain is not None:
        return round(max(float(terrain.pop("deepest")), 0.1), 3)
    if floor is not None:
        if floor > -0.1:
            raise ConfigError(
                f"{path}: its floor, at z = {floor + level:g} m, is not below the water's surface, at {level:g} m: "
                "give --surface M, the height of the surface in the file"
            )
        return round(-floor, 3)
    if lowest < -_SHALLOW:
        notes.append("The file gives no depth: the world has a flat seabed just below its lowest shape.")
        return round(-lowest + 0.1, 3)
    notes.append(f"The file gives no depth: the world is {_DEFAULT_DEPTH:g} m deep.")
    return _DEFAULT_DEPTH


def _in_water(placed: Sequence[_PlacedShape], depth: float, notes: list[str]) -> list[_PlacedShape]:
    """Return the shapes that are at least partly in the water, between its surface and the seabed."""
    in_water = [each for each in placed if each.low[2] < 0.0 and -each.high[2] < depth]
    names = [each.shape.name for each in placed if each not in in_water]
    if names:
        shown = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
        notes.append(f"Left out: shapes above the water or in the seabed: {shown}.")
    return in_water


def _obstacle(each: _PlacedShape, level: float, folder: str) -> tuple[str, dict[str, Any]]:
    """Return the kind of the obstacle made of a shape, and its keys in the world file."""
    shape = each.shape
    east, north, up = shape.pose.position
    vertical = {"top": max(-each.high[2], _HIGHEST), "bottom": -each.low[2]}
    if each.mesh:
        rotated = Pose(product(_NED, product(shape.pose.rotation, _FRD)))
        keys: dict[str, Any] = {
            "file": os.path.relpath(each.mesh, folder), "north": _round(north), "east": _round(east),
            "depth": _round(level - up), "orientation": tuple(_round(angle) for angle in rotated.angles()), "up": "z",
            "name": shape.name,
        }  # fmt: skip
        keys |= {"colour": tuple(_round(x) for x in shape.colour)} if shape.colour else {}
        return "mesh" if shape.is_solid else "visual", keys
    place = {"north": _round(north), "east": _round(east)}
    ends = {key: _round(value) for key, value in vertical.items()} | {"name": shape.name}
    first, second = (max(size, _MIN_SIDE) for size in shape.sizes[:2])
    if shape.kind == "cylinder":
        return "cylinder", place | {"radius": first} | ends
    heading = (1.5 * pi - shape.pose.angles()[2]) % (2.0 * pi) - pi
    return "box", place | {"size_north": first, "size_east": second, "heading": _round(heading)} | ends


def _heightmap(shape: Shape, output: str, level: float, path: str, notes: list[str]) -> dict[str, Any] | None:
    """Write the depths of a heightmap beside the world; return its `[terrain]` and `deepest` (m), None on an error."""
    element = shape.element
    assert element is not None
    size = numbers_of(child_text(element, "size") or "1 1 1", path, 3)
    position = shape.pose.transform(numbers_of(child_text(element, "pos") or "0 0 0", path, 3))
    depths = os.path.splitext(output)[0] + ".f32"
    if abs(shape.pose.angles()[2]) > 1e-6 or abs(shape.pose.rotation[2][2]) < _UPRIGHT:
        notes.append(f"Left out: {shape.name}, a heightmap that is rotated.")
        return None
    job = {"kind": "heightmap", "sizes": [*size, *position[:2], position[2] - level]}
    (result,) = read_meshes([MeshJob(shape.file, output=depths, shape=job)])
    if "error" in result:
        notes.append(f"Left out: {shape.name}: {clean(os.path.basename(shape.file))}: {result['error']}.")
        return None
    return {"file": os.path.basename(depths), **result}


def _environment_keys(world: Element, path: str, notes: list[str]) -> dict[str, Any]:
    """Return the keys for a world's origin, density, gravity, magnetic field and current."""
    keys: dict[str, Any] = {}
    if (sphere := world.find("spherical_coordinates")) is not None:
        numbers = [
            number_of(child_text(sphere, tag) or "0", path) for tag in ("latitude_deg", "longitude_deg", "elevation")
        ]
        if abs(numbers[0]) <= 90.0 and abs(numbers[1]) <= 180.0:
            keys |= {"origin": (numbers[0], numbers[1])} | ({"origin_altitude": numbers[2]} if numbers[2] else {})
        if number_of(child_text(sphere, "heading_deg") or "0", path):
            notes.append("Left out: heading_deg: x is used as east.")
    density = next((text for tag in ("uniform_fluid_density", "graded_buoyancy/default_density")
                    for plugin in world.iter("plugin") if (text := child_text(plugin, tag))), None)  # fmt: skip
    if density is not None and 900.0 <= number_of(density, path) <= 1200.0:
        keys["density"] = number_of(density, path)
    if (gravity := child_text(world, "gravity")) is not None and (pull := -numbers_of(gravity, path, 3)[2]) > 0.1:
        keys["gravity"] = pull
    if (field := child_text(world, "magnetic_field")) is not None:
        keys |= _field(numbers_of(field, path, 3))
    for plugin in world.iter("plugin"):
        keys |= _current(plugin, path)
    return keys


def _field(field: Sequence[float]) -> dict[str, Any]:
    """Return the key of a magnetic field (T; east, north, up): intensity (T), inclination, declination (rad)."""
    east, north, up = field
    level = hypot(east, north)
    strength = hypot(level, up)
    return {"magnetic_field": (strength, atan2(-up, level), atan2(east, north))} if 0.0 < strength < 1e-3 else {}


def _current(plugin: Element, path: str) -> dict[str, Any]:
    """Return the key of uuv_simulator's mean constant current, whose angles are from east to north, and upwards."""
    means = [
        child_text(plugin, f"constant_current/{tag}/mean") for tag in ("velocity", "horizontal_angle", "vertical_angle")
    ]
    if means[0] is None:
        return {}
    speed, level, rise = (number_of(text or "0", path) for text in means)
    flow = (speed * cos(rise) * sin(level), speed * cos(rise) * cos(level), -speed * sin(rise))
    return {"current": tuple(_round(x) for x in flow)} if speed and abs(speed) <= 5.0 else {}


def _round(x: float) -> float:
    return round(x, 6) + 0.0
