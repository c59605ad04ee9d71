"""A gamepad of this machine as a stick, by pygame."""

import os
from typing import Any

from hil.common.errors import DeviceError, MissingExtraError

DEAD = 0.12  # of an axis about its middle
SHOULDERS = (4, 5)  # buttons of the usual layout: the dead man's switch


class Gamepad:
    """The first gamepad. Raises MissingExtraError, and DeviceError where none is plugged in."""

    def __init__(self) -> None:
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # it has no window
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ImportError:
            raise MissingExtraError("a gamepad needs pygame-ce: pip install 'uuv-hil[teleop]'") from None
        self._pygame: Any = pygame
        pygame.display.init()
        pygame.joystick.init()
        if not pygame.joystick.get_count():
            raise DeviceError("no gamepad is plugged in; leave out --gamepad to steer by keys")
        self._pad = pygame.joystick.Joystick(0)
        self.name: str = self._pad.get_name()

    def message(self) -> dict[str, Any]:
        """Return the stick as it is held now."""
        self._pygame.event.pump()
        pad = self._pad
        axis = [_without_middle(pad.get_axis(number)) for number in range(min(pad.get_numaxes(), 4))] + [0.0] * 4
        held = any(pad.get_button(number) for number in SHOULDERS if number < pad.get_numbuttons())
        axes = {"yaw": axis[0], "surge": -axis[1], "sway": axis[2], "heave": axis[3]}
        return {"held": held, "axes": axes, "mode": "velocity", "hold_depth": True, "hold_heading": True}


def _without_middle(value: float) -> float:
    return 0.0 if abs(value) < DEAD else value
