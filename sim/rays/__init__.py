"""Rays against the world: a sensor uses `scene.RayScene`; `single` says how, `batch` and sim.native repeat it."""
