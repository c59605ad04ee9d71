"""Ray casting against the seabed and solid objects, in Python, C and OpenGL.

Public: `scene.RayScene`; `single` is the specification of all engines; also `solids`. It must not depend on how sensors
use hits.
"""
