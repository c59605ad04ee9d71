"""Outputs of ArduSub that are no motors': they command the vehicle's accessories.

Which output is whose follows from the parameters SERVOn_FUNCTION that ArduSub is started with. Functions: ArduPilot,
libraries/SRV_Channel/SRV_Channel.h. Lights are RC inputs 9 and 10 before ArduSub 4.7, and have their own since.
"""

from collections.abc import Mapping, Sequence

from hil.autopilots.contract import is_output
from sim.vehicle.accessories import LEAST, Accessories

FUNCTIONS: dict[float, str] = {
    7: "camera_tilt",
    28: "gripper",
    59: "lights",
    60: "lights",
    181: "lights",
    182: "lights",
}
OUTPUTS = 32
LEAST_US, MOST_US = 1100.0, 1900.0  # of SERVOn_MIN and SERVOn_MAX, if the parameters do not have them


class AccessoryOutputs:
    """The outputs of accessories in ArduSub's `parameters`. The brightest of several lights counts."""

    def __init__(self, parameters: Mapping[str, float]) -> None:
        rows = [
            (number - 1, FUNCTIONS.get(parameters.get(f"SERVO{number}_FUNCTION", 0), ""), *_limits(parameters, number))
            for number in range(1, OUTPUTS + 1)
        ]
        self._rows = [row for row in rows if row[1] and abs(row[3] - row[2]) >= 1.0]  # else it cannot move
        self._pulses: Sequence[int] = ()

    def move(self, pulses: Sequence[int], accessories: Accessories, time_ns: int) -> None:
        """Command what hangs at the outputs whose `pulses` (us, one per output of ArduSub) have changed."""
        if pulses is self._pulses or not pulses:
            return
        before, self._pulses = self._pulses or (0,) * len(pulses), pulses
        shares: dict[str, float] = {}
        changed = set()
        for index, name, first, last in self._rows:
            if index < len(pulses) and is_output(pulses[index]):
                share = (pulses[index] - first) / (last - first)
                shares[name] = max(shares.get(name, -1.0), LEAST[name] + (1.0 - LEAST[name]) * share)
                changed |= {name} if pulses[index] != before[index] else set()
        for name in changed:
            accessories.command(name, shares[name], time_ns)


def _limits(parameters: Mapping[str, float], number: int) -> tuple[float, float]:
    """Return the pulses (us) of an output's least and greatest share."""
    least, most = (parameters.get(f"SERVO{number}_{key}", us) for key, us in (("MIN", LEAST_US), ("MAX", MOST_US)))
    return (most, least) if parameters.get(f"SERVO{number}_REVERSED") else (least, most)
