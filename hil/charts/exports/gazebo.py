"""Export a world for Gazebo (gz-sim): SDF, a height map of 16 bits, and a ground texture."""

import io
import os
from collections.abc import Callable, Iterator
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from hil.charts.grid import STRIP_ROWS, Grid, write_file
from hil.common.errors import MissingExtraError
from sim.environment.obstacles import Box, Cylinder
from sim.environment.world import World

MAX_NODES = 2049  # along a side; Gazebo requires 2^n + 1
LEVELS = 65535
WALL = 0.2  # m thick
_PLUGINS = {
    "physics": "Physics", "user-commands": "UserCommands", "scene-broadcaster": "SceneBroadcaster",
    "sensors": "Sensors", "imu": "Imu", "altimeter": "Altimeter",
}  # fmt: skip


def write_gazebo(world: World, grid: Grid, path: str) -> float:
    """Write the SDF `path` (`.sdf`) and its images beside it; return the greatest rounding error of a height (m).

    x is east, y north, z up, and the water's surface is at 0. Unknown depths become a wall, as high as the highest land
    or shoal. The world has buoyancy but no current, which is part of a vehicle's plugin in Gazebo. Raises ConfigError.
    """
    image, low, high = height_map(grid, world.terrain.unmap if world.terrain else None)
    stem = os.path.splitext(path)[0]
    write_png(image, f"{stem}_heights.png")
    write_png(np.full((8, 8, 3), (194, 178, 128), np.uint8), f"{stem}_sand.png")
    write_png(np.full((8, 8, 3), (128, 128, 255), np.uint8), f"{stem}_normals.png")
    write_file(path, _sdf(world, grid, low, high, os.path.basename(stem)).encode())
    return (high - low) / LEVELS / 2.0


def height_map(grid: Grid, unmap: Callable[[], None] | None = None) -> tuple[NDArray[np.uint16], float, float]:
    """Return a square image with 2^n + 1 nodes along a side, north first, and the heights (m) of its 0 and 65535.

    `unmap` releases the pages of a memory-mapped grid. It is called after each strip of rows.
    """
    side = _side(grid)
    south, north, west, east = grid.extent
    columns = np.clip(np.linspace(west, east, side), west, east)
    heights = np.empty((side, side), np.float32)
    for index, row in enumerate(np.clip(np.linspace(south, north, side), south, north)):
        heights[index] = -grid.at(np.column_stack([np.full(side, row), columns]))
        if unmap and index % STRIP_ROWS == 0:
            unmap()
    low, high = float(np.nanmin(heights)), float(np.nanmax(heights))
    high = max(high, low + 0.01)  # a flat bed needs a range other than 0
    levels = np.empty((side, side), np.uint16)
    for index, line in enumerate(heights[::-1]):
        levels[index] = np.rint((np.nan_to_num(line.astype(float), nan=high) - low) / (high - low) * LEVELS)
    return levels, low, high


def height_map_spacing(grid: Grid) -> float:
    """Return the greater spacing of the nodes of the height map (m)."""
    south, north, west, east = grid.extent
    return max(north - south, east - west) / (_side(grid) - 1)


def _side(grid: Grid) -> int:
    """Return the number of nodes along a side of the height map."""
    side = 3
    while side < min(max(grid.depths.shape), MAX_NODES):
        side = 2 * side - 1
    return side


