"""Buttons of the joystick: BTNn_FUNCTION and, with a shift button held, BTNn_SFUNCTION. The numbers are ArduSub's."""

from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_S
from hil.gateways.mavlink.accessories import FIRST
from hil.gateways.mavlink.core import Core
from hil.links.contract import LEAST_US, MOST_US, PWM_NEUTRAL_US

BUTTONS = 32
SHIFT, TURNS = 1, (22, 23, 26, 27)  # functions: shift, and those that act as long as they are held
MODES = {
    5: dialect.SUB_MODE_MANUAL, 6: dialect.SUB_MODE_STABILIZE, 7: dialect.SUB_MODE_ALT_HOLD,
    8: dialect.SUB_MODE_POSHOLD, 9: dialect.SUB_MODE_AUTO, 10: dialect.SUB_MODE_CIRCLE, 11: dialect.SUB_MODE_GUIDED,
    12: dialect.SUB_MODE_ACRO, 13: 21,
}  # fmt: skip
FIRST_RELAY, FIRST_SERVO, OF_BUTTONS = 51, 61, 3  # functions of three relays (on, off, toggle), then of three servos
SERVO_STEP = 0.0625  # share of its range
TURN_RATE = 1.0 / 3.0  # share of the camera's range a second
LONGEST_S = 0.1  # that a button counts as held between two packets
Action = Callable[[Core], object]


class Buttons:
    """Calls the functions of the buttons in MANUAL_CONTROL: when they are pressed, the camera's while they are held."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._before = self._received_ns = 0
        self._held_s = 0.0
        self._actions = _actions(self)

    def receive(self, mask: int, now: int) -> None:
        """Take the buttons of a packet, a bit each."""
        core = self._core
        self._held_s = min(max(0.0, (now - self._received_ns) / NS_PER_S), LONGEST_S)
        pressed, self._before, self._received_ns = mask & ~self._before, mask, now
        down = [button for button in range(BUTTONS) if mask >> button & 1]
        shifts = any(core.table[f"BTN{button}_FUNCTION"] == SHIFT for button in down)
        for button in down:
            name = f"BTN{button}_{'S' if shifts else ''}FUNCTION"
            function = round(core.table[name])
            if not function or function == SHIFT or not (pressed >> button & 1 or function in TURNS):
                continue
            action = self._actions.get(function)
            if action:
                action(core)
            else:
                core.complain(f"button {button}: {name} {function} is not supported", now)

    def turn(self, name: str, sign: float) -> Action:
        """Return the function that turns the camera while its button is held."""
        return lambda core: core.accessories.change(name, sign * TURN_RATE * self._held_s)

    def arm(self, core: Core) -> None:
        """Arm."""
        core.arm(self._received_ns, lambda _result: None)


def _actions(buttons: Buttons) -> Mapping[int, Action]:
    actions: dict[int, Action] = {
        2: lambda core: core.disarm() if core.pilot.armed else buttons.arm(core), 3: buttons.arm,
        4: lambda core: core.disarm(), 21: _centre,
        22: buttons.turn("CamTilt", 1.0), 23: buttons.turn("CamTilt", -1.0),
        26: buttons.turn("CamPan", 1.0), 27: buttons.turn("CamPan", -1.0),
        41: _toggle_gain, 42: _change_gain(1), 43: _change_gain(-1), 48: _hold, 49: _turn_hull,
    }  # fmt: skip
    for function, mode in MODES.items():
        actions[function] = _change_mode(mode)
    for first, name in ((31, "Lights1"), (34, "Lights2")):
        actions |= {first: _cycle(name), first + 1: _light(name, 1.0), first + 2: _light(name, -1.0)}
    for number in range(OF_BUTTONS):
        first = FIRST_RELAY + 3 * number
        actions |= {first + place: _switch(number, on) for place, on in enumerate((True, False, None))}
        first, output = FIRST_SERVO + 5 * number, FIRST + number
        actions |= {first: _step(output, SERVO_STEP), first + 1: _step(output, -SERVO_STEP)}
        ends = enumerate((LEAST_US, MOST_US, PWM_NEUTRAL_US), first + 2)
        actions |= {function: _pulse(output, pulse) for function, pulse in ends}
    return actions


def _change_mode(mode: int) -> Action:
    return lambda core: core.set_mode(mode)


def _centre(core: Core) -> None:
    for name in ("CamTilt", "CamPan"):
        core.accessories.turn_to(name, 0.0)


def _light(name: str, sign: float) -> Action:
    return lambda core: core.accessories.change(name, sign / max(1.0, core.table["JS_LIGHTS_STEPS"]))


def _cycle(name: str) -> Action:
    def cycle(core: Core) -> None:
        is_full = core.accessories.share(name) >= 1.0
        core.accessories.change(name, -1.0 if is_full else 1.0 / max(1.0, core.table["JS_LIGHTS_STEPS"]))

    return cycle


def _change_gain(steps: int) -> Action:
    return lambda core: core.texts.append((6, f"#Gain is {100.0 * core.pilot.joystick.change_gain(steps):.0f}%"))


def _toggle_gain(core: Core) -> None:
    joystick = core.pilot.joystick
    joystick.gain = 0.5 if joystick.gain > 0.5 else 1.0
    core.texts.append((6, f"#Gain: {100.0 * joystick.gain:.0f}%"))


def _hold(core: Core) -> None:
    if core.pilot.armed:
        core.texts.append((6, "#Input Hold Set" if core.pilot.joystick.hold() else "#Input Hold Disabled"))


def _turn_hull(core: Core) -> None:
    joystick = core.pilot.joystick
    joystick.turns_hull = not joystick.turns_hull
    core.texts.append((6, "#Attitude Control" if joystick.turns_hull else "#Movement Control"))


def _switch(relay: int, on: bool | None) -> Action:
    return lambda core: core.accessories.switch(relay, on)


def _step(output: int, step: float) -> Action:
    return lambda core: core.accessories.set_pulse(
        output, core.accessories.pulses.get(output, PWM_NEUTRAL_US) + step * (MOST_US - LEAST_US)
    )


def _pulse(output: int, pulse: int) -> Action:
    return lambda core: core.accessories.set_pulse(output, pulse)
