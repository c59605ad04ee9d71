"""The command receiver: the newest command applies, stale and malformed ones are dropped and counted."""

import select
import time
from collections import deque
from collections.abc import Iterator
from typing import Any, ClassVar

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.common.clock import to_wall_ns
from hil.network.clock_offset import ClockOffset
from hil.ros import encoders as ros
from hil.ros.commands import encode_number
from hil.ros.diagnostics import Diagnostics
from hil.ros.joints import encode_accessories
from hil.slave import command_receiver as module
from hil.slave.command_receiver import AgeFilter, CommandReceiver, decode_velocity
from sim.sensors.samples import PressureSample

GID, OTHER = bytes(range(16)), bytes(16)
MS = 1_000_000
HOLD_MS = 500  # the default of a command receiver


class Clock:
    """A clock that passes only when a test advances it or the code sleeps; `current` is the clock of the test."""

    current: ClassVar["Clock"]

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        Clock.current, self.now_ns = self, 10**12
        self.slept: list[float] = []
        monkeypatch.setattr(module, "now_ns", lambda: self.now_ns)
        monkeypatch.setattr(time, "sleep", self.sleep)

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.wait(seconds * 1000)

    def wait(self, milliseconds: float) -> None:
        self.now_ns += round(milliseconds * MS)

    def deliver(
        self,
        command_receiver: CommandReceiver,
        sequence: int,
        gid: bytes = GID,
        age_ms: float = 0.0,
        topic: str = "cmd_vel",
    ) -> bool:
        """Deliver a command; return True if it is accepted."""
        stamp = ros.pack_attachment(sequence, to_wall_ns(self.now_ns) - round(age_ms * MS), gid)
        twist, lights = ros.encode_twist((0.5, 0, 0), (0, 0, 0)), encode_accessories(0, {"lights": 1.0})
        command_receiver.on_message(topic, lights if topic == "cmd_accessories" else twist, stamp)
        return command_receiver.take_latest() is not None


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Set a clock for every test, so that none depends on real ages or rates."""
    return Clock(monkeypatch)


@pytest.fixture
def command_receiver() -> Iterator[CommandReceiver]:
    command_receiver = CommandReceiver(age_limit_ns=100 * MS)
    yield command_receiver
    command_receiver.close()


def deliver(
    command_receiver: CommandReceiver, sequence: int, surge: float = 0.5, age_ms: float = 0.0, gid: bytes = GID
) -> None:
    sent = to_wall_ns(Clock.current.now_ns) - round(age_ms * MS)
    command_receiver.on_message(
        "cmd_vel", ros.encode_twist((surge, 0, 0), (0, 0, 0)), ros.pack_attachment(sequence, sent, gid)
    )


def test_a_command_wakes_the_loop_and_is_returned_once(command_receiver: CommandReceiver) -> None:
    assert command_receiver.take_latest() is None
    deliver(command_receiver, 1, surge=0.3)
    deliver(command_receiver, 2, surge=0.7)
    assert select.select((command_receiver,), (), (), 0)[0]
    latest = command_receiver.take_latest()
    assert latest is not None
    assert isinstance(latest.command, VelocityCommand)
    assert latest.command.surge == pytest.approx(0.7)
    assert latest.sequence == 2
    assert command_receiver.take_latest() is None
    assert not select.select((command_receiver,), (), (), 0)[0]


def test_a_command_that_is_not_read_in_time_is_dropped(command_receiver: CommandReceiver, clock: Clock) -> None:
    deliver(command_receiver, 1)
    clock.wait(100)
    assert command_receiver.take_latest() is not None
    deliver(command_receiver, 2)
    clock.wait(100 + 1 / MS)  # longer than its limit
    assert command_receiver.take_latest() is None
    assert command_receiver.stale == 1


def test_another_master_is_refused_until_the_first_times_out(command_receiver: CommandReceiver) -> None:
    deliver(command_receiver, 1)
    deliver(command_receiver, 1, gid=OTHER)
    assert (command_receiver.master, command_receiver.refused) == (GID, 1)
    assert command_receiver.take_latest() is not None
    assert command_receiver.wakeup.is_set(), "the diagnostics name it"
    command_receiver.wakeup.clear()
    command_receiver.remove_sender(GID)
    assert command_receiver.wakeup.is_set()
    deliver(command_receiver, 2, gid=OTHER)
    assert command_receiver.master == OTHER
    command_receiver.ranks[GID] = 1
    deliver(command_receiver, 2)
    assert command_receiver.master == GID, "a higher rank takes over at once"
    deliver(command_receiver, 3, gid=OTHER)
    assert command_receiver.refused == 2


def test_a_new_receiver_has_no_master_and_takes_only_topics_of_commands() -> None:
    receiver = CommandReceiver(age_limit_ns=100 * MS)
    assert (receiver.is_master_timed_out, receiver.master, receiver.fault) == (True, b"", "")
    for topic in ("cmd_nothing", "imu", "pressure"):
        receiver.on_message(topic, ros.encode_pressure(PressureSample(0, 1e5), ""), ros.pack_attachment(1, 0, GID))
    receiver.on_message("cmd_vel", ros.encode_twist((0, 0, 0), (0, 0, 0)), b"")  # without its time
    receiver.close()
    assert (receiver.malformed, receiver.master) == (4, b"")


def test_a_removed_unknown_sender_frees_the_vehicle_for_another_master(command_receiver: CommandReceiver) -> None:
    deliver(command_receiver, 1)
    command_receiver.ranks[GID] = 0
    command_receiver.remove_sender(GID)
    command_receiver.on_message(
        "cmd_depth", encode_number(2.0), ros.pack_attachment(1, to_wall_ns(Clock.current.now_ns), OTHER)
    )
    assert command_receiver.master == OTHER


def test_topics_with_publishers_of_their_own_are_one_master(command_receiver: CommandReceiver, clock: Clock) -> None:
    command_receiver.ranks.update({GID: 0, OTHER: 1})
    assert clock.deliver(command_receiver, 1)
    for number, publisher in enumerate((b"p" * 16, OTHER)):  # the rank of a publisher is that of its master
        stamp = ros.pack_attachment(1, to_wall_ns(clock.now_ns), publisher) + GID
        command_receiver.on_message(f"cmd_{('depth', 'heading')[number]}", encode_number(2.0), stamp)
        assert command_receiver.take_latest() is not None
    assert (command_receiver.master, command_receiver.refused) == (GID, 0)


@pytest.mark.parametrize("topic", ["cmd_vel", "cmd_accessories"])
def test_a_flood_makes_the_reader_sleep(command_receiver: CommandReceiver, clock: Clock, topic: str) -> None:
    command_receiver.move = lambda _: None
    for sequence in range(1, 61):
        clock.deliver(command_receiver, sequence, topic=topic)
    assert sum(clock.slept) == pytest.approx(0.2, abs=0.02), "60 commands at 200 a second, less a burst of a tenth"
    assert command_receiver.flooded == 60 - 21, "a burst of 0.1 s and the next one do not wait"


@pytest.mark.parametrize(("rate", "every_ms", "floods"), [(5000, 0.25, False), (200, 1.1, False), (200, 0.5, True)])
def test_refused_commands_overload_beyond_their_limit(clock: Clock, rate: float, every_ms: float, floods: bool) -> None:
    receiver = CommandReceiver(age_limit_ns=100 * MS, rate=rate)
    deliver(receiver, 1)
    for sequence in range(1, 400):
        clock.wait(every_ms)
        deliver(receiver, sequence, gid=OTHER)
    receiver.close()
    assert (receiver.refused, receiver.flooded > 0) == (399, floods)


@pytest.mark.parametrize("rate", [300, 20_000])
@pytest.mark.parametrize("is_known", [False, True], ids=["outsiders", "masters"])
def test_a_flood_of_a_refused_sender_neither_blocks_nor_replaces_the_master(
    command_receiver: CommandReceiver, clock: Clock, rate: int, is_known: bool
) -> None:
    """Messages that arrive while the reader sleeps wait in a ring of eight, as on the network."""
    if is_known:
        command_receiver.ranks.update({GID: 0, OTHER: 0})
    ring: deque[tuple[int, bytes]] = deque(maxlen=8)
    sent = dict.fromkeys((GID, OTHER), 0)
    accepted = dict.fromkeys((GID, OTHER), 0)
    start = clock.now_ns
    while clock.now_ns < start + 2 * 10**9:
        for gid, due in ((GID, 20), (OTHER, rate)):
            while sent[gid] < (clock.now_ns - start) * due / 1e9:
                sent[gid] += 1
                ring.append((sent[gid], gid))
        while ring:
            sequence, gid = ring.popleft()
            accepted[gid] += clock.deliver(command_receiver, sequence, gid)
        clock.wait(0.05)
    assert accepted == {GID: sent[GID], OTHER: 0}
    assert command_receiver.master == GID
    assert command_receiver.refused > 0.9 * sent[OTHER]
    assert max(clock.slept, default=0.0) < 0.001


@pytest.mark.parametrize("gid", [GID, OTHER], ids=["master", "other"])
def test_under_overload_the_master_does_not_time_out(
    command_receiver: CommandReceiver, clock: Clock, gid: bytes
) -> None:
    """A master's missing commands may be lost among thousands of others under overload."""
    command_receiver.ranks[OTHER] = 0
    clock.deliver(command_receiver, 1)
    for sequence in range(1, 6001):  # 0.6 s
        assert not clock.deliver(command_receiver, sequence, OTHER)
        clock.wait(0.1)
    assert not command_receiver.is_master_timed_out
    assert clock.slept, "the loop gets its time"
    clock.wait(HOLD_MS + 1)
    assert command_receiver.is_master_timed_out
    assert clock.deliver(command_receiver, 6001, gid)
    assert command_receiver.master == gid


