"""A relay in the thruster link: it forwards bytes between slave and STM32, decodes the reports, and fails on request.

    slave -- near wire -- Line -- far wire -- STM32

The far wire never fails, so that the STM32's reports arrive whatever happens at the slave's end. On a CAN bus there is
no near wire: slave, STM32 and relay are on one bus, and noise is the only possible fault.
"""

import os
import random
import select
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType

from hil.common.errors import DeviceError
from hil.links.contract import Protocol, ThrusterTelemetry, Wire
from hil.links.wires.can_frame import RECORD_SIZE
from hil.links.wires.terminal import TerminalWire
from tools.faults.pins import Pins

PERIOD_S = 0.005
NOISE = 45  # bytes in each direction every PERIOD_S: 9 kB/s, which with commands is what 115,200 Bd carry


class Line:
    """Joins the wires that `open_near` and `open_far` open. Use as a context.

    `down` and `up`: whether commands and reports pass. `noise`: random bytes are inserted in both directions. `halves`:
    only the first half of each piece passes. `bytes_a_s`: rate limit of commands, 0: none. `pins` gets the reports
    that `protocol`, a host's end, decodes.
    """

    def __init__(
        self, open_near: Callable[[], Wire | None], open_far: Callable[[], Wire], protocol: Protocol, pins: Pins
    ) -> None:
        self.down = self.up = True
        self.noise = self.halves = False
        self.bytes_a_s = 0.0
        self._open_near, self._open_far = open_near, open_far
        self._protocol, self._pins = protocol, pins
        self._random = random.Random(1)
        self._due_s = self._noise_due_s = 0.0
        self._lock = threading.Lock()  # other threads replace the wires
        self._far: Wire | None = open_far()
        self._near = open_near()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="line", daemon=True)
        self._thread.start()

    def __enter__(self) -> "Line":
        return self

    def __exit__(self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None) -> None:
        self._ending.set()
        self._thread.join()
        for wire in (self._near, self._far):
            if wire:
                wire.close()

    def unplug(self) -> None:
        """Close the slave's end, like a cable that is unplugged."""
        with self._lock:
            if self._near:
                self._near.close()
                self._near = None

    def plug(self) -> None:
        """Open the slave's end again."""
        with self._lock:
            self._near = self._open_near()

    def lose_far(self) -> None:
        """Close the far wire, because the STM32 has ended."""
        with self._lock:
            if self._far:
                self._far.close()
                self._far = None
            self._pins.power_lost()

    def find_far(self) -> None:
        """Open the far wire again, because the STM32 runs again."""
        with self._lock:
            self._far = self._open_far()

    def clear(self) -> None:
        """Remove all faults of the line."""
        self.down = self.up = True
        self.noise = self.halves = False
        self.bytes_a_s = 0.0

    def _run(self) -> None:
        while not self._ending.is_set():
            near, far = self._near, self._far
            waited = [wire for wire in (near if self._may_read() else None, far) if wire and wire.fileno() >= 0]
            with suppress(OSError, ValueError):  # one was closed meanwhile
                select.select(waited, (), (), PERIOD_S)
            with self._lock:
                self._forward()

    def _forward(self) -> None:
        if self._far:
            with suppress(DeviceError):
                self._carry_up(self._far.read())
        if self._near and self._may_read():
            with suppress(DeviceError):
                self._carry_down(self._read_near(self._near))
        if self.noise and time.monotonic() >= self._noise_due_s:
            self._noise_due_s = time.monotonic() + PERIOD_S
            for wire in (self._near, self._far):
                if wire:
                    with suppress(DeviceError):
                        wire.write(self._noise(wire))

    def _may_read(self) -> bool:
        return not self.bytes_a_s or time.monotonic() >= self._due_s

    def _read_near(self, near: Wire) -> bytes:
        """Return the bytes of the near end; on a slow line, as many as it carries in a period."""
        if not self.bytes_a_s:
            return near.read()
        self._due_s = max(self._due_s, time.monotonic() - 4 * PERIOD_S) + PERIOD_S
        with suppress(BlockingIOError, OSError):
            return os.read(
                near.terminal if isinstance(near, TerminalWire) else near.fileno(),
                max(1, round(self.bytes_a_s * PERIOD_S)),
            )
        return b""

    def _carry_down(self, data: bytes) -> None:
        if data and self.down and self._far:
            self._far.write(self._cut(data, self._far))

    def _carry_up(self, data: bytes) -> None:
        for message in self._protocol.feed(data):
            if isinstance(message, ThrusterTelemetry):
                self._pins.report(message.pwm_us, message.sequence)
        self._protocol.replies()
        if data and self.up and self._near:
            with suppress(DeviceError):
                self._near.write(self._cut(data, self._near))

    def _cut(self, data: bytes, wire: Wire) -> bytes:
        if not self.halves:
            return data
        return data[: len(data) // 2 // wire.record_size * wire.record_size]

    def _noise(self, wire: Wire) -> bytes:
        """Return random bytes; on a CAN bus, a frame of another node with a high priority."""
        if wire.record_size != RECORD_SIZE:
            return self._random.randbytes(NOISE)
        head = (0x700 + self._random.randrange(64)).to_bytes(4, "little") + bytes((8, 0, 0, 0))
        return head + self._random.randbytes(8)
