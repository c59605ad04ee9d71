"""The shipped images in QEMU, an independent emulator as a second check of the firmware.

QEMU 7.2's machine netduinoplus2 has the USARTs, SysTick and the registers of the timers, but no clock control, no
watchdog in hardware, no pins and no CAN. It sends bytes at once, whatever the baud rate. When the machine is busy it
loses SysTicks: the firmware's time is then slower than the wall's, and its watchdog later.

It has no machine with an F411 or F446: their images run on that F405, which has all that they use; nor with an F103,
whose image runs on the F100 of stm32vldiscovery: serial port and SysTick, without timers. These machines' cores have
another clock than the chip, so that the firmware's time passes at `Machine.speed` times the wall's.
"""

import json
import os
import select
import shutil
import socket
import subprocess
import time
from contextlib import ExitStack
from typing import Any, NamedTuple

from firmware_stub.image import DEFAULT_CHIP, PARAMETERS_ADDRESS, image_path, parameters
from hil.common.children import foreign_command, start_child
from hil.common.errors import DeviceError
from hil.common.lifeline import NO_PROGRAM
from hil.common.scratch import ScratchFolder
from hil.links.wires.terminal import READ_SIZE, DescriptorWire

PROGRAM = "qemu-system-arm"
PATIENCE_S = 10.0
HERE, THERE = "127.0.0.1", "127.0.0.2"  # the host's end and QEMU's, with one port number
ROOM = 1 << 20  # for unread bytes; the kernel counts 768 for each, and may give less
NO_ESCAPE = "0x100"  # of the multiplexer's commands: no byte is this one
PULSE_REGISTERS = (0x4000_0434, 0x4000_0834)  # CCR1 to CCR4 of TIM3, then of TIM4


class Machine(NamedTuple):
    """QEMU's machine that an image runs on.

    usart: the number of the serial port that the image uses. speed: of the firmware's time, 1 is the wall's.
    """

    name: str
    usart: int
    speed: float
    has_timers: bool


MACHINES = {
    "f103": Machine("stm32vldiscovery", 0, 24 / 64, has_timers=False),
    "f405": Machine("netduinoplus2", 0, 1.0, has_timers=True),
    "f411": Machine("netduinoplus2", 1, 168 / 84, has_timers=True),
    "f446": Machine("netduinoplus2", 1, 1.0, has_timers=True),
}


