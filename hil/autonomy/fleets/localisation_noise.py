"""Random errors of measured positions, to test formations with.

`LocalisationNoise` gives zero-mean Gaussian errors, each axis by itself. The paper of the reference platform (Zhang et
al. 2022) prints for its eq. (10) a function of Gaussian shape with the sign of its exponent turned round. That is no
error: it is never below its amplitude and grows without bound. Bias and drift are those of the sensors, not modelled
here.
"""

from random import Random

from hil.common.errors import ConfigError

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
        """Return `position` (m north, m east) with new errors."""
        north, east = position
        gauss, deviation = self._random.gauss, self._deviation
        return north + gauss(0.0, deviation), east + gauss(0.0, deviation)
