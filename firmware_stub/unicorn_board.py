"""`stm32 = "unicorn"`: run the firmware's image on an STM32 that is emulated in this process, by default an F405.

It is deterministic: simulated time passes only in `UnicornBoard.run_until`, and the same calls give the same bits.
Instructions take no time: at each event (a byte, a millisecond, a watchdog) the core runs until it sleeps. A core that
does not sleep executes `BUSY_INSTRUCTIONS` every `BUSY_NS`.
"""

from collections.abc import Iterable

from firmware_stub.emulation.chip import TIMERS, Chip
from firmware_stub.emulation.core import Core
from firmware_stub.emulation.memory import FLASH
from firmware_stub.emulation.models import MODELS
from firmware_stub.image import DEFAULT_CHIP, PARAMETERS_ADDRESS, image_path, parameters
from hil.common.clock import NS_PER_MS, NS_PER_S
from hil.common.errors import DeviceError
from hil.links.contract import Wire
from hil.links.wires.can_frame import RECORD_SIZE, CanFrame, pack_frame, unpack_frames

BUSY_NS = NS_PER_MS
BUSY_INSTRUCTIONS = 16_000  # in a millisecond at the core's own 16 MHz
WATCHDOG_NS = 200 * NS_PER_MS


def shipped_image(chip: str = DEFAULT_CHIP) -> bytes:
    """Return the shipped firmware for a chip. Raises ConfigError without one, DeviceError if the file is missing."""
    path = image_path(chip)
    try:
        with open(path, "rb") as file:
            return file.read()
    except OSError as error:
        raise DeviceError(f"{path}: {error.strerror}; make it: python -m firmware_stub.build") from None


