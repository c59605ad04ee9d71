"""What each end of a link counts and writes, and the search for the command that a report answers."""

import pytest

from hil.common.clock import NEVER_NS
from hil.links.contract import (
    Counters,
    Message,
    Protocol,
    SentCommands,
    ThrusterCommand,
    ThrusterLink,
    Wire,
    count_read,
)

ARMED = ThrusterCommand(1, True, (1600,))


class Canned(Wire):
    """A wire that takes at most `room` bytes, and reads as it was given."""

    name = "canned"

    def __init__(self, *reads: bytes) -> None:
        self.reads, self.room, self.written, self.closed = list(reads), 99, b"", False

    def fileno(self) -> int:
        return -1

    def read(self) -> bytes:
        return self.reads.pop(0) if self.reads else b""

    def write(self, data: bytes) -> int:
        self.written += data[: self.room]
        return min(len(data), self.room)

    def close(self) -> None:
        self.closed = True


class Letters(Protocol):
    """Each byte is a command; it answers each with a dot, and sends a beat when that is due."""

    def __init__(self) -> None:
        self.counters, self.deadline_ns, self._answers = Counters(), 50, b""

    def encode(self, message: Message) -> bytes:
        return b"command"

    def feed(self, data: bytes) -> list[Message]:
        self._answers += b"." * len(data)
        return [ARMED] * len(data)

    def replies(self) -> bytes:
        answers, self._answers = self._answers, b""
        return answers

    def tick(self, now_ns: int) -> bytes:
        self.deadline_ns = NEVER_NS
        return b"beat"


def test_a_link_counts_what_it_reads_and_writes() -> None:
    wire = Canned(b"ab", b"", b"c")
    link = ThrusterLink(wire, Letters())
    assert [len(link.receive()) for _ in range(4)] == [2, 0, 1, 0]
    counters = link.counters
    assert (counters.bytes_in, counters.messages_in, wire.written) == (3, 3, b"...")
    link.tick(49)
    assert (wire.written, link.deadline_ns) == (b"...", 50)
    link.tick(50)
    assert (wire.written, link.deadline_ns) == (b"...beat", NEVER_NS)
    wire.room = 5
    link.send(ARMED)
    assert wire.written == b"...beatcomma"
    assert (counters.messages_out, counters.bytes_out, counters.dropped_bytes) == (1, 12, 2)
    link.close()
    assert wire.closed


def test_reading_ends_in_a_flood() -> None:
    assert count_read(Canned(b"ab", b"c", b"", b"d").read) == 3
    assert count_read(Canned(*[b"x"] * 9999).read) == 256


@pytest.mark.parametrize(
    ("sent", "reports", "answers"),
    [
        ([5, 6, 7], [6, 6, 5], [11, 11, 11]),  # what is older than an answered one is answered no more
        ([5, 6, 5], [5, 6], [12, 12]),  # the newest with these pulses
        ([5], [9, 5, 9], [0, 10, 10]),  # a report of nothing that was sent changes nothing
        (range(65), [0, 1], [0, 11]),  # the last 64 are known
        (range(64), [0, 63], [10, 73]),
    ],
)  # fmt: skip
def test_the_newest_command_with_the_pulses_of_a_report_is_answered(
    sent: list[int], reports: list[int], answers: list[int]
) -> None:
    commands = SentCommands()
    for sequence, pulse in enumerate(sent, 10):
        commands.add_sent((pulse,), sequence)
    assert [commands.match((pulse,)) for pulse in reports] == answers
    assert commands.answered == answers[-1]
