"""A gamepad of this machine as a stick, by pygame (SDL)."""

import os
from typing import Any

from hil.common.errors import DeviceError, MissingExtraError

DEAD = 0.12  # dead band of an axis, -1 to 1
FULL = 32_767  # full scale of an axis of a gamepad whose layout SDL knows
# Axes of a gamepad whose layout SDL does not know, in Linux' order: left x, left y, right x, right y. With triggers,
# the left trigger comes between the sticks; a trigger at rest reads -1.
PLAIN_AXES, PLAIN_AXES_WITH_TRIGGERS = (0, 1, 2, 3), (0, 1, 3, 4)
PLAIN_SHOULDERS = (4, 5)
UNPLUGGED = "the gamepad is unplugged: plug it in again"


class Gamepad:
    """The first gamepad. Raises MissingExtraError, and DeviceError where none is plugged in.

    The shoulder buttons are the dead man's switch. `problem` is why the gamepad cannot be read, or "". An unplugged
    gamepad counts as released, and works again after it is plugged in.
    """

    def __init__(self) -> None:
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # this program has no window
        os.environ.setdefault("SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS", "1")
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
            from pygame._sdl2 import controller
        except ImportError:
            raise MissingExtraError("a gamepad needs pygame-ce: pip install 'uuv-hil[teleop]'") from None
        self._pygame: Any = pygame
        self._controller: Any = controller
        pygame.display.init()
        pygame.joystick.init()
        controller.init()
        if not pygame.joystick.get_count():
            raise DeviceError("no gamepad is plugged in; leave out --gamepad to steer by keys")
        self._open(0)

    def message(self) -> dict[str, Any]:
        """Return the present state of the gamepad, as a message for `hil.view.teleop.stick.Stick`."""
        pygame = self._pygame
        for event in pygame.event.get():
            if event.type == pygame.JOYDEVICEREMOVED and event.instance_id == self._number:
                self.problem = UNPLUGGED
            elif event.type == pygame.JOYDEVICEADDED and self.problem:
                self._open(event.device_index)
        held, axis = (False, [0.0] * 4) if self.problem else self._read()
        axes = {"yaw": axis[0], "surge": -axis[1], "sway": axis[2], "heave": axis[3]}
        return {"held": held, "axes": axes, "mode": "velocity", "hold_depth": True, "hold_heading": True}

    def _open(self, index: int) -> None:
        self._pad = self._pygame.joystick.Joystick(index)
        self._known = self._controller.Controller(index) if self._controller.is_controller(index) else None
        self._number = self._pad.get_instance_id()
        self.name: str = self._pad.get_name()
        self.problem = ""

    def _read(self) -> tuple[bool, list[float]]:
        """Return whether a shoulder button is down, and left x, left y, right x, right y from -1 to 1."""
        if self._known is None:
            pad = self._pad
            axes = PLAIN_AXES_WITH_TRIGGERS if pad.get_numaxes() >= 6 else PLAIN_AXES
            values = [pad.get_axis(number) if number < pad.get_numaxes() else 0.0 for number in axes]
            held = any(pad.get_button(number) for number in PLAIN_SHOULDERS if number < pad.get_numbuttons())
            return held, [_without_middle(value) for value in values]
        pad, names = self._known, self._pygame
        sticks = (names.CONTROLLER_AXIS_LEFTX, names.CONTROLLER_AXIS_LEFTY, names.CONTROLLER_AXIS_RIGHTX)
        values = [pad.get_axis(number) / FULL for number in (*sticks, names.CONTROLLER_AXIS_RIGHTY)]
        shoulders = (names.CONTROLLER_BUTTON_LEFTSHOULDER, names.CONTROLLER_BUTTON_RIGHTSHOULDER)
        return any(pad.get_button(number) for number in shoulders), [_without_middle(value) for value in values]


def _without_middle(value: float) -> float:
    return 0.0 if abs(value) < DEAD else max(-1.0, min(1.0, value))
