"""Put the pictures of a vehicle's camera on the map: a mosaic of the seabed."""

from collections.abc import Sequence
from math import tan

import numpy as np
from numpy.typing import NDArray

from hil.charts.dive.watch import Observation
from hil.charts.grid import Grid
from hil.scenario.config import Scenario
from sim.rotations import from_euler, matrix
from sim.sensors.mounting import Mounting

REACH = 10.0  # m from the camera; light from beyond has lost its contrast in most waters
DARK_AND_BRIGHT = (0.02, 0.98)  # quantiles of the brightness, which are stretched
MIDDLE, CONTRAST = 140.0, 170.0  # of 255: mean of each colour, and difference of dark and bright
NEAREST = 0.1  # m ahead of the camera

Array = NDArray[np.float64]


def stitch(
    scenario: Scenario, observations: Sequence[Observation], bed: Grid, extent: Sequence[float], resolution: float
) -> NDArray[np.uint8]:
    """Return the colours of the seabed (rows to the north, columns to the east, RGBA; not seen: transparent).

    `extent`: south, north, west, east (m); `resolution`: m of a pixel. A pixel is from the picture that was taken
    nearest to it, without the water's colour and with more contrast. What stands on the bed is flattened onto it;
    lens distortion is neglected.
    """
    model, mounting = scenario.sensors["camera"].model, scenario.sensors["camera"].mounting
    focal = 0.5 * model.width / tan(0.5 * model.field_of_view)
    centre = 0.5 * (model.width - 1), 0.5 * (model.height - 1)
    north, east = (np.arange(low + 0.5 * resolution, high, resolution) for low, high in (extent[:2], extent[2:]))
    colours = np.zeros((len(north), len(east), 4), np.uint8)
    nearest = np.full((len(north), len(east)), REACH)
    for observation in observations:
        place, axes = _camera_pose(observation, mounting)
        rows, columns = (
            slice(*np.searchsorted(nodes, (middle - REACH, middle + REACH)))
            for nodes, middle in ((north, place[0]), (east, place[1]))
        )
        ground = np.stack(np.meshgrid(north[rows], east[columns], indexing="ij"), axis=-1).reshape(-1, 2)
        away = np.column_stack([ground, bed.at(ground)]) - place
        ahead, *across = (away @ axes).T
        distance = np.where(ahead > NEAREST, np.linalg.norm(away, axis=1), np.nan)
        right, down = (focal * side / np.maximum(ahead, NEAREST) for side in across)
        inside = (np.abs(right) <= centre[0]) & (np.abs(down) <= centre[1])
        part = nearest[rows, columns]
        seen = inside & (distance < part.ravel())
        column, row = ((side[seen] + mid).round().astype(int) for side, mid in zip((right, down), centre, strict=True))
        picture = np.frombuffer(observation.camera.data, np.uint8).reshape(model.height, model.width, 3)
        part[seen.reshape(part.shape)] = distance[seen]
        colours[rows, columns][seen.reshape(part.shape)] = np.insert(picture[row, column], 3, 255, axis=1)
    if (shown := colours[..., 3] > 0).any():
        bands = colours[shown, :3].astype(float)
        dark, bright = np.quantile(bands.mean(axis=1), DARK_AND_BRIGHT)
        balanced = MIDDLE + CONTRAST * (bands - bands.mean(axis=0)) / max(bright - dark, 1.0)
        colours[shown, :3] = np.clip(balanced, 0.0, 255.0)
    return colours


def _camera_pose(observation: Observation, mounting: Mounting) -> tuple[Array, Array]:
    """Return the camera's position (m, NED) when it took the picture, and its axes ahead, right, down as columns."""
    state = observation.truth
    attitude = np.reshape(matrix(state.orientation), (3, 3))
    age = 1e-9 * (state.time_ns - observation.camera.time_ns)
    place = np.array(state.position) + attitude @ (np.array(mounting.position) - age * np.array(state.nu[:3]))
    return place, attitude @ np.reshape(matrix(from_euler(*mounting.orientation)), (3, 3))
