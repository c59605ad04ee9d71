"""Run the shipped images in QEMU, an independent emulator, as a second check of the firmware.

QEMU 7.2's machine netduinoplus2 (an F405) has the USARTs, SysTick and the registers of the timers, but no clock
control, no hardware watchdog, no pins and no CAN. It sends bytes at once, at any baud rate. On a busy computer it loses
SysTicks; the firmware's time is then slower than real time, and its watchdog trips later.

QEMU has no machine with an F411 or F446. Their images run on the F405, which has all that they use. It has none with an
F103 either, whose image runs on the F100 of stm32vldiscovery, with serial port and SysTick, without timers. The cores
of these machines have a different clock frequency, so the firmware's time runs at `Machine.speed` times real time.
"""

import json
import os
import select
import socket
import subprocess
import tempfile
from typing import Any, NamedTuple

from firmware_stub.image import PARAMETERS_ADDRESS, image_path, parameters
from hil.links.wires.terminal import READ_SIZE, DescriptorWire

PROGRAM = "qemu-system-arm"
PATIENCE_S = 10.0
HOST_ADDRESS, QEMU_ADDRESS = "127.0.0.1", "127.0.0.2"  # the host's end and QEMU's, with one port number
RECEIVE_BUFFER = 1 << 20  # size of the receive buffer; the kernel counts 768 for each byte, and may grant less
NO_ESCAPE = "0x100"  # escape character of the multiplexer; no byte has this value
PULSE_REGISTERS = (0x4000_0434, 0x4000_0834)  # CCR1 to CCR4 of TIM3, then of TIM4


class Machine(NamedTuple):
    """A machine of QEMU that an image runs on.

    usart: number of the serial port that the image uses. speed: the firmware's time over real time.
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
    """Process of QEMU, with the firmware running when this returns; stop it with `close`.

    channels: 1 to 8. watchdog: the longest time without a command before all thrusters stop, s of the firmware's time.
    cpu: the only processor it may run on. chip: the image's chip, of firmware_stub.image.CHIPS.

    `wire` is the host's end of its USART. Beyond some hundred unread bytes, further ones are lost.
    """

    def __init__(self, channels: int, watchdog: float, cpu: int, chip: str) -> None:
        in_flash = parameters(channels, watchdog)
        self._channels = channels
        self._image = image_path(chip)
        self.machine = MACHINES[chip]
        self._qmp: _Qmp | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="qemu")
        self._monitor = f"{self._folder.name}/qmp"
        with open(f"{self._folder.name}/parameters", "wb") as file:
            file.write(in_flash)
        self.wire = _Usart()
        self._process = subprocess.Popen(self._command(file.name), stdout=subprocess.DEVNULL)
        self.pid = self._process.pid
        os.sched_setaffinity(self.pid, {cpu})
        assert select.select([self.wire], (), (), PATIENCE_S)[0], "the firmware sends nothing"

    def pwm_us(self) -> tuple[int, ...]:
        """Return the pulses (us), read by QEMU from the timers' compare registers; 0 without timers."""
        if self._qmp is None:
            self._qmp = _Qmp(self._monitor)
        words = [word for address in PULSE_REGISTERS for word in self._qmp.read_words(address, 4)]
        return tuple(words[: self._channels])

    def close(self) -> None:
        if self._qmp is not None:
            self._qmp.close()
        self._process.kill()  # it has no data that could be lost
        self._process.wait()
        self.wire.close()
        self._folder.cleanup()

    def _command(self, parameters_path: str) -> list[str]:
        # Multiplexed, because QEMU then reads ahead, and delivers the next byte when the firmware has read one;
        # otherwise each byte waits for a cycle of QEMU's loop. Datagrams, because QEMU reads a stream byte by byte.
        # With both, a command and its answer take 0.3 ms instead of 0.8 ms.
        usart = f"host={HOST_ADDRESS},port={self.wire.port},localaddr={QEMU_ADDRESS},localport={self.wire.port},mux=on"
        return [
            PROGRAM, "-M", self.machine.name, "-display", "none", "-monitor", "none", "-kernel", self._image,
            "-device", f"loader,file={parameters_path},addr={PARAMETERS_ADDRESS:#x},force-raw=on",
            "-qmp", f"unix:{self._monitor},server=on,wait=off",
            "-chardev", f"udp,id=usart,{usart}", *["-serial", "null"] * self.machine.usart,
            "-serial", "chardev:usart", "-echr", NO_ESCAPE,
        ]  # fmt: skip


class _Usart(DescriptorWire):
    """Host end of the USART, with one datagram per byte. It is bound before QEMU starts, so that no byte is lost."""

    def __init__(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as usart:
            usart.setblocking(False)
            usart.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            usart.bind((HOST_ADDRESS, 0))
            self.port: int = usart.getsockname()[1]
            usart.connect((QEMU_ADDRESS, self.port))  # datagrams from other addresses are ignored
            super().__init__(usart.detach(), f"udp://{QEMU_ADDRESS}:{self.port}")

    def read(self) -> bytes:
        """Return the received bytes, or b"". A datagram has one of them."""
        received = bytearray()
        while len(received) < READ_SIZE:
            byte = super().read()
            if not byte:
                break
            received += byte
        return bytes(received)


class _Qmp:
    """Client of QMP, one JSON object per line: https://www.qemu.org/docs/master/interop/qmp-spec.html."""

    def __init__(self, path: str) -> None:
        self._connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._connection.settimeout(PATIENCE_S)
        self._connection.connect(path)
        self._lines = self._connection.makefile("r")
        self._lines.readline()  # its greeting
        self._ask("qmp_capabilities")

    def read_words(self, address: int, count: int) -> list[int]:
        """Return words of the machine's memory. The answer to `xp` is "40000434: 0x000005dc 0x000005dc ..."."""
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
                raise RuntimeError(message["error"]["desc"])
