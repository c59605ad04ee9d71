"""One legend for all that is drawn: path, track, goal, obstacles."""

RGB = tuple[int, int, int]

PATH: RGB = (37, 99, 235)
TRACK: RGB = (234, 88, 12)
NAVIGATION: RGB = (147, 51, 234)
GOAL: RGB = (22, 163, 74)
OBSTACLE: RGB = (100, 116, 139)
THRUST: RGB = (220, 38, 38)
THRUSTER: RGB = (30, 41, 59)
HULL: RGB = (250, 204, 21)
CURRENT: RGB = (14, 165, 233)
LASER: RGB = (239, 68, 68)
PROFILER: RGB = (16, 185, 129)
SONAR: RGB = (245, 158, 11)
WATER: RGB = (56, 132, 200)
CONTOUR: RGB = (20, 40, 60)
LEGEND = (("planned path", PATH), ("track", TRACK), ("track by navigation", NAVIGATION), ("goal", GOAL),
          ("obstacle", OBSTACLE), ("thrust", THRUST), ("current", CURRENT))  # fmt: skip


def css(colour: RGB) -> str:
    """A colour as CSS writes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
