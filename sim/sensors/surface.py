"""Submersion of a sensor, for sensors that work only in water or only in air."""

from collections.abc import Sequence

from sim.sensors.samples import Scene


def submersion(scene: Scene, time_ns: int, position: Sequence[float]) -> float:
    """Return the depth (m) of `position` (NED, m) below the surface, waves included; negative in the air."""
    north, east, depth = position
    wave_field = scene.wave_field
    return depth + wave_field.elevation(time_ns * 1e-9, north, east) if wave_field else depth
