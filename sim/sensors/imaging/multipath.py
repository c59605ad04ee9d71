"""Second echoes of a ping: sound that the surface or the seabed mirrors on its way to a thing, or on its way back.

A ray that meets the surface or the seabed goes on as in a mirror, up to a thing P. What P scatters comes back the same
way: range r12, the length of the bent way; or straight, if P can be seen, and with it what went straight and comes back
bent: range (r12 + d) / 2, d the straight distance. With R the loss of one reflection as a factor, b the beam pattern:

    echo / source = mu cos theta b² dO / r12² R²                         there and back bent
                    2 mu cos theta_d b b_d dO / d² R                     one way bent

The mirror has no roughness of its own but its loss. Not modelled: two reflections on one way, the phase
between ways, things smaller than the rays are apart there.
"""

from typing import Any

import numpy as np

from sim.rays.scene import SEABED, RayScene
from sim.sensors.imaging.echoes import Echoes, Floats, Mirrors, Rays, View, pattern

_OFF = 1e-3  # m from the mirror, where a way begins again
_SEEN = 0.05  # m: a thing's own roundness does not hide it
_LEAST = 1e-4  # of the strongest ray: weaker ones are not followed


def second_echoes(
    mirrors: Mirrors, scene: RayScene, view: View, rays: Rays, strengths: Floats, surface: int, absorption: float
) -> list[Echoes]:
    """Return the echoes by way of a mirror: there and back, and one way.

    `strengths` are mu by object, `surface` is the object's number, `absorption` dB/m.
    """
    on_surface = rays.object == surface
    bright = rays.weights > _LEAST * rays.weights.max()
    chosen = np.flatnonzero((on_surface | (rays.object == SEABED)) & bright & (rays.ranges > 0.0))
    if not len(chosen):
        return []
    loss = np.where(on_surface[chosen], 10.0 ** (-0.1 * mirrors.surface), 10.0 ** (-0.1 * mirrors.bottom))
    along, normals = rays.directions[chosen] @ view.turn.T, rays.normals[chosen]
    onwards = along - 2.0 * (along * normals).sum(axis=1)[:, None] * normals
    origins: Any = np.ascontiguousarray(rays.points[chosen] + _OFF * normals)
    hits = scene.hits(origins.ravel(), np.ascontiguousarray(onwards), view.reach)
    objects, further = np.frombuffer(hits.objects, np.int32), np.frombuffer(hits.distances)
    length = rays.ranges[chosen] + further
    back = (strengths[objects] > 0.0) & (length < view.reach) & (objects != surface)
    # The seabed by way of itself is what its rough side sends back anyway.
    back &= (objects != SEABED) | on_surface[chosen]
    if not back.any():
        return []
    returned = chosen[back]
    found = _Bounced(
        rays.weights[returned], rays.beam[returned], length[back], loss[back], strengths[objects[back]], objects[back],
        np.frombuffer(hits.points).reshape(-1, 3)[back], np.frombuffer(hits.normals).reshape(-1, 3)[back],
        onwards[back],
    )  # fmt: skip
    return [_there_and_back(found, absorption), _one_way(found, scene, view, absorption)]


class _Bounced:
    """Rays by way of a mirror: what they weigh, their beams, how long they are, and what they have met."""

    def __init__(
        self, weights: Any, beam: Any, length: Any, loss: Any, strength: Any, objects: Any, points: Any, normals: Any,
        along: Any,
    ) -> None:  # fmt: skip
        self.weights, self.beam, self.length, self.loss = weights, beam, length, loss
        self.strength, self.objects, self.points, self.normals = strength, objects, points, normals
        self.facing = np.maximum(-(normals * along).sum(axis=1), 0.0)

    def spread(self, facing: Floats, ranges: Floats) -> Floats:
        """Return half the depth (m) of a patch along the ray: that of a plane seen so, bounded."""
        size = ranges * np.sqrt(self.weights)
        half: Floats = 0.5 * size * np.sqrt(np.maximum(1.0 - facing**2, 0.0)) / np.maximum(facing, 0.1)
        return half


def _there_and_back(found: _Bounced, absorption: float) -> Echoes:
    energy = found.strength * found.facing * found.weights / found.length**2 * found.loss**2
    energy *= 10.0 ** (-0.2 * absorption * found.length)
    return _echoes(found, found.length, energy, found.facing, found.beam)


def _one_way(found: _Bounced, scene: RayScene, view: View, absorption: float) -> Echoes:
    straight = found.points - view.place
    distance = np.maximum(np.sqrt((straight**2).sum(axis=1)), 1e-3)
    straight /= distance[:, None]
    own = straight @ view.turn
    met = np.frombuffer(scene.ranges(view.place.tolist(), np.ascontiguousarray(straight), view.reach))
    facing = np.maximum(-(found.normals * straight).sum(axis=1), 0.0)
    across, down = np.arctan2(own[:, 1], own[:, 0]), np.arcsin(np.clip(own[:, 2], -1.0, 1.0))
    assert view.lattice is not None
    edges = view.lattice.across
    beam = np.floor((across - edges[0]) / (edges[1] - edges[0])).astype(np.int64)
    visible = (met > distance - _SEEN) & (beam >= 0) & (beam < len(edges) - 1)
    # b b_d dO is the geometric mean of b² dO and b_d² dO, the cells being as large.
    largest = found.weights.max()
    weights = np.sqrt(found.weights * largest) * pattern(down, view.height)
    energy = 2.0 * found.strength * facing * weights / distance**2 * found.loss
    energy *= np.where(visible, 10.0 ** (-0.1 * absorption * (found.length + distance)), 0.0)
    return _echoes(found, 0.5 * (found.length + distance), energy, facing, np.clip(beam, 0, len(edges) - 2))


def _echoes(found: _Bounced, ranges: Floats, energy: Floats, facing: Floats, beam: Any) -> Echoes:
    half = found.spread(facing, ranges)
    # None of them is in the way of the first echoes' objects: they count as nothing.
    return Echoes(ranges, ranges - half, ranges + half, energy, beam, np.full(len(ranges), -1, np.int32))
