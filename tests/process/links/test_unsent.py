"""At most one command waits for a busy wire, and a disarming command replaces it."""

import contextlib
import re
import socket
import struct
import termios
import time
from pathlib import Path

import pytest

from hil.cli import main
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError
from hil.links.address import parse_address
from hil.links.contract import Counters, Message, Protocol, ThrusterCommand, ThrusterLink, Wire
from hil.links.line_rate import line_speed
from hil.links.protocols import open_protocol
from hil.links.wires.faults import Faults
from hil.links.wires.net import TcpHostWire, TcpWire
from hil.links.wires.terminal import PtyWire, UartWire
from hil.links.wires.text_can_bus import SlcanWire
from hil.scenario.records import Link
from hil.slave.drivers.driver import open_driver
from hil.slave.drivers.ends import check_line_rate
from tests.support.processes import Program, wait_for, write_scenario

FULL = (1900,) * 6
NEUTRAL = (1500,) * 6


def armed(sequence: int) -> ThrusterCommand:
    return ThrusterCommand(sequence, True, FULL)


def disarmed(sequence: int) -> ThrusterCommand:
    return ThrusterCommand(sequence, False, NEUTRAL)


class SlowWire(Wire):
    """A wire that holds written bytes until `drain`."""

    name = "slow"

    def __init__(self) -> None:
        self.queue, self.transmitted = b"", b""

    def fileno(self) -> int:
        return -1

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> int:
        self.queue += data
        return len(data)

    def unsent(self) -> int:
        return len(self.queue)

    def discard_unsent(self) -> None:
        self.queue = b""

    def drain(self) -> None:
        self.transmitted, self.queue = self.transmitted + self.queue, b""

    def close(self) -> None:
        pass


class OneByteProtocol(Protocol):
    """A protocol whose commands are one byte, the sequence number; 255 is a message of the protocol itself."""

    def __init__(self) -> None:
        self.counters = Counters()

    def encode(self, message: Message) -> bytes:
        return bytes([message.sequence])

    def feed(self, data: bytes) -> list[Message]:
        return []


@pytest.fixture
def link() -> ThrusterLink:
    return ThrusterLink(SlowWire(), OneByteProtocol())


def wire_of(link: ThrusterLink) -> SlowWire:
    assert isinstance(link.wire, SlowWire)
    return link.wire


def test_only_the_newest_command_waits_for_a_busy_wire(link: ThrusterLink) -> None:
    for sequence in range(1, 100):
        link.send(armed(sequence))
    assert wire_of(link).queue == b"\x01"
    assert link.counters.replaced == 97, "2 to 98"
    link.tick(now_ns() + NS_PER_S)
    assert wire_of(link).queue == b"\x01", "the wire is still busy"
    wire_of(link).drain()
    assert link.deadline_ns < now_ns() + NS_PER_S, "the held command asks to be woken"
    link.tick(now_ns() + NS_PER_S)
    assert wire_of(link).queue == b"\x63"
    assert link.counters.messages_out == 2
    assert link.counters.replaced == 97


def test_a_free_wire_is_written_at_once(link: ThrusterLink) -> None:
    for sequence in range(1, 4):
        link.send(armed(sequence))
        wire_of(link).drain()
    assert wire_of(link).transmitted == b"\x01\x02\x03"
    assert link.counters.replaced == 0
    assert link.deadline_ns == link.protocol.deadline_ns


def test_a_disarming_command_discards_the_queue_once(link: ThrusterLink) -> None:
    link.send(armed(1))
    link.send(armed(2))
    link.send(disarmed(3))
    assert wire_of(link).queue == b"\x03"
    link.send(disarmed(4))
    assert wire_of(link).queue == b"\x03", "else no frame would ever be whole on a slow line"
    link.send(armed(5))
    wire_of(link).drain()
    link.tick(now_ns() + NS_PER_S)
    assert (wire_of(link).transmitted, wire_of(link).queue) == (b"\x03", b"\x05")


def test_a_held_command_is_sent_once(link: ThrusterLink) -> None:
    link.send(armed(1))
    link.send(armed(2))
    wire_of(link).drain()
    link.send(armed(3))
    wire_of(link).drain()
    link.tick(now_ns() + NS_PER_S)
    assert wire_of(link).transmitted == b"\x01\x03"