def _sdf(world: World, grid: Grid, low: float, high: float, stem: str) -> str:
    south, north, west, east = grid.extent
    field = f"""
            <heightmap>
              <uri>{stem}_heights.png</uri>
              <size>{east - west:.3f} {north - south:.3f} {high - low:.4f}</size>
              <pos>{0.5 * (west + east):.3f} {0.5 * (south + north):.3f} {low:.4f}</pos>"""
    ground = f"""
              <texture><diffuse>{stem}_sand.png</diffuse><normal>{stem}_normals.png</normal><size>10</size></texture>"""
    plugins = "\n".join(
        f'    <plugin filename="gz-sim-{name}-system" name="gz::sim::systems::{kind}"/>'
        for name, kind in _PLUGINS.items()
    )
    return f"""<?xml version="1.0"?>
<!-- {escape(world.source).replace("--", "- -")} -->
<sdf version="1.9">
  <world name={quoteattr(world.name)}>
    <gravity>0 0 {-world.gravity:g}</gravity>
    <physics name="1ms" type="ignored"><max_step_size>0.001</max_step_size></physics>
{plugins}
    <plugin filename="gz-sim-buoyancy-system" name="gz::sim::systems::Buoyancy">
      <graded_buoyancy>
        <default_density>{world.density:g}</default_density>
        <density_change><above_depth>0</above_depth><density>1.2</density></density_change>
      </graded_buoyancy>
    </plugin>
{_origin(world)}    <light type="directional" name="sun">
      <pose>0 0 100 0 0 0</pose>
      <direction>-0.5 0.1 -0.9</direction>
    </light>
    <model name="seabed">
      <static>true</static>
      <link name="link">
        <collision name="collision">
          <geometry>{field}
            </heightmap>
          </geometry>
        </collision>
        <visual name="visual">
          <geometry>{field}{ground}
            </heightmap>
          </geometry>
        </visual>
      </link>
    </model>
{"".join(_obstacles(world, grid))}  </world>
</sdf>
"""


def _origin(world: World) -> str:
    if world.origin is None:
        return ""
    latitude, longitude = world.origin
    return f"""    <spherical_coordinates>
      <surface_model>EARTH_WGS84</surface_model>
      <world_frame_orientation>ENU</world_frame_orientation>
      <latitude_deg>{latitude:.9f}</latitude_deg>
      <longitude_deg>{longitude:.9f}</longitude_deg>
      <elevation>{world.origin_altitude:g}</elevation>
      <heading_deg>0</heading_deg>
    </spherical_coordinates>
"""


def _obstacles(world: World, grid: Grid) -> Iterator[str]:
    """Yield static models, from the bed to their tops; those that rise above the water end 5 m above it."""
    standing: tuple[Cylinder | Box, ...] = (*world.cylinder, *world.box, *_walls(world))
    for number, obstacle in enumerate(standing):
        bed = float(grid.at(np.array([[obstacle.north, obstacle.east]]))[0])
        if not np.isfinite(bed):
            continue
        bed = min(bed, obstacle.bottom)
        top = max(obstacle.top, -5.0)
        height = bed - top
        if height > 0.0:
            yield _model(f"obstacle_{number}", obstacle, -0.5 * (top + bed), height)


def _walls(world: World) -> list[Box]:
    """Return the walls of a pool as boxes on the edges of its extent, where the depth of the bed is defined."""
    if not world.walls:
        return []
    south, north, west, east = world.extent
    middle_north, middle_east = 0.5 * (south + north), 0.5 * (west + east)
    across = [Box(edge, middle_east, WALL, east - west, top=-1.0) for edge in (south, north)]
    return across + [Box(middle_north, edge, north - south, WALL, top=-1.0) for edge in (west, east)]


def _model(name: str, obstacle: Cylinder | Box, z: float, height: float) -> str:
    if isinstance(obstacle, Cylinder):
        yaw, shape = 0.0, f"<cylinder><radius>{obstacle.radius:g}</radius><length>{height:.3f}</length></cylinder>"
    else:  # its first side points `heading` clockwise from north; angles of ENU are counter-clockwise from east
        yaw = 0.5 * np.pi - obstacle.heading
        shape = f"<box><size>{obstacle.size_north:g} {obstacle.size_east:g} {height:.3f}</size></box>"
    return f"""    <model name="{name}">
      <static>true</static>
      <pose>{obstacle.east:.3f} {obstacle.north:.3f} {z:.3f} 0 0 {yaw:.6f}</pose>
      <link name="link">
        <collision name="collision"><geometry>{shape}</geometry></collision>
        <visual name="visual"><geometry>{shape}</geometry></visual>
      </link>
    </model>
"""


def write_png(image: NDArray[np.uint16] | NDArray[np.uint8], path: str) -> None:
    """Write an image: grey as (rows, columns) of 8 or 16 bits, or RGB as (rows, columns, 3) of 8 bits.

    Raises ConfigError if `path` cannot be written, MissingExtraError without Pillow.
    """
    try:
        from PIL import Image
    except ImportError:
        raise MissingExtraError(f"{path}: pictures need Pillow: pip install 'uuv-hil[imaging]'") from None
    encoded = io.BytesIO()
    Image.fromarray(image).save(encoded, "PNG")
    write_file(path, encoded.getvalue())
