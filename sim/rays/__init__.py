"""Ray casting against the seabed and solid objects, in Python and C.

Public: `scene.RayScene`; `single` is the specification of all engines; also `solids`. It must not depend on how sensors
use hits.
"""
