"""`uuv-hil world`: build worlds from charts and soundings; draw and export them; import those of Gazebo."""

import argparse
import os
from functools import partial
from importlib.util import find_spec
from math import inf
from typing import Any

from hil.commands.gridding import RESOLUTION, add_reading, show_progress
from hil.commands.vehicle.xacro_expand import expand, is_xacro
from hil.common.columns import aligned
from hil.common.errors import ConfigError, HilError, MissingExtraError
from hil.common.options import Number, add_json, add_output, add_plot, lat_lon, new_parser
from hil.common.schema import preset_names, shortened
from hil.common.tables import output_file
from hil.common.text import json_text
from sim.environment.world import World, load_world

EXAMPLES = """\
examples:
  uuv-hil world build US5AK5SI.000 --resolution 20 -o worlds/homer --plot homer.png
  uuv-hil world build US5AK5SI.000 US5AK5SJ.000 --area 59.58,-151.46,59.62,-151.38 -o worlds/spit
  uuv-hil world build survey.tif -o worlds/survey        GeoTIFF, BAG, GEBCO's NetCDF, XYZ or CSV as well
  uuv-hil world show worlds/homer.toml -o homer.png
  uuv-hil world export worlds/homer.toml homer.tif              a GeoTIFF, for other programs
  uuv-hil world export worlds/homer.toml homer.pgm --depth 10   or a map for planners
  uuv-hil world import harbour.sdf -o worlds/harbour     a world of Gazebo, with its meshes
  uuv-hil world list
A scenario flies in a world with `world = "worlds/homer.toml"`. Not for navigation.
"""
HEIGHT = Number(-11_000.0, 9000.0, "m")
REACH = Number(0.05, 1e6, "m")
DEPTH = Number(0.0, 11_000.0, "m")
NOTE = "Made with `uuv-hil world build`. Not for navigation. Depths count from the chart's datum (mostly low water)."


def main(arguments: list[str]) -> int:
    """Run one of build, show, export and list; return 0. Raises HilError."""
    # The linear systems are small: more threads would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    options = _parser().parse_args(arguments)
    if find_spec("numpy") is None:
        raise MissingExtraError("worlds need numpy: pip install 'uuv-hil[chart]'")
    run: Any = options.run
    return int(run(options))


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("world", __doc__, EXAMPLES)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    build = actions.add_parser("build", help="make a world from charts and soundings")
    build.add_argument(
        "files", metavar="FILE", nargs="+", help=".000 charts, .tif, .bag, .nc, .xyz, .csv, .laz; several"
    )
    add_output(build, "WORLD", "writes WORLD.toml and WORLD.f32; makes their folder", required=True)
    add_reading(build)
    build.add_argument("--area", metavar="S,W,N,E", type=area, help="degrees; --area=-34,... for the south [all data]")
    build.add_argument("--updates", action=argparse.BooleanOptionalAction, help="apply the .001... beside a chart")
    build.set_defaults(updates=True)  # not above: 3.10 would write it into the help
    build.add_argument(
        "--reach", metavar="M", type=REACH, help="distance from single soundings up to which the bed counts as known"
    )
    build.add_argument(
        "--priority", metavar="FILE=N", type=priority, action="append", default=[],
        help="where sources overlap, the greatest number is used [1 of rasters, 0 of others]",
    )  # fmt: skip
    add_plot(build, "draw it with soundings and contours")
    add_json(build)
    build.set_defaults(run=_build)
    show = actions.add_parser("show", help="draw a world")
    _add_world(show)
    add_output(show, "FILE.png", "the picture [NAME.png]")
    show.set_defaults(run=_show)
    export = actions.add_parser("export", help="write a world as a file of other programs")
    _add_world(export)
    export.add_argument("output", metavar="OUT.pgm|.tif", help="the file to write; its ending says what")
    export.add_argument(
        "--depth", metavar="M", type=DEPTH, help="for a .pgm: depth down to which the water must be free"
    )
    export.set_defaults(run=_export)
    importing = actions.add_parser("import", help="make a world from an SDF file of Gazebo")
    importing.add_argument("file", metavar="WORLD.sdf", help="the world's file, also .world or xacro")
    add_output(importing, "WORLD", "writes WORLD.toml, and meshes and depths beside it", required=True)
    importing.add_argument(
        "--surface",
        metavar="M",
        type=HEIGHT,
        help="height of the water's surface, z in the file [its buoyancy's, or 0]",
    )
    importing.set_defaults(run=_import)
    listing = actions.add_parser("list", help="list the worlds")
    listing.add_argument("folders", metavar="FOLDER", nargs="*", help="folder with worlds of your own")
    listing.set_defaults(run=_list)
    return parser


def _add_world(parser: argparse.ArgumentParser) -> None:
    """Add the world's name, and --resolution of the grid that is drawn or written."""
    parser.add_argument("world", metavar="NAME|FILE.toml", help="an installed world, or a .toml file")
    parser.add_argument("--resolution", metavar="M", type=RESOLUTION, help="[the world's own]")


