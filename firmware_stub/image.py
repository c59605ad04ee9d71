"""The shipped image for the STM32F405, and the parameters that adapt it to a vehicle.

On the board both are written once, by any flash tool: the image to 0x08000000, the parameters to 0x08004000. Where
there are no parameters the image drives 6 thrusters at 50 Hz, with a watchdog of 200 ms, on 115200 bit/s.
"""

import os
import struct

from hil.common.errors import DeviceError

IMAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "images", "uuv_hil_stm32f405.bin")
PARAMETERS_ADDRESS = 0x0800_4000
PARAMETERS_MAGIC = 0x5056_5555
MAX_CHANNELS = 8


def parameters(channels: int, watchdog: float = 0.2, pwm_hz: int = 50, baud: int = 115_200) -> bytes:
    """Return the bytes to write to `PARAMETERS_ADDRESS`; src/f405/f405.h has the layout.

    channels: thrusters, 1 to 8. watchdog: the longest time without a command, 0.01 to 60 s. pwm_hz: 50 to 400.
    baud: 9600 to 5 250 000 bit/s. The firmware takes its default in place of what is outside.
    Raises DeviceError for a number of thrusters that the board has no outputs for.
    """
    if not 1 <= channels <= MAX_CHANNELS:
        raise DeviceError(f"the STM32F405's image drives 1 to {MAX_CHANNELS} thrusters, not {channels}")
    return struct.pack("<5I", PARAMETERS_MAGIC, channels, round(watchdog * 1000), pwm_hz, baud)