def test_commands_of_a_refused_sender_are_not_decoded(command_receiver: CommandReceiver) -> None:
    deliver(command_receiver, 1)
    command_receiver.on_message("cmd_vel", b"\xff" * 52, ros.pack_attachment(1, 0, OTHER))
    command_receiver.on_message("cmd_pose", b"\xff" * 52, ros.pack_attachment(1, 0, bytes(15) + b"x"))
    assert (command_receiver.refused, command_receiver.malformed) == (1, 1), "an outsider may have a topic of its own"


def test_refused_senders_do_not_displace_the_masters_state(command_receiver: CommandReceiver, clock: Clock) -> None:
    for sequence in range(1, 40):
        assert clock.deliver(command_receiver, sequence)
        clock.wait(50)
    for number in range(200):
        assert not clock.deliver(command_receiver, 1, number.to_bytes(16, "big"))
    assert len(command_receiver._senders) == 1
    assert not clock.deliver(command_receiver, 5, age_ms=1700)
    assert (command_receiver.disordered, command_receiver.stale) == (1, 0)


def test_many_earlier_masters_do_not_displace_a_masters_state(command_receiver: CommandReceiver, clock: Clock) -> None:
    command_receiver.ranks[GID] = 1
    assert clock.deliver(command_receiver, 7)
    for number in range(200):
        clock.wait(HOLD_MS + 1)
        assert clock.deliver(command_receiver, 1, number.to_bytes(16, "big"))
        assert clock.deliver(command_receiver, 8 + number)
    assert len(command_receiver._senders) == module._MAX_SENDERS
    clock.wait(HOLD_MS + 1)
    assert clock.deliver(command_receiver, 1, OTHER)
    assert not clock.deliver(command_receiver, 100)
    assert command_receiver.disordered == 1


