"""A line between two speeds: what a UART samples, who changes the speed, and when."""

import pytest

from hil.links.wires.line_speed import SpeedWire, _sampled
from hil.links.wires.terminal import PtyWire


class Pty(PtyWire):
    """The STM32's end of a pseudo terminal whose program the test plays."""

    def __init__(self, theirs: int = 0) -> None:
        self.name, self.theirs, self.received, self.sent, self.takes = "pty", theirs, b"", b"", True

    @property
    def baud(self) -> int:
        return self.theirs

    def set_baud(self, baud: int) -> None:
        self.theirs = self.theirs or baud

    def fileno(self) -> int:
        return 7

    def read(self) -> bytes:
        data, self.received = self.received, b""
        return data

    def write(self, data: bytes) -> int:
        self.sent += data if self.takes else b""
        return len(data) if self.takes else 0


@pytest.mark.parametrize(
    ("data", "sent", "read", "arrives"),
    [
        (b"any\x00", 9600, 9600, b"any\x00"),
        (b"any\x00", 9600, 0, b"any\x00"),  # a program that has set no speed
        (b"\x00", 19_200, 9600, b"\xf8"),  # nine bits low take four and a half of the slow ones
        (b"\xff", 19_200, 9600, b"\xff"),
        (b"\x00\x00", 19_200, 9600, b"\x08"),
        (b"\xff", 9600, 19_200, b"\xfe"),  # a start bit takes two of the fast ones
        (b"\x00", 9600, 19_200, b"\x00"),  # a break
        (b"U", 9600, 19_200, b"\x66\xe6"),
        (b"\x00", 115_200, 9600, b"\xff"),
        (b"", 9600, 19_200, b""),
    ],
)
def test_a_uart_samples_the_middle_of_its_own_bits(data: bytes, sent: int, read: int, arrives: bytes) -> None:
    assert _sampled(data, sent, read) == arrives


def test_both_directions_pass_between_the_two_speeds() -> None:
    pty = Pty()
    wire = SpeedWire(pty, 9600)
    assert (wire.baud, pty.theirs, wire.name, wire.fileno()) == (9600, 9600, "pty", 7)
    pty.received = b"\xff"
    assert (wire.read(), wire.write(b"\xff"), pty.sent) == (b"\xff", 1, b"\xff")
    assert wire.read() == b""
    pty.theirs, pty.received = 19_200, b"\x00"
    assert wire.read() == b"\xf8"
    assert (wire.write(b"UU"), pty.sent[1:]) == (2, _sampled(b"UU", 9600, 19_200))
    pty.takes = False
    assert wire.write(b"UU") == 0


def test_the_speed_changes_behind_the_bytes_that_were_written_before() -> None:
    pty = Pty()
    wire = SpeedWire(pty, 9600)
    wire.set_baud(19_200, 4)
    wire.set_baud(38_400, 5)
    assert wire.baud == 38_400
    for data, arrives in (
        (b"\xff\xff", b"\xff\xff"),
        (b"\xff\xff", b"\xff\xff"),
        (b"\x00", b"\xf8"),
        (b"\xff", b"\xff"),
    ):
        pty.sent = b""
        wire.write(data)
        assert pty.sent == arrives
    pty.received = b"\xff"
    assert (wire.read(), wire.baud) == (_sampled(b"\xff", 9600, 38_400), 38_400)


@pytest.mark.parametrize(
    ("automatic", "data", "baud"), [(b"UU", b"UUx", 57_600), (b"UU", b"xUU", 9600), (b"", b"UUx", 9600)]
)
def test_a_device_takes_the_speed_of_the_bytes_that_it_measures(automatic: bytes, data: bytes, baud: int) -> None:
    pty = Pty()
    wire = SpeedWire(pty, 9600, automatic)
    pty.theirs, pty.received = 57_600, data
    assert wire.read() == _sampled(data, 57_600, baud)
    assert wire.baud == baud
