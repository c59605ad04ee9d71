"""Random sequences of CAN commands to VESCs, with which the firmware's core in C is tested."""

import random
import struct
from collections.abc import Iterator

from hil.links.vesc.end import SET_CURRENT, SET_CURRENT_REL, SET_DUTY
from hil.links.wires.can_frame import CanFrame
from tests.support.firmware.c_core import Script, Step, instants

PER_US = 250  # of 100 000, for 400 us


def vesc_frames(rng: random.Random, channels: int) -> Iterator[CanFrame]:
    """Yield rounds of commands, now and then with one missing, repeated or invalid."""
    while True:
        for controller in range(1, channels + 1):
            if rng.random() < 0.97:
                yield _command(rng, controller)
        if rng.random() < 0.3:
            yield _command(rng, rng.choice((0, 1, 1, channels, channels + 1, 200)))


def _command(rng: random.Random, controller: int) -> CanFrame:
    argument = rng.randint(-500, 500) * PER_US + rng.randint(-100, 100)
    data = struct.pack(">i", rng.choice((argument, argument, 2**31 - 1, -(2**31))))
    odd = (
        CanFrame(SET_CURRENT << 8 | controller, bytes(4)),
        CanFrame(SET_CURRENT << 8 | controller, data),
        CanFrame(SET_CURRENT_REL << 8 | controller, data + bytes(4)),
        CanFrame(99 << 8 | controller, data),
        CanFrame(SET_DUTY << 8 | controller, data[:3]),
    )
    return CanFrame(SET_DUTY << 8 | controller, data) if rng.random() < 0.9 else rng.choice(odd)


def vesc_script(seed: int, steps: int) -> Script:
    """Return a random script for a bus: time may pass between frames, and the firmware is served after each."""
    rng = random.Random(seed)
    channels = rng.randint(1, 8)
    frames, now = vesc_frames(rng, channels), instants(rng)
    now_us, script = next(now), [Step(0)]
    for _ in range(steps):
        if rng.random() < 0.2:
            now_us = next(now)
        script += [Step(now_us, can=next(frames)), Step(now_us)]
    return Script(channels, 200_000, script)
