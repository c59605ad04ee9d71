"""Buttons of the joystick: BTNn_FUNCTION and, with a shift button held, BTNn_SFUNCTION. The numbers are ArduSub's."""

from collections.abc import Callable, Mapping
from functools import partial
from itertools import product

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
Action = Callable[[], object]


class Buttons:
    """Calls the functions of the buttons in MANUAL_CONTROL: when they are pressed, the camera's while they are held."""

    def __init__(self, core: Core) -> None:
        self._core = core
        self._before = self._received_ns = 0
        self._held_s = 0.0
        self._actions = self._find_actions()

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
                action()
            else:
                core.complain(f"button {button}: {name} {function} is not supported", now)

    def _find_actions(self) -> Mapping[int, Action]:
        core = self._core
        accessories = core.accessories
        actions: dict[int, Action] = {
            2: lambda: core.disarm() if core.pilot.armed else self._arm(), 3: self._arm, 4: core.disarm,
            21: self._centre, 41: self._toggle_gain, 42: partial(self._change_gain, 1),
            43: partial(self._change_gain, -1), 48: self._hold, 49: self._turn_hull,
        }  # fmt: skip
        actions |= {function: partial(core.set_mode, mode) for function, mode in MODES.items()}
        for function, (name, sign) in zip(TURNS, product(("CamTilt", "CamPan"), (1.0, -1.0)), strict=True):
            actions[function] = partial(self._turn, name, sign)
        for first, name in ((31, "Lights1"), (34, "Lights2")):
            steps = enumerate((0.0, 1.0, -1.0), first)
            actions |= {function: partial(self._light, name, sign) for function, sign in steps}
        for number in range(OF_BUTTONS):
            relay = enumerate((True, False, None), FIRST_RELAY + 3 * number)
            actions |= {function: partial(accessories.switch, number, on) for function, on in relay}
            first, output = FIRST_SERVO + 5 * number, FIRST + number
            steps = enumerate((SERVO_STEP, -SERVO_STEP), first)
            actions |= {function: partial(self._step, output, step) for function, step in steps}
            ends = enumerate((LEAST_US, MOST_US, PWM_NEUTRAL_US), first + 2)
            actions |= {function: partial(accessories.set_pulse, output, pulse) for function, pulse in ends}
        return actions

    def _arm(self) -> None:
        self._core.arm(self._received_ns, lambda _result: None)

    def _turn(self, name: str, sign: float) -> None:
        self._core.accessories.change(name, sign * TURN_RATE * self._held_s)

    def _centre(self) -> None:
        for name in ("CamTilt", "CamPan"):
            self._core.accessories.turn_to(name, 0.0)

    def _light(self, name: str, sign: float) -> None:
        """Change the lights by a step; with 0 up to full, and then off."""
        accessories, step = self._core.accessories, 1.0 / self._core.table["JS_LIGHTS_STEPS"]
        accessories.change(name, sign * step if sign else -1.0 if accessories.share(name) >= 1.0 else step)

    def _step(self, output: int, step: float) -> None:
        pulse = self._core.accessories.pulses.get(output, PWM_NEUTRAL_US)
        self._core.accessories.set_pulse(output, pulse + step * (MOST_US - LEAST_US))

    def _change_gain(self, steps: int) -> None:
        self._say(f"Gain is {100.0 * self._core.pilot.joystick.change_gain(steps):.0f}%")

    def _toggle_gain(self) -> None:
        joystick = self._core.pilot.joystick
        joystick.gain = 0.5 if joystick.gain > 0.5 else 1.0
        self._say(f"Gain: {100.0 * joystick.gain:.0f}%")

    def _hold(self) -> None:
        if self._core.pilot.armed:
            self._say("Input Hold Set" if self._core.pilot.joystick.hold() else "Input Hold Disabled")

    def _turn_hull(self) -> None:
        joystick = self._core.pilot.joystick
        joystick.turns_hull = not joystick.turns_hull
        self._say("Attitude Control" if joystick.turns_hull else "Movement Control")

    def _say(self, text: str) -> None:
        self._core.texts.append((6, f"#{text}"))