class QemuStm32:
    """Process of QEMU with the firmware running when this returns; end it with `close`.

    channels: 1 to 8. watchdog: the longest time without a command before all thrusters stop, s of the firmware's time.
    cpu: the one processor it may run on. chip: whose image it runs, of firmware_stub.image.CHIPS.

    `wire` is the host's end of its USART; unread bytes are lost, after some hundred or a thousand of them.

    Raises DeviceError without QEMU, if it does not start, or if the firmware sends nothing.
    """

    def __init__(
        self, channels: int = 6, watchdog: float = 0.2, cpu: int | None = None, chip: str = DEFAULT_CHIP
    ) -> None:
        if not shutil.which(PROGRAM):
            raise DeviceError(f"no {PROGRAM}: sudo apt install --no-install-recommends {PROGRAM}")
        in_flash = parameters(channels, watchdog)
        self._channels = channels
        self._image = image_path(chip)
        self.machine = MACHINES[chip]
        self._qmp: _Qmp | None = None
        with ExitStack() as held:  # if a step fails, all before it is undone
            folder = held.enter_context(ScratchFolder("qemu"))
            self._monitor = folder.file("qmp")
            with open(folder.file("parameters"), "wb") as file:
                file.write(in_flash)
            self.wire = _Usart()
            held.callback(self.wire.close)
            self._process = self._start(file.name)
            held.callback(self._end)
            self.pid = self._process.pid
            if cpu is not None:
                os.sched_setaffinity(self.pid, {cpu})
            self._wait_for_its_first_byte()
            self._held = held.pop_all()

    def pwm_us(self) -> tuple[int, ...]:
        """Return the pulses (us) from the compare registers, read by QEMU and not by the firmware; 0 without timers."""
        if self._qmp is None:
            self._qmp = _Qmp(self._connect_monitor())
        words = [word for address in PULSE_REGISTERS for word in self._qmp.words(address, 4)]
        return tuple(words[: self._channels])

    def close(self) -> None:
        """End QEMU and remove its files. Closing twice is harmless."""
        self._held.close()

    def _start(self, parameters_path: str) -> subprocess.Popen[bytes]:
        command = foreign_command(*self._command(parameters_path))
        try:
            return start_child(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        except OSError as error:
            raise DeviceError(f"{PROGRAM}: cannot be started: {error.strerror}") from None

    def _end(self) -> None:
        if self._qmp is not None:
            self._qmp.close()
            self._qmp = None
        self._process.kill()  # it holds nothing that could be lost
        self._process.communicate()

    def _command(self, parameters_path: str) -> list[str]:
        # Multiplexed, as QEMU then reads ahead and hands on the next byte when the firmware takes one; otherwise each
        # waits for a turn of QEMU's loop. Datagrams, as it reads those at once and a stream byte by byte. Together
        # a command and its answer take 0.3 ms instead of 0.8.
        usart = f"host={HERE},port={self.wire.port},localaddr={THERE},localport={self.wire.port},mux=on"
        return [
            PROGRAM, "-M", self.machine.name, "-display", "none", "-monitor", "none", "-kernel", self._image,
            "-device", f"loader,file={parameters_path},addr={PARAMETERS_ADDRESS:#x},force-raw=on",
            "-qmp", f"unix:{self._monitor},server=on,wait=off",
            "-chardev", f"udp,id=usart,{usart}", *["-serial", "null"] * self.machine.usart,
            "-serial", "chardev:usart", "-echr", NO_ESCAPE,
        ]  # fmt: skip

    def _connect_monitor(self) -> socket.socket:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.connect(self._monitor)
        except OSError as error:
            connection.close()
            raise DeviceError(f"{PROGRAM}: its monitor does not answer: {error.strerror}") from None
        return connection

    def _wait_for_its_first_byte(self) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not select.select([self.wire], (), (), 0.01)[0]:
            if self._process.poll() == NO_PROGRAM:
                raise DeviceError(self._error_text())
            if self._process.poll() is not None:
                raise DeviceError(f"{PROGRAM}: did not come up: {self._error_text()}")
            if time.monotonic() > deadline:
                raise DeviceError(f"{PROGRAM}: the firmware says nothing; is {self._image} whole?")

    def _error_text(self) -> str:
        """Return the error messages of the process, which has ended."""
        assert self._process.stderr
        lines = self._process.stderr.read().decode(errors="replace").splitlines()
        return "; ".join(lines) or "it says nothing"


class _Usart(DescriptorWire):
    """Host end of the USART: one datagram a byte. Bound before QEMU starts, so that no byte is lost."""

    def __init__(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as usart:
            usart.setblocking(False)
            usart.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM)
            usart.bind((HERE, 0))
            self.port: int = usart.getsockname()[1]
            usart.connect((THERE, self.port))  # others are ignored
            super().__init__(usart.detach(), f"udp://{THERE}:{self.port}")

    def read(self) -> bytes:
        """Return the received bytes, or b"". Raises DeviceError when QEMU has ended, which a write detects."""
        taken = bytearray()
        while len(taken) < READ_SIZE:
            byte = super().read()
            if not byte:
                break
            taken += byte
        return bytes(taken)


class _Qmp:
    """Client of QEMU's machine protocol: one JSON object a line, https://www.qemu.org/docs/master/interop/qmp-spec.html."""

    def __init__(self, connection: socket.socket) -> None:
        connection.settimeout(PATIENCE_S)
        self._connection = connection
        self._lines = connection.makefile("r")
        self._lines.readline()  # its greeting
        self._ask("qmp_capabilities")

    def words(self, address: int, count: int) -> list[int]:
        """Return words of the machine's memory: the answer to `xp` is "40000434: 0x000005dc 0x000005dc ..."."""
        answer = self._ask("human-monitor-command", **{"command-line": f"xp /{count}wx {address:#x}"})
        return [int(word, 16) for word in str(answer).split()[1:]]

    def close(self) -> None:
        self._lines.close()
        self._connection.close()

    def _ask(self, command: str, **arguments: Any) -> Any:
        self._connection.sendall(json.dumps({"execute": command, "arguments": arguments}).encode() + b"\n")
        while True:
            message = json.loads(self._lines.readline())
            if "return" in message:
                return message["return"]
            if "error" in message:
                raise DeviceError(f"{PROGRAM}: {command}: {message['error']['desc']}")
