"""Outputs of an autopilot that are no motors': they command the vehicle's accessories.

Which output is whose follows from the autopilot's parameters, as it is started and as they are set later. Functions:
ArduPilot, libraries/SRV_Channel/SRV_Channel.h; PX4, src/lib/mixer_module/output_functions.yaml. ArduSub's lights are RC
inputs 9 and 10 before version 4.7, and have their own since. PX4 has no lights: those of the first peripheral by
actuator set (command 187) are ours. Its gripper is open at the least pulse.
"""

from collections.abc import Mapping, Sequence

from hil.autopilots.contract import is_output
from hil.links.contract import LEAST_US, MOST_US, PWM_NEUTRAL_US
from sim.vehicle.accessories import LEAST, Accessories

FUNCTIONS: dict[float, str] = {
    7: "camera_tilt", 28: "gripper", 59: "lights", 60: "lights", 181: "lights", 182: "lights",
    301: "lights", 421: "camera_tilt", 430: "gripper",
}  # fmt: skip
PX4_GRIPPER = 430
KEYS = ("SERVO{}_FUNCTION", "PWM_MAIN_FUNC{}", "HIL_ACT_FUNC{}")
LIMITS = ("SERVO{}_MIN", "SERVO{}_MAX", "SERVO{}_REVERSED")
OUTPUTS = 32


class AccessoryOutputs:
    """The outputs of accessories by the autopilot's `parameters`. The brightest of several lights counts.

    `names`: the parameters on which they depend.
    """

    def __init__(self, parameters: Mapping[str, float]) -> None:
        key = next((key for key in KEYS if any(key.format(i + 1) in parameters for i in range(OUTPUTS))), KEYS[0])
        self._key = key
        keys = (key, *LIMITS) if key == KEYS[0] else (key,)
        self.names = [each.format(number) for number in range(1, OUTPUTS + 1) for each in keys]
        self._parameters = {name: value for name, value in parameters.items() if name in self.names}
        self._rows = self._find()
        self._pulses: Sequence[int] = ()
        # PX4 sends the neutral pulse until an output is commanded.
        self._first_us = 0 if key == KEYS[0] else PWM_NEUTRAL_US

    def set_parameter(self, name: str, value: float) -> None:
        """Follow a parameter of the autopilot."""
        if name in self.names and self._parameters.get(name) != value:
            self._parameters[name] = value
            self._rows = self._find()

    def _find(self) -> list[tuple[int, str, float, float]]:
        """Return index and accessory of each output, and the pulses (us) of its least and greatest share."""
        rows = []
        for number in range(1, OUTPUTS + 1):
            function = self._parameters.get(self._key.format(number), 0)
            first, last, is_reversed = (
                self._parameters.get(key.format(number), default)
                for key, default in zip(LIMITS, (LEAST_US, MOST_US, function == PX4_GRIPPER), strict=True)
            )
            if function in FUNCTIONS and abs(last - first) >= 1.0:  # else it cannot move
                rows.append((number - 1, FUNCTIONS[function], *((last, first) if is_reversed else (first, last))))
        return rows

    def move(self, pulses: Sequence[int], accessories: Accessories, time_ns: int) -> None:
        """Command what hangs at the outputs whose `pulses` (us, one per output of the autopilot) have changed."""
        if pulses is self._pulses or not pulses:
            return
        before, self._pulses = self._pulses or (self._first_us,) * len(pulses), pulses
        shares: dict[str, float] = {}
        changed = set()
        for index, name, first, last in self._rows:
            if index < len(pulses) and is_output(pulses[index]):
                share = (pulses[index] - first) / (last - first)
                shares[name] = max(shares.get(name, -1.0), LEAST[name] + (1.0 - LEAST[name]) * share)
                changed |= {name} if pulses[index] != before[index] else set()
        for name in changed:
            accessories.command(name, shares[name], time_ns)
