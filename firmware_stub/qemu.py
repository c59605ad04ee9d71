"""The shipped image on QEMU's STM32F405: a second opinion on the firmware, by an emulator that others wrote.

QEMU 7.2's machine netduinoplus2 has the USARTs, SysTick and the registers of the timers, but no clock control, no
watchdog in hardware, no pins and no CAN. It sends bytes at once, whatever the baud rate. When the machine is busy it
loses SysTicks: the firmware's time is then slower than the wall's, and its watchdog later.
"""

import json
import os
import select
import shutil
import socket
import subprocess
import tempfile
import time
from contextlib import ExitStack
from typing import Any

from firmware_stub.image import IMAGE, PARAMETERS_ADDRESS, parameters
from hil.errors import DeviceError
from hil.links.wires.terminal import READ_SIZE, DescriptorWire

PROGRAM = "qemu-system-arm"
PATIENCE_S = 10.0
HERE, THERE = "127.0.0.1", "127.0.0.2"  # the host's end and QEMU's, with one port number
ROOM = 1 << 20  # for bytes that nobody has read; the kernel counts 768 for each, and may give less
NO_ESCAPE = "0x100"  # of the multiplexer's commands: no byte is this one
PULSE_REGISTERS = (0x4000_0434, 0x4000_0834)  # CCR1 to CCR4 of TIM3, then of TIM4


class QemuStm32:
    """The process, its firmware running when this returns; end it with `close`.

    channels: 1 to 8. watchdog: the longest silence before all thrusters stop, s of the firmware's time. cpu: the one
    processor it may run on.

    `wire` is the host's end of its USART; what nobody reads is lost, after some hundred bytes, or a thousand.

    Raises DeviceError without QEMU, if it does not start, or if the firmware says nothing.
    """

    def __init__(self, channels: int = 6, watchdog: float = 0.2, cpu: int | None = None) -> None:
        if not shutil.which(PROGRAM):
            raise DeviceError(f"no {PROGRAM}: sudo apt install --no-install-recommends {PROGRAM}")
        in_flash = parameters(channels, watchdog)
        self._channels = channels
        self._qmp: _Qmp | None = None
        with ExitStack() as held:  # whatever fails on the way, nothing of it stays
            folder = held.enter_context(tempfile.TemporaryDirectory(prefix="uuv-hil-qemu-"))
            self._monitor = os.path.join(folder, "qmp")
            with open(os.path.join(folder, "parameters"), "wb") as file:
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
        """What stands in the timers' compare registers (us), read by QEMU and not by the firmware."""
        if self._qmp is None:
            self._qmp = _Qmp(self._connect_monitor())
        words = [word for address in PULSE_REGISTERS for word in self._qmp.words(address, 4)]
        return tuple(words[: self._channels])

    def close(self) -> None:
        """End it and remove its files. Closing twice is harmless."""
        self._held.close()

    def _start(self, parameters_path: str) -> subprocess.Popen[bytes]:
        command = self._command(parameters_path)
        try:
            return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True)
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
            PROGRAM, "-M", "netduinoplus2", "-display", "none", "-monitor", "none", "-kernel", IMAGE,
            "-device", f"loader,file={parameters_path},addr={PARAMETERS_ADDRESS:#x},force-raw=on",
            "-qmp", f"unix:{self._monitor},server=on,wait=off",
            "-chardev", f"udp,id=usart,{usart}", "-serial", "chardev:usart", "-echr", NO_ESCAPE,
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
            if self._process.poll() is not None:
                raise DeviceError(f"{PROGRAM}: did not come up: {self._complaint()}")
            if time.monotonic() > deadline:
                raise DeviceError(f"{PROGRAM}: the firmware says nothing; is {IMAGE} whole?")

    def _complaint(self) -> str:
        """What it said; it has ended."""
        assert self._process.stderr
        said = self._process.stderr.read().decode(errors="replace").splitlines()
        return "; ".join(said) or "it says nothing"


class _Usart(DescriptorWire):
    """The host's end of its USART: it sends a datagram a byte. Bound before it starts, so that no word is lost."""

    def __init__(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as usart:
            usart.setblocking(False)
            usart.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM)
            usart.bind((HERE, 0))
            self.port: int = usart.getsockname()[1]
            usart.connect((THERE, self.port))  # nobody else is heard
            super().__init__(usart.detach(), f"{PROGRAM} udp://{THERE}:{self.port}")

    def read(self) -> bytes:
        """The bytes that have come in, or b"". Raises DeviceError when QEMU is gone, which a write brings out."""
        taken = bytearray()
        while len(taken) < READ_SIZE:
            byte = super().read()
            if not byte:
                break
            taken += byte
        return bytes(taken)


class _Qmp:
    """QEMU's machine protocol: one JSON object a line, https://www.qemu.org/docs/master/interop/qmp-spec.html."""

    def __init__(self, connection: socket.socket) -> None:
        connection.settimeout(PATIENCE_S)
        self._connection = connection
        self._lines = connection.makefile("r")
        self._lines.readline()  # its greeting
        self._ask("qmp_capabilities")

    def words(self, address: int, count: int) -> list[int]:
        """Words of the machine's memory: the answer to `xp` is "40000434: 0x000005dc 0x000005dc ..."."""
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
