"""Parameters of the slave (hil.slave.ros.parameters) under MAVLink's short names.

gains.surge.p                    HIL_G_SURGE_P; likewise _I, _D, _LIM, _FF, _FILT, _SLEW
gains.roll_rate.p                HIL_G_RLLR_P; pitch_rate PITR, yaw_rate YAWR, heading HDG
gains.heading.p                  ATC_ANG_YAW_P, as ArduSub has the same gain; likewise of roll, pitch and depth
failures.NAME of thruster 1      HIL_FAIL1_KIND: 0 none, 1 off, 2 efficiency, 3 stuck, 4 delayed, 5 noisy
                                 HIL_FAIL1_VALUE: share of thrust, us, s, share of noise
"""

from collections.abc import Mapping

from hil.client.parameters import read_parameters, set_parameter
from hil.network.session import Session

AXES = {
    "surge": "SURGE", "sway": "SWAY", "heave": "HEAVE", "roll_rate": "RLLR", "pitch_rate": "PITR", "yaw_rate": "YAWR",
    "depth": "DEPTH", "heading": "HDG", "roll": "ROLL", "pitch": "PITCH",
}  # fmt: skip
FIELDS = {
    "p": "P", "i": "I", "d": "D", "limit": "LIM", "feedforward": "FF", "filter": "FILT", "slew": "SLEW",
}  # fmt: skip
SAME_AS_ARDUSUB = {
    "gains.heading.p": "ATC_ANG_YAW_P", "gains.roll.p": "ATC_ANG_RLL_P", "gains.pitch.p": "ATC_ANG_PIT_P",
    "gains.depth.p": "PSC_POSZ_P",
}  # fmt: skip
KINDS = ("", "off", "efficiency", "stuck", "delayed", "noisy")
FAILURE = "HIL_FAIL"
KEYS = {"efficiency": "efficiency", "stuck": "pwm_us", "delayed": "delay", "noisy": "noise"}


class SlaveParameters:
    """`values` by MAVLink name, as of the last `refresh`. Methods wait for the slave, and raise NetworkError."""

    def __init__(self, session: Session, node: str) -> None:
        self._session, self._node = session, node
        self.values: Mapping[str, float] = {}
        self._thrusters: list[str] = []  # ROS names, in the order of the vehicle
        self._wished: dict[str, float] = {}  # values of failures whose kind is set afterwards, or has none
        self._names: dict[str, str] = {}  # MAVLink -> ROS, of gains

    def refresh(self) -> None:
        """Fetch all names and values."""
        values = read_parameters(self._session, self._node)
        self._thrusters = [name for name in values if name.startswith("failures.")]
        self._names = {short: name for name in values if (short := short_name(name))}
        fetched: dict[str, float] = {short: values[name] for short, name in self._names.items()}
        for number, name in enumerate(self._thrusters, 1):
            kind, value = read_failure(values[name])
            fetched[f"{FAILURE}{number}_KIND"] = float(kind)
            amount = f"{FAILURE}{number}_VALUE"
            fetched[amount] = value if kind > 1 else self._wished.get(amount, 0.0)
        self.values = fetched

    def set(self, name: str, value: float) -> str:
        """Set one; return why it was not set, "" if it was."""
        ros = self._names.get(name)
        requested: float | str = value
        if ros is None:
            number, _, key = name.removeprefix(FAILURE).partition("_")
            self._wished[name] = value
            kind = int(value if key == "KIND" else self.values.get(f"{FAILURE}{number}_KIND", 0.0))
            if not 0 <= kind < len(KINDS):
                return f"{name}: {value:g} is none of 0 to {len(KINDS) - 1}"
            if key == "VALUE" and kind < 2:
                self.values = {**self.values, name: value}
                return ""
            amount = value if key == "VALUE" else self.values.get(f"{FAILURE}{number}_VALUE", 0.0)
            ros, requested = self._thrusters[int(number) - 1], failure_text(kind, amount)
        reason = set_parameter(self._session, self._node, ros, requested)
        self.refresh()
        return f"{name}: {reason}" if reason else ""


def short_name(name: str) -> str:
    """Return the MAVLink name of a gain, "" for another parameter."""
    parts = name.split(".")
    if len(parts) != 3 or parts[0] != "gains" or parts[1] not in AXES or parts[2] not in FIELDS:
        return ""
    return SAME_AS_ARDUSUB.get(name) or f"HIL_G_{AXES[parts[1]]}_{FIELDS[parts[2]]}"


def read_failure(text: str) -> tuple[int, float]:
    """Return the first failure of a parameter's text as its number and value; (0, 0) for none."""
    words = [pair.partition("=") for pair in text.split(";", maxsplit=1)[0].split(",")]
    pairs = {key.strip(): value.strip().strip('"') for key, _, value in words}
    kind = pairs.get("kind", "")
    if kind not in KINDS[1:]:
        return 0, 0.0
    try:
        return KINDS.index(kind), float(pairs.get(KEYS.get(kind, ""), "0"))
    except ValueError:
        return KINDS.index(kind), 0.0


def failure_text(kind: int, value: float) -> str:
    """Return the text of a failure, as hil.slave.ros.parameters reads it; "" for none."""
    word = KINDS[kind]
    if not word:
        return ""
    if word not in KEYS:
        return f"kind = {word}"
    return f"kind = {word}, {KEYS[word]} = {round(value) if word == 'stuck' else value!r}"
