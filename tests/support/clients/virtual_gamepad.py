"""Run `uuv-hil` with a virtual gamepad of SDL, which is moved by the lines of a FIFO.

python virtual_gamepad.py FIFO ARGUMENTS...

axis N VALUE      -32768 to 32767
button N 0|1
unplug, plug
"""

import ctypes
import sys
import threading
from pathlib import Path

GAMEPAD, AXES, BUTTONS = 1, 6, 11  # SDL_JOYSTICK_TYPE_GAMECONTROLLER: sticks, triggers, and the usual buttons


class Virtual:
    """One gamepad of SDL's virtual driver, in the library that pygame has loaded."""

    def __init__(self) -> None:
        import pygame

        pygame.display.init()
        pygame.joystick.init()
        maps = Path("/proc/self/maps").read_text(encoding="utf-8")
        self._sdl = ctypes.CDLL(next(line.split()[-1] for line in maps.splitlines() if "libSDL2-2" in line))
        self._sdl.SDL_JoystickOpen.restype = ctypes.c_void_p
        self._sdl.SDL_JoystickSetVirtualAxis.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int16]
        self._sdl.SDL_JoystickSetVirtualButton.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint8]
        self.plug()

    def plug(self) -> None:
        self._index = self._sdl.SDL_JoystickAttachVirtual(GAMEPAD, AXES, BUTTONS, 0)
        assert self._index >= 0
        self._pad = self._sdl.SDL_JoystickOpen(self._index)
        for trigger in (4, 5):
            self.do("axis", str(trigger), "-32768")

    def do(self, action: str, *arguments: str) -> None:
        numbers = [int(word) for word in arguments]
        if action == "axis":
            self._sdl.SDL_JoystickSetVirtualAxis(self._pad, *numbers)
        elif action == "button":
            self._sdl.SDL_JoystickSetVirtualButton(self._pad, *numbers)
        elif action == "unplug":
            self._sdl.SDL_JoystickDetachVirtual(self._index)
        else:
            self.plug()


def main(fifo: str, arguments: list[str]) -> int:
    from hil.cli import main as uuv_hil

    pad = Virtual()

    def follow() -> None:
        with open(fifo, encoding="ascii") as lines:
            for line in lines:
                pad.do(*line.split())

    threading.Thread(target=follow, daemon=True).start()
    return uuv_hil(arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
