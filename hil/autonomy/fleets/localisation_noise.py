"""Random errors of measured positions, to test formations.

`LocalisationNoise` adds zero-mean Gaussian errors, independent for each axis. The paper of the reference platform
(Zhang et al. 2022) prints for its eq. (10) a Gaussian function with the wrong sign of its exponent. That is no error
model: it is never below its amplitude and grows without bound. Bias and drift belong to the sensors and are not
modelled here.
"""

from random import Random

from hil.common.errors import ConfigError

Position = tuple[float, float]  # north, east in m


class LocalisationNoise:
    """Positions with errors of standard deviation `deviation` m for each axis; the same seed gives the same errors.

    Raises ConfigError for a negative deviation.
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
