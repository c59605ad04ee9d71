"""Second echoes of a ping: sound that the surface or the seabed reflects on its way to an object or back.

A ray that hits the surface or the seabed is reflected as by a mirror and hits a point P of an object. P scatters the
sound back on two paths:

- Along the same reflected path. The range is r12, the length of the reflected path.
- Directly, if P is visible from the sonar. The range is (r12 + d) / 2, with the direct distance d. Sound on the same
  path in the opposite sense has the same range.

With the loss R of one reflection (a factor) and the beam pattern b:

    echo / source = mu cos theta b² dO / r12² R²                         reflected on both ways
                    2 mu cos theta_d b b_d dO / d² R                     reflected on one way

Roughness of the reflecting surface is included only in its loss. Not modelled: two reflections on one way, the phase
between the paths, objects smaller than the spacing of the reflected rays.
"""

from typing import Any, NamedTuple

import numpy as np

from sim.rays.scene import SEABED, RayScene
from sim.sensors.imaging.echoes import Echoes, Floats, Rays, SonarPose, beam_pattern

_START_OFFSET = 1e-3  # m: start of a reflected ray above the reflecting surface
_VISIBLE_TOLERANCE = 0.05  # m: tolerance of the test of visibility
_MIN_WEIGHT = 1e-4  # of the largest weight: rays with less are not reflected


def second_echoes(
    losses: tuple[float, float],
    scene: RayScene,
    pose: SonarPose,
    rays: Rays,
    strengths: Floats,
    surface: int,
    absorption: float,
) -> list[Echoes]:
    """Return the echoes that are reflected on both ways, and those that are reflected on one way.

    `losses` are those of one reflection at the surface and at the seabed (dB), `strengths` are mu by object number,
    `surface` is the object number of the water's surface, `absorption` in dB/m.
    """
    on_surface = rays.object == surface
    bright = rays.weights > _MIN_WEIGHT * rays.weights.max()
    chosen = np.flatnonzero((on_surface | (rays.object == SEABED)) & bright & (rays.ranges > 0.0))
    if not len(chosen):
        return []
    factors = np.where(on_surface[chosen], 10.0 ** (-0.1 * losses[0]), 10.0 ** (-0.1 * losses[1]))
    incoming, normals = rays.directions[chosen] @ pose.rotation.T, rays.normals[chosen]
    outgoing = incoming - 2.0 * (incoming * normals).sum(axis=1)[:, None] * normals
    origins: Any = np.ascontiguousarray(rays.points[chosen] + _START_OFFSET * normals)
    hits = scene.hits(origins.ravel(), np.ascontiguousarray(outgoing), pose.reach)
    objects, reflected_lengths = np.frombuffer(hits.objects, np.int32), np.frombuffer(hits.distances)
    length = rays.ranges[chosen] + reflected_lengths
    echoing = (strengths[objects] > 0.0) & (length < pose.reach) & (objects != surface)
    # Seabed that is lit by a reflection at the seabed is left out: direct scattering already includes it.
    echoing &= (objects != SEABED) | on_surface[chosen]
    if not echoing.any():
        return []
    returned = chosen[echoing]
    hit_normals = np.frombuffer(hits.normals).reshape(-1, 3)[echoing]
    reflected = _ReflectedRays(
        weights=rays.weights[returned],
        beam=rays.beam[returned],
        length=length[echoing],
        factors=factors[echoing],
        strength=strengths[objects[echoing]],
        objects=objects[echoing],
        points=np.frombuffer(hits.points).reshape(-1, 3)[echoing],
        normals=hit_normals,
        cos_incidence=np.maximum(-(hit_normals * outgoing[echoing]).sum(axis=1), 0.0),
    )
    return [_reflected_twice(reflected, absorption), _reflected_once(reflected, scene, pose, absorption)]


class _ReflectedRays(NamedTuple):
    """Reflected rays (n): weights, beams, lengths (m), factors of the reflection's loss, and what they hit."""

    weights: Any
    beam: Any
    length: Any
    factors: Any
    strength: Any
    objects: Any
    points: Any
    normals: Any
    cos_incidence: Any

    def half_depth_of(self, cos_incidence: Floats, ranges: Floats) -> Floats:
        """Return half the length (m) of a plane patch along the ray, limited at grazing incidence."""
        size = ranges * np.sqrt(self.weights)
        half_depth: Floats = (
            0.5 * size * np.sqrt(np.maximum(1.0 - cos_incidence**2, 0.0)) / np.maximum(cos_incidence, 0.1)
        )
        return half_depth


def _reflected_twice(reflected: _ReflectedRays, absorption: float) -> Echoes:
    energy = (
        reflected.strength * reflected.cos_incidence * reflected.weights / reflected.length**2 * reflected.factors**2
    )
    energy *= 10.0 ** (-0.2 * absorption * reflected.length)
    return _echoes(reflected, reflected.length, energy, reflected.cos_incidence, reflected.beam)


def _reflected_once(reflected: _ReflectedRays, scene: RayScene, pose: SonarPose, absorption: float) -> Echoes:
    direct = reflected.points - pose.position
    distance = np.maximum(np.sqrt((direct**2).sum(axis=1)), 1e-3)
    direct /= distance[:, None]
    local = direct @ pose.rotation
    direct_ranges = np.frombuffer(scene.ranges(pose.position.tolist(), np.ascontiguousarray(direct), pose.reach))
    cos_incidence = np.maximum(-(reflected.normals * direct).sum(axis=1), 0.0)
    across, down = np.arctan2(local[:, 1], local[:, 0]), np.arcsin(np.clip(local[:, 2], -1.0, 1.0))
    assert pose.lattice is not None
    edges = pose.lattice.across
    beam = np.floor((across - edges[0]) / (edges[1] - edges[0])).astype(np.int64)
    visible = (direct_ranges > distance - _VISIBLE_TOLERANCE) & (beam >= 0) & (beam < len(edges) - 1)
    # b b_d dO is the geometric mean of b² dO and b_d² dO, as both cells have the same size.
    largest = reflected.weights.max()
    weights = np.sqrt(reflected.weights * largest) * beam_pattern(down, pose.height)
    energy = 2.0 * reflected.strength * cos_incidence * weights / distance**2 * reflected.factors
    energy *= np.where(visible, 10.0 ** (-0.1 * absorption * (reflected.length + distance)), 0.0)
    return _echoes(
        reflected, 0.5 * (reflected.length + distance), energy, cos_incidence, np.clip(beam, 0, len(edges) - 2)
    )


def _echoes(reflected: _ReflectedRays, ranges: Floats, energy: Floats, cos_incidence: Floats, beam: Any) -> Echoes:
    half_depth = reflected.half_depth_of(cos_incidence, ranges)
    # Object -1 (nothing): the edges of first echoes must not be limited by second echoes.
    return Echoes(ranges, ranges - half_depth, ranges + half_depth, energy, beam, np.full(len(ranges), -1, np.int32))
