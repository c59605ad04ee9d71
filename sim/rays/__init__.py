"""Ray casting against the world. A sensor uses `scene.RayScene`; `single` is the specification of all engines."""
