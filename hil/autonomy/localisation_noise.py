"""How wrong a vehicle is about where it is: the errors of its own and its neighbours' positions.

`LocalisationNoise` is what a formation is tried with: zero-mean Gaussian errors, each axis by itself. The source paper
prints for its eq. (10) a function of Gaussian shape with the sign of its exponent turned round; `printed_error` is
that function as it stands, for comparison only. Bias and drift are those of the sensors, not modelled here.
"""

from math import exp
from random import Random

from hil.errors import ConfigError

Position = tuple[float, float]  # north, east in m


class LocalisationNoise:
    """Positions with errors of standard deviation `deviation` m an axis; one seed, one sequence.

    Raises ConfigError for a deviation below 0.
    """

    def __init__(self, deviation: float, seed: int) -> None:
        if not deviation >= 0.0:
            raise ConfigError(f"localisation noise: a standard deviation of {deviation} m; give 0 or more")
        self._deviation = deviation
        self._random = Random(seed)

    def measured(self, position: Position) -> Position:
        """`position` (m north, m east) as it is measured this time."""
        north, east = position
        gauss, deviation = self._random.gauss, self._deviation
        return north + gauss(0.0, deviation), east + gauss(0.0, deviation)


def printed_error(mu: float, amplitude: float, width: float) -> float:
    """The source paper's eq. (10) as printed: amplitude x exp(+mu² / (2 width²)), m.

    It is no Gaussian error: it is never below `amplitude` (m), always to the same side, and grows without bound
    with `mu` (m) over `width` (m). Nothing here uses it; it is kept to show what it does.
    """
    return amplitude * exp(mu * mu / (2.0 * width * width))