class UnicornBoard:
    """An STM32 with its firmware. Inputs are bytes and CAN frames; outputs are bytes, CAN frames and pulses.

    image: content of the flash, starting with the vector table. channels: number of thrusters, 1 to 8. watchdog_ns: the
    longest time without a command before the firmware stops them. The firmware reads both from its parameters in flash,
    unless the image extends over these. paced: whether bytes take time on the serial line. chip: the kind of STM32, of
    firmware_stub.image.CHIPS.

    Raises DeviceError for too many thrusters, and for a fault of the firmware, with program counter and address;
    MissingExtraError without Unicorn.
    Not modelled: pins, analogue inputs, the time the chip takes to start.
    """

    def __init__(
        self,
        image: bytes,
        channels: int = 8,
        watchdog_ns: int = WATCHDOG_NS,
        *,
        paced: bool = False,
        chip: str = DEFAULT_CHIP,
    ) -> None:
        self.channels = channels
        self.resets = 0  # resets by the watchdog
        self._chip = Chip(paced, MODELS[chip])
        self._core = Core(self._chip, _with_parameters(image, channels, watchdog_ns))
        self._port = self._chip.usart
        self._busy_ns = BUSY_NS
        self.reset()

    @property
    def now_ns(self) -> int:
        """Simulated time since power-up (ns)."""
        return self._chip.time.now_ns

    @property
    def due_ns(self) -> int:
        """Simulated time (ns) of the chip's next event without new input."""
        return self._chip.due_ns if self._core.sleeping else min(self._chip.due_ns, self._busy_ns)

    @property
    def pwm_us(self) -> list[int]:
        """Pulse widths in microseconds, one per thruster, from the timers' registers; 0: no pulses."""
        return [self._chip.timers[TIMERS[i // 4]].pulse_us(i % 4) for i in range(self.channels)]

    @property
    def command_ns(self) -> int:
        """Monotonic time (ns) of the program's last write of a pulse width, at each command and report."""
        return max(timer.width_set_ns for timer in self._chip.timers.values())

    @property
    def lost(self) -> int:
        """Number of lost bytes: received while the port was off, or faster than the firmware or the line allows."""
        return self._port.lost

    def receive(self, data: bytes) -> None:
        """Deliver bytes to the serial port, now."""
        self._port.receive(data)
        self._run()

    def transmitted(self) -> bytes:
        """Return the bytes sent since the last call."""
        return self._port.take_output()

    def receive_can(self, frames: Iterable[CanFrame]) -> None:
        """Put frames on the CAN bus, now."""
        self._chip.can.receive(list(frames))
        self._run()

    def transmitted_can(self) -> list[CanFrame]:
        """Return the frames sent since the last call."""
        return self._chip.can.take_output()

    def run_until(self, time_ns: int) -> None:
        """Advance the simulated time to `time_ns`."""
        time = self._chip.time
        while (due_ns := self.due_ns) <= time_ns:
            time.now_ns = due_ns
            self._chip.tick()
            self._run()
        time.now_ns = max(time.now_ns, time_ns)

    def reset(self) -> None:
        """Reset the chip like its reset button; RAM keeps its contents."""
        self._restart()
        self._run()

    def read_memory(self, address: int, size: int) -> bytes:
        """Read memory like a debug probe. Raises DeviceError if there is no memory at that address."""
        return self._core.read_memory(address, size)

    def write_memory(self, address: int, data: bytes) -> None:
        """Write memory, including flash, like a debug probe. Raises DeviceError if there is none at that address."""
        self._core.write_memory(address, data)

    @property
    def pc(self) -> int:
        """Address of the next instruction."""
        return self._core.pc

    def _restart(self) -> None:
        self._chip.reset()
        self._core.reset()

    def _run(self) -> None:
        """Run the core until it has nothing more to do at this time. A requested reset follows at the next event."""
        core, chip = self._core, self._chip
        if chip.has_expired:
            self.resets += 1
            self._restart()
        core.run(BUSY_INSTRUCTIONS)
        while core.sleeping and (self._port.deliver() or chip.can.deliver()):
            core.run(BUSY_INSTRUCTIONS)
        self._busy_ns = chip.time.now_ns + BUSY_NS


class UnicornEnd:
    """Device end of a wire with an emulated STM32: wait on `fileno()` until `deadline_ns`, then call `service`.

    can: whether the wire carries CAN frames (records of hil.links.wires.can_frame) instead of bytes. Time is the
    caller's clock (ns). One call advances the board by at most `PATIENCE_NS`, so that a late caller does not trip the
    firmware's watchdog.
    """

    PERIOD_NS = 5 * NS_PER_MS  # longest delay of a report on the wire
    PATIENCE_NS = 100 * NS_PER_MS
    AT_ONCE = 16 * RECORD_SIZE  # bytes that one `service` delivers; the rest follows in the next

    def __init__(self, board: UnicornBoard, wire: Wire, *, can: bool = False) -> None:
        self.board = board
        self.wire = wire
        self._unit = RECORD_SIZE if can else 1
        self._serviced_ns = -self.PERIOD_NS  # time of the last service; negative: none yet
        self._held = b""  # bytes read from the wire and not delivered yet

    @property
    def pwm_us(self) -> list[int]:
        """Pulse widths in microseconds, one per thruster, from the timers' registers."""
        return self.board.pwm_us

    @property
    def command_ns(self) -> int:
        """Monotonic time (ns) at which the firmware last wrote the pulse widths."""
        return self.board.command_ns

    @property
    def deadline_ns(self) -> int:
        """Time (ns) at which `service` must be called even without data."""
        return self._serviced_ns + (self.PERIOD_NS if len(self._held) < self._unit else 0)

    def fileno(self) -> int:
        """Return the descriptor to wait on for commands."""
        return self.wire.fileno()

    def service(self, now_ns: int) -> int:
        """Deliver received bytes, run the board until `now_ns`, send its output; return how many bytes came in.

        Received bytes are delivered before the time advances, as in `Stm32End`: a command does not wait until the board
        has caught up, and a late call does not trip the watchdog. Raises DeviceError when the wire is lost, or for a
        fault of the firmware.
        """
        passed_ns = now_ns - self._serviced_ns if self._serviced_ns >= 0 else 0
        self._serviced_ns = now_ns
        data = self._next_input()
        if data:
            self._deliver(data)
        self.board.run_until(self.board.now_ns + min(max(passed_ns, 0), self.PATIENCE_NS))
        output = self._take_output()
        if output:
            self.wire.write(output)
        return len(data)

    def close(self) -> None:
        """Reset the board, which stops the thrusters, and close the wire."""
        self.board.reset()
        self.wire.close()

    def _next_input(self) -> bytes:
        """Return the next bytes for the board, whole records on CAN."""
        if len(self._held) < self.AT_ONCE:
            self._held += self.wire.read()
        size = min(len(self._held), self.AT_ONCE) // self._unit * self._unit
        data, self._held = self._held[:size], self._held[size:]
        return data

    def _deliver(self, data: bytes) -> None:
        if self._unit == 1:
            self.board.receive(data)
        else:
            self.board.receive_can(unpack_frames(data))

    def _take_output(self) -> bytes:
        if self._unit == 1:
            return self.board.transmitted()
        return b"".join(map(pack_frame, self.board.transmitted_can()))


def _with_parameters(image: bytes, channels: int, watchdog_ns: int) -> bytes:
    start = PARAMETERS_ADDRESS - FLASH
    if len(image) > start:
        return image
    return image.ljust(start, b"\xff") + parameters(channels, watchdog_ns / NS_PER_S)