# Sequence, sender, age (ms), wait before it (ms), and what it adds to the counters besides `received`.
COUNTED: list[Any] = [
    ([], {}),
    ([(5, GID, 0, 0)], {}),
    ([(5, GID, 0, 0), (6, GID, 0, 0)], {"superseded": 1}),
    ([(5, GID, 0, 0), (4, GID, 0, 0), (5, GID, 0, 0)], {"disordered": 2}),
    ([(5, GID, 0, 0), (1, OTHER, 0, HOLD_MS)], {"refused": 1}),
    ([(5, GID, 0, 0), (1, OTHER, 0, HOLD_MS + 1 / MS)], {"superseded": 1}),
    ([(5, GID, 100, 0)], {}),
    ([(5, GID, 100 + 1 / MS, 0), (5, GID, 0, 0)], {"stale": 1, "disordered": 0}),
]


@pytest.mark.parametrize(("commands", "counted"), COUNTED)
def test_each_command_is_counted_once(
    command_receiver: CommandReceiver, clock: Clock, commands: list[tuple[int, bytes, float, float]], counted: Any
) -> None:
    """The limits of age and silence are exact: by a nanosecond on either side."""
    assert (command_receiver.master, command_receiver.fault) == (b"", "")
    now, ahead_ms = to_wall_ns(clock.now_ns), 7000
    for sender in (GID, OTHER):
        command_receiver.clocks[sender] = exact = ClockOffset()
        exact.add(now, now + ahead_ms * MS, now + ahead_ms * MS, now)
    for sequence, sender, age_ms, wait_ms in commands:
        clock.wait(wait_ms)
        deliver(command_receiver, sequence, age_ms=age_ms - ahead_ms, gid=sender)
    figures = Diagnostics()
    command_receiver.add_figures(figures)
    names = ("malformed", "stale", "disordered", "superseded", "refused", "flooded")
    found = {name: figures[f"commands_{name}"] for name in names}
    assert found == dict.fromkeys(names, 0) | counted
    shown = figures.commands_received, figures.thrusters, figures.commands_fault
    assert shown == (len(commands), 0, command_receiver.fault)


