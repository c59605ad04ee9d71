"""Ray casting against the seabed and what stands on it, in Python, C and OpenGL.

Public: `scene.RayScene`; `single` is the specification of all engines. It must not know what a sensor makes of a hit.
"""
