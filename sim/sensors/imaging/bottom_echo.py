"""Texture of the seabed in a sonar's range bins: relief and composition finer than the terrain grid.

At grazing incidence the patch of one ray may be metres long on the seabed. So the texture is sampled at the position of
each range bin, interpolated between the hits of a beam's rays. By Lambert's rule the echo of a bin is proportional to
cos² of the angle of incidence, which the slope of the texture changes. The composition of the bottom adds a strength in
dB. Not modelled: shadows within the texture.
"""

import numpy as np
from numpy.typing import NDArray

from sim.environment.texture import Texture
from sim.rays.scene import SEABED
from sim.sensors.imaging.echoes import Bins, Echoes, Floats

_MAX_FACTOR = 10.0  # of the echo of one bin, relative to its mean
_MIN_COSINE = 0.03  # of the angle of incidence
_DIFFUSE_SHARE = 0.3  # of the echo, independent of the slope: a patch that faces away still scatters


def apply_texture(echoed: Floats, echoes: Echoes, bins: Bins, texture: Texture, stride: int) -> Floats:
    """Return the seabed's echoes `echoed` (beams x bins) multiplied by its texture.

    `stride` neighbouring beams share one texture: beams that are much wider than their spacing see the same seabed.
    """
    assert echoes.ground is not None
    origin, points, cos_incidence, shape = echoes.ground
    hit_seabed = (echoes.object[: len(points)] == SEABED) & np.isfinite(echoes.ranges[: len(points)])
    strided = echoed[::stride]
    lit_bins = np.flatnonzero(strided > 0.0)
    if not hit_seabed.any():
        return echoed
    ray_order, ray_positions = _sort_rays(echoes.ranges[: len(points)], hit_seabed, shape, _row_offset(bins))
    bin_positions = (np.arange(0, len(echoed), stride) * _row_offset(bins))[:, None] + bins.middles
    ray_numbers = np.interp(bin_positions.ravel()[lit_bins], ray_positions, np.arange(len(ray_positions), dtype=float))
    low = ray_numbers.astype(np.int32)
    share = (ray_numbers - low).astype(np.float32)
    north, east, cosine = (
        _interpolate(values[ray_order].astype(np.float32), low, share)
        for values in (points[:, 0] - origin[0], points[:, 1] - origin[1], cos_incidence)
    )
    np.maximum(cosine, np.float32(_MIN_COSINE), out=cosine)
    to_north, to_east, strength = texture.sample(north + np.float32(origin[0]), east + np.float32(origin[1]), bins.step)
    # The horizontal part of the ray's direction is the horizontal distance of the bin divided by its range.
    change = (to_north * north + to_east * east) / bins.middles.astype(np.float32)[lit_bins % bins.count]
    tilted = np.maximum(1.0 - change / cosine, 0.0)
    factor = np.float32(1.0 - _DIFFUSE_SHARE) * tilted * tilted + np.float32(_DIFFUSE_SHARE)
    factor *= np.exp(np.float32(0.1 * np.log(10.0)) * strength)
    factors = np.ones(strided.size, np.float32)
    factors[lit_bins] = np.minimum(factor, np.float32(_MAX_FACTOR))
    textured: Floats = echoed * np.repeat(factors.reshape(strided.shape), stride, axis=0)[: len(echoed)]
    return textured


def _interpolate(values: Floats, low: NDArray[np.int32], share: Floats) -> Floats:
    """Return `values` interpolated linearly: `share` of the way from index `low` to the next."""
    numbers: Floats = np.append(np.diff(values), np.float32(0.0)).take(low)
    numbers *= share
    numbers += values.take(low)
    return numbers


def _row_offset(bins: Bins) -> float:
    """Return an offset (m) above any range. Ranges plus beam number times offset increase over all beams."""
    return 4.0 * (bins.first + (bins.count + 2) * bins.step) + 1.0


def _sort_rays(
    ranges: Floats, hit_seabed: NDArray[np.bool_], shape: tuple[int, ...], row: float
) -> tuple[NDArray[np.int64], Floats]:
    """Return the rays that hit the seabed, sorted by beam and range, and their range plus beam number times `row`."""
    rays = np.flatnonzero(hit_seabed)
    ray_positions = (rays // shape[1]) * row + np.minimum(ranges[rays], 0.9 * row)
    ray_order = np.argsort(ray_positions, kind="stable")
    return rays[ray_order], ray_positions[ray_order]