def test_the_queue_of_a_serial_device_is_read_and_discarded(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pty has no such queue, so the calls to the kernel are checked."""
    requests: list[tuple[int, int]] = []

    def count(_fd: int, request: int, _buffer: bytes) -> bytes:
        requests.append((_fd, request))
        return struct.pack("i", 56)

    device = PtyWire()
    with contextlib.closing(device), contextlib.closing(UartWire(device.path)) as wire:
        monkeypatch.setattr("hil.links.wires.terminal.fcntl.ioctl", count)
        monkeypatch.setattr("hil.links.wires.terminal.termios.tcflush", lambda fd, what: requests.append((fd, what)))
        assert wire.unsent() == 56
        wire.discard_unsent()
        assert requests == [(wire.terminal, termios.TIOCOUTQ), (wire.terminal, termios.TCOFLUSH)]


def test_tcp_counts_bytes_that_the_peer_has_no_room_for() -> None:
    with contextlib.closing(TcpWire()) as device, contextlib.closing(TcpHostWire("127.0.0.1", device.port)) as wire:
        assert wire.unsent() == 0
        assert wait_for(lambda: wire.write(bytes(4096)) >= 0 and wire.unsent() > 0), "the peer does not read"
        assert wait_for(lambda: device.read() == b"" and wire.unsent() == 0), "it reads"


def test_tcp_counts_bytes_that_stay_unacknowledged(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [NS_PER_S]
    monkeypatch.setattr("hil.links.wires.net.now_ns", lambda: now[0])
    listener = socket.create_server(("127.0.0.1", 0))
    with contextlib.closing(listener), contextlib.closing(TcpHostWire(*listener.getsockname())) as wire:
        queued = {0x5411: 0, 0x894B: 0}  # SIOCOUTQ, SIOCOUTQNSD: as when the cable is out
        monkeypatch.setattr("hil.links.wires.net.queued_bytes", lambda _fd, request: queued[request])
        for _ in range(5):
            wire.write(bytes(28))
            queued[0x5411] += 28
            assert wire.unsent() == 0, "under way, for a short while"
            now[0] += NS_PER_S // 50
        now[0] += NS_PER_S // 10
        assert wire.unsent() == 140
        queued[0x5411] = 28
        assert wire.unsent() == 0, "some of it was acknowledged"


def test_slcan_begins_a_new_line_after_discarded_bytes() -> None:
    line = SlowWire()
    wire = SlcanWire(line, 1_000_000)
    line.drain()
    frame = b"\x01\x00\x00\x80\x01\x00\x00\x00" + b"\xaa" + bytes(7)
    wire.write(frame)
    assert wire.unsent() == len(b"T000000011AA\r")
    wire.discard_unsent()
    wire.write(frame)
    assert line.queue == b"\rT000000011AA\r"


def test_a_closed_wire_has_nothing_unsent() -> None:
    device = PtyWire()
    wire = UartWire(device.path)
    wire.close()
    device.close()
    wire.discard_unsent()
    assert wire.unsent() == 0


def test_commands_beyond_9600_baud_do_not_delay_the_stop() -> None:
    """The line carries 34 of 80 commands a second: if they were queued, the thrusters would run 4 s too long."""
    driver = open_driver("python", Link(faults=Faults(baud=9600), watchdog=0.2), 6, True, 1, lambda _: None)
    with contextlib.closing(driver):
        due, end, sequence = now_ns(), now_ns() + 3 * NS_PER_S, 0
        while (now := now_ns()) < end:
            if now >= due:
                due, sequence = due + NS_PER_S // 80, sequence + 1
                driver.send(armed(sequence))
            driver.service(now)
            time.sleep(0.001)
        assert driver.pwm_us == FULL
        driver.send(disarmed(sequence + 1))
        stopped_ns = now_ns()
        while driver.pwm_us != NEUTRAL and now_ns() - stopped_ns < 5 * NS_PER_S:
            driver.service(now_ns())
            time.sleep(0.001)
        assert now_ns() - stopped_ns < 3.5 * NS_PER_S, "0.03 to 0.06 s on a quiet machine"
        assert driver.host
        assert driver.host.counters.replaced > 50


@pytest.mark.parametrize(
    ("link", "rate", "refused"),
    [
        (Link(port="/dev/ttyS0", baud=9600), 50.0, True),
        (Link(port="/dev/ttyS0", baud=19_200), 50.0, False),
        (Link(port="/dev/ttyS0", baud=57_600, protocol="mavlink"), 200.0, True),
        (Link(port="/dev/ttyS0", baud=57_600, protocol="mavlink"), 50.0, False),
        (Link(port="can:socketcan:can0", bitrate=20_000, protocol="vesc"), 50.0, True),
        (Link(port="can:socketcan:can0", bitrate=500_000, protocol="vesc"), 50.0, False),
        (Link(faults=Faults(baud=9600)), 50.0, True),
        (Link(faults=Faults(drop=0.1)), 1000.0, False),
        (Link(port="tcp://127.0.0.1:5760", baud=1200), 1000.0, False),
        (Link(baud=1200), 1000.0, False),
    ],
)
def test_a_line_that_is_too_slow_for_the_rate_is_refused(link: Link, rate: float, refused: bool) -> None:
    if not refused:
        check_line_rate(link, 6, rate)
        return
    with pytest.raises(ConfigError, match=r"commands a second of .* bits each, and .* are to be sent: use at least"):
        check_line_rate(link, 6, rate)


def test_doctor_and_slave_refuse_a_line_that_is_too_slow(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, _ = write_scenario(tmp_path, link="faults = { baud = 9600 }")
    assert main(["doctor", str(scenario)]) == 1
    assert re.search(
        r"problem +line rate +link: faults.baud: 9600 bit/s carry .*\n? *.*use at least", capsys.readouterr().out
    )
    with Program(tmp_path, "slave", scenario) as slave:
        assert slave.process.wait(60) == 2
        assert "link: faults.baud: 9600 bit/s carry" in slave.output


def test_the_rate_in_the_error_is_one_that_the_line_carries() -> None:
    protocol = open_protocol("frame", "host", 6)
    bit_count = len(protocol.encode(disarmed(1))) * 10
    with pytest.raises(ConfigError, match=f"link: baud: 9600 bit/s carry {8640 / bit_count:.3g} commands a second"):
        check_line_rate(Link(port="/dev/ttyS0", baud=9600), 6, 50.0)
    check_line_rate(Link(port="/dev/ttyS0", baud=9600), 6, 8639 / bit_count)


def test_the_slowest_part_of_a_link_limits_its_speed() -> None:
    assert line_speed(parse_address("/dev/ttyS0"), 9600, 500_000, 2400) == (2400, "faults.baud")
    assert line_speed(parse_address("can:slcan:/dev/ttyACM0"), 9600, 500_000) == (500_000, "bitrate")
    assert line_speed(parse_address("pty:"), 9600, 500_000) == (0, "")