def test_stale_commands_are_never_executed(command_receiver: CommandReceiver) -> None:
    deliver(command_receiver, 1)
    assert command_receiver.take_latest() is not None
    command_receiver.remove_sender(GID)
    Clock.current.wait(3000)
    deliver(command_receiver, 2, age_ms=3000)
    assert command_receiver.take_latest() is None
    assert (command_receiver.stale, command_receiver.master) == (1, b"")
    deliver(command_receiver, 3)
    assert command_receiver.take_latest() is not None


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_velocity_that_no_vehicle_reaches_is_malformed(axis: int, side: float) -> None:
    fine, absurd = [0.0] * 6, [0.0] * 6
    fine[axis], absurd[axis] = side * 100.0, side * 100.001
    for speeds, is_command in ((fine, True), (absurd, False)):
        twist = ros.encode_twist(speeds[:3], speeds[3:])
        assert (decode_velocity(twist) is not None) is is_command


def test_ages_need_no_common_clock() -> None:
    ages, offset = AgeFilter(), -7 * 3600 * 10**9  # the master's clock is seven hours wrong
    assert ages.age_ns(offset, 5 * MS, 0) == 0
    assert ages.age_ns(offset + 50 * MS, 57 * MS, 52 * MS) == pytest.approx(2 * MS, abs=10_000)
    offset -= 3600 * 10**9  # it is set: this message counts as old as the one before
    assert ages.age_ns(offset + 60 * MS, 67 * MS, 62 * MS) == pytest.approx(2 * MS, abs=10_000)
    assert ages.age_ns(offset + 100 * MS, 103 * MS, 98 * MS) == 0


def test_ages_follow_drifting_clocks() -> None:
    ages = AgeFilter()
    hour, age = 3600 * 10**9, 0
    for second in range(0, 3600, 10):
        sent = second * 10**9
        age = ages.age_ns(sent, sent + round(second * 10**9 * 40e-6), sent)  # 40 ppm apart
    assert age < 1 * MS, f"after {hour} ns the drift of 144 ms does not count as age"


def commands(
    command_receiver: CommandReceiver, clock: Clock, first: int, seconds: float, age_ms: float, per_instant: int = 1
) -> list[bool]:
    """Return which of the commands that come 20 times a second are accepted; `each` is the step of their numbers."""
    accepted = []
    for sequence in range(first, first + round(20 * seconds) * per_instant, per_instant):
        clock.wait(50)
        accepted.append(clock.deliver(command_receiver, sequence, age_ms=age_ms + sequence % 3 * 5))
    return accepted


@pytest.mark.parametrize("is_known", [False, True], ids=["no exchange", "known offset"])
def test_a_clock_that_was_set_back_stops_nothing(
    command_receiver: CommandReceiver, clock: Clock, is_known: bool
) -> None:
    if is_known:
        offset = command_receiver.clocks[GID] = ClockOffset()
        now = to_wall_ns(clock.now_ns)
        offset.add(now, now, now, now)
    assert all(commands(command_receiver, clock, 1, 5, 2))
    assert all(commands(command_receiver, clock, 101, 5, 3_600_002))
    assert command_receiver.stale == 0
    assert command_receiver.fault == "cmd_vel: the clock of its sender was set back, or ours was set forward"
    clock.wait(1000)
    assert not clock.deliver(command_receiver, 1000, age_ms=3_600_500), "age counts from there"
    assert command_receiver.fault.startswith("cmd_vel: 0.5")


def test_delayed_commands_are_not_mistaken_for_a_clock_set_back(
    command_receiver: CommandReceiver, clock: Clock
) -> None:
    commands(command_receiver, clock, 1, 5, 2)
    clock.wait(20_000)
    for sequence in range(101, 501):  # the network was interrupted for 20 s, and all messages of that time arrive now
        clock.wait(1)
        age_ms = (500.0 - sequence) * 50
        assert not clock.deliver(command_receiver, sequence, age_ms=age_ms) or age_ms < 103
    for draining_s in (6.0, 60.0):  # a queue of 3 s that lasts
        clock.wait(3000)
        for step in range(round(20 * draining_s)):
            clock.wait(50)
            age_ms = 3000 * (1 - step / 20 / draining_s)
            sequence = round(500 + 2000 * draining_s + step)
            assert not clock.deliver(command_receiver, sequence, age_ms=age_ms) or age_ms < 103
    clock.wait(3000)
    assert not any(commands(command_receiver, clock, 200_000, 20, 3000, per_instant=2)), (
        "a full queue that loses every second command"
    )