def _build(options: argparse.Namespace) -> int:
    from hil.charts.build_process import read_and_build
    from hil.charts.chart_survey import GeoBox
    from hil.charts.describe import describe
    from hil.charts.sources.combine import ReadOptions
    from hil.charts.sources.sign import Declared
    from hil.charts.world_file import write_world

    path = (
        os.path.splitext(options.output)[0] + ".toml" if options.output.endswith(".toml") else f"{options.output}.toml"
    )
    try:
        survey, built = read_and_build(
            options.files,
            GeoBox(*options.area) if options.area else None,
            options.resolution,
            ReadOptions(
                Declared(options.positive, options.crs, options.unit, options.layer),
                options.updates,
                options.reach,
                dict(options.priority),
            ),
            show_progress,
        )
    finally:
        show_progress(1.0)  # remove the progress line, also on Ctrl-C
    lines = aligned([(f"  {name}", text) for name, text in describe(survey, built)])
    header = (NOTE, *(line.strip() for line in lines))
    write_world(path, built.model, survey.source, survey.origin, header)
    if options.plot:
        from hil.charts.picture import MapMarks, draw

        name = os.path.splitext(os.path.basename(path))[0]
        charted = built.model.charted
        marks = MapMarks(
            survey.soundings, survey.contours, survey.shore, survey.bridges, charted.pipelines, charted.zones
        )  # fmt: skip
        title = f"{name}: {survey.source}"
        draw(built.model.grid, built.model.cylinders, built.model.boxes, marks, title, options.plot)
    if options.json:
        print(json_text({"world": path, **built.report._asdict()}))
    else:
        print("\n".join([f"{path}: gridded in {built.report.seconds:.1f} s", *lines]))
    return 0


def _show(options: argparse.Namespace) -> int:
    import numpy as np

    from hil.charts.grid import overview
    from hil.charts.picture import MAX_PIXELS, MapMarks, draw

    world = load_world(options.world)
    path = options.output or f"{world.name}.png"
    grid = overview(world, MAX_PIXELS, options.resolution)
    meshes = tuple(triangle for mesh in world.mesh for triangle in np.reshape(mesh.placed, (-1, 3, 3))[..., :2])
    marks = MapMarks(pipelines=world.pipeline, zones=world.all_zones(), meshes=meshes)
    draw(grid, world.cylinder, world.box, marks, f"{world.name}: {world.source}", path)
    print(path)
    return 0


def _export(options: argparse.Namespace) -> int:
    ending = os.path.splitext(options.output)[1].lower()
    if ending not in (".pgm", ".tif", ".tiff"):
        raise ConfigError(f"{options.output}: no format {ending or 'without an ending'}: .pgm, .tif")
    if (options.depth is not None) != (ending == ".pgm"):
        raise ConfigError("--depth M goes with a map (.pgm), and a map needs it")
    world = load_world(options.world)
    note = _write(world, output_file(options.output), options.resolution, options.depth)
    print(f"{options.output}: {note}")
    return 0


def _write(world: World, path: str, resolution: float | None, depth: float | None) -> str:
    """Write `world` as a GeoTIFF, or its map at `depth` (m); return a line that describes the file."""
    from hil.charts.grid import frame_of, read_rows

    frame = frame_of(world, resolution)
    if depth is not None:
        from hil.charts.describe import percent
        from hil.scenario.world_map import map_at

        cells = map_at(world, depth, 0.0, frame.resolution, is_coarse=True, above=inf)
        cells.write_pgm(path)
        return (
            f"{percent(1.0 - float(cells.cells.mean()))} of it free {depth:g} m down; {os.path.splitext(path)[0]}.yaml"
        )
    from hil.charts.geotiff import write_geotiff

    write_geotiff(frame, world.origin, path, partial(read_rows, world, frame))
    return "heights in m" + ("" if world.origin else ", without a place on the earth: the world has no origin")


def _import(options: argparse.Namespace) -> int:
    from hil.charts.imports.gazebo_world import import_world

    path = options.output if options.output.endswith(".toml") else f"{options.output}.toml"
    text = expand(options.file) if is_xacro(options.file) else None
    world, notes, missing = import_world(options.file, output_file(path), options.surface, text)
    parts = [f"{len(world.cylinder)} piles", f"{len(world.box)} blocks", f"{len(world.mesh)} meshes"]
    bed = "a relief" if world.terrain else "a flat seabed"
    south, north, west, east = world.extent
    print(
        f"{path}: {world.name}, {north - south:g} x {east - west:g} m, {bed} at {world.depth:g} m, {', '.join(parts)}"
    )
    for note in notes:
        print(f"note: {note}")
    if missing:
        raise HilError(f"{options.file}: {path} lacks its ground: {missing}")
    return 0


def _list(options: argparse.Namespace) -> int:
    names = preset_names("sim/worlds")
    for folder in options.folders:
        if not os.path.isdir(folder):
            raise ConfigError(f"{folder}: no such folder")
        names += sorted(os.path.join(folder, name) for name in os.listdir(folder) if name.endswith(".toml"))
    worlds = {name: load_world(name) for name in names}
    rows = [("world", "size", "depth", "bed", "obstacles", "source")]
    for name, world in worlds.items():
        south, north, west, east = world.extent
        bed = f"{world.terrain.grid.resolution:g} m grid" if world.terrain else "flat"
        count = len(world.cylinder) + len(world.box)
        rows.append((
            name, f"{north - south:.4g} x {east - west:.4g} m", f"{world.depth:.4g} m", bed, str(count), world.source
        ))  # fmt: skip
    print("\n".join(aligned(rows)))
    return 0


def priority(text: str) -> tuple[str, int]:
    """Return file and number of FILE=N."""
    file, _, number = text.rpartition("=")
    try:
        return file, int(number)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected FILE=N with a whole number, found {text!r}") from None


def area(text: str) -> tuple[float, float, float, float]:
    """Return south, west, north and east (degrees) of S,W,N,E; east is beyond 180 where the area crosses that."""
    words = text.split(",")
    try:
        (south, west), (north, east) = lat_lon(",".join(words[:2])), lat_lon(",".join(words[2:]))
        if south < north and west != east:
            return south, west, north, east if west < east else east + 360.0
    except argparse.ArgumentTypeError:
        pass
    form = "SOUTH,WEST,NORTH,EAST in degrees, south to north growing, from west to east, across 180 too"
    raise argparse.ArgumentTypeError(f"expected {form}, found {shortened(text)}")
