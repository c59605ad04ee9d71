"""The colours of the scene. Those that other pictures have too are from `hil.common.palette`."""

from collections.abc import Sequence

from hil.common import palette

RGB = tuple[int, int, int]


def _rgb(colour: str) -> RGB:
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


PATH, TRACK, NAVIGATION, GOAL, OBSTACLE, TETHER = (
    _rgb(getattr(palette, name)) for name in ("PATH", "TRACK", "NAVIGATION", "GOAL", "OBSTACLE", "TETHER")
)
THRUST: RGB = (220, 38, 38)
THRUSTER: RGB = (30, 41, 59)
HULL: RGB = (250, 204, 21)
CURRENT: RGB = (14, 165, 233)
LASER: RGB = (239, 68, 68)
PROFILER: RGB = (16, 185, 129)
SONAR: RGB = (245, 158, 11)
LINK: RGB = (22, 163, 74)
PLACE: RGB = (217, 70, 239)
WATER: RGB = (56, 132, 200)
ZONE: RGB = (190, 24, 160)  # magenta, as on charts
CONTOUR: RGB = (20, 40, 60)
LEGEND = (("planned path", PATH), ("track", TRACK), ("track by navigation", NAVIGATION), ("goal", GOAL),
          ("obstacle", OBSTACLE), ("thrust", THRUST), ("current", CURRENT), ("tether", TETHER))  # fmt: skip
FLEET_LEGEND = (("in range of each other", LINK), ("place in the formation", PLACE))


def bytes_of(colour: Sequence[float]) -> RGB:
    """Return a colour whose parts are from 0 to 1 as bytes."""
    red, green, blue = (round(255.0 * share) for share in colour)
    return red, green, blue


def css(colour: RGB) -> str:
    """Return a colour in CSS notation."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
