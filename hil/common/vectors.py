"""Types of vectors in space: tuples of floats, which cost the real-time loop less than objects or arrays."""

Vector3 = tuple[float, float, float]  # x, y, z of a frame that the name of the value or its docstring says
Quaternion = tuple[float, float, float, float]  # w, x, y, z: from the body's frame to the world's
