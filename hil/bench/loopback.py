"""Test a thruster link: send commands, receive echoes, measure losses and delay.

A round trip is from writing a command until its echo has been decoded. The wire time is what the bits of the
command and of its answer take at the line's speed: no link can be faster.
"""

import select
from collections.abc import Callable
from typing import NamedTuple

from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S, RateKeeper, now_ns
from hil.common.quantiles import quantile
from hil.links.address import open_address, parse_address
from hil.links.contract import Counters, ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.scenario.records import Link
from hil.slave.drivers.driver import ThrusterDriver, open_driver
from hil.slave.drivers.ends import end_protocol, with_faults

BITS_A_BYTE = 10  # start bit, eight of data, stop bit
LOST_NS = NS_PER_S  # after which an echo counts as lost
CALM_PULSES, WIDEST = 1500, 200  # us: pulses differ from command to command, so that echoes tell them apart


class Plan(NamedTuple):
    """Settings of a loopback test: device, link, rate and duration.

    stm32: one of hil.slave.drivers.driver's, or "jumper" for a wire from TX to RX. rate: commands a second,
    0 for the next one as soon as the last is answered. spin: whether commands are armed; a disarmed one moves nothing.
    """

    stm32: str
    link: Link
    channels: int
    rate: float
    seconds: float
    spin: bool
    seed: int = 1


class Result(NamedTuple):
    """Result of a loopback test. Times are in ms; `wire_ms` is nan where the line has no speed."""

    port: str
    sent: int
    answered: int
    lost: int
    seconds: float
    p50_ms: float
    p99_ms: float
    max_ms: float
    wire_ms: float
    counters: dict[str, int]

    @property
    def loss(self) -> float:
        """The share of commands without an answer."""
        return self.lost / self.sent if self.sent else 1.0

    @property
    def errors(self) -> int:
        """Number of damaged received frames."""
        return self.counters["checksum_errors"] + self.counters["malformed"]

    @property
    def bytes_per_second(self) -> tuple[float, float]:
        """Bytes per second sent and received."""
        return self.counters["bytes_out"] / self.seconds, self.counters["bytes_in"] / self.seconds


class Jumper:
    """TX wired to RX, in place of a driver: everything sent is received. Commands are recognised by their pulses."""

    deadline_ns = NEVER_NS

    def __init__(self, plan: Plan) -> None:
        link = plan.link
        wire = with_faults(open_address(link.port, "host", link.baud, link.bitrate), link, plan.seed)
        self.port, self.descriptors = wire.name, [wire.fileno()]
        self._link = ThrusterLink(wire, end_protocol(link, "host", plan.channels))
        self._receiver = end_protocol(link, "device", plan.channels)  # it receives and does not answer
        self._sent: dict[tuple[int, ...], ThrusterCommand] = {}

    @property
    def counters(self) -> Counters:
        """What was sent and received."""
        self._receiver.counters.bytes_out = self._link.counters.bytes_out
        return self._receiver.counters

    def send(self, command: ThrusterCommand) -> None:
        """Send a command."""
        self._sent[command.pwm_us] = command
        self._link.send(command)

    def service(self, _now: int) -> list[ThrusterCommand]:
        """Return the commands that have come back."""
        data = self._link.wire.read()
        self._receiver.counters.bytes_in += len(data)
        commands = [m.pwm_us for m in self._receiver.feed(data) if isinstance(m, ThrusterCommand)]
        self._receiver.counters.messages_in += len(commands)
        return [self._sent[pulses] for pulses in commands if pulses in self._sent]

    def close(self) -> None:
        """Close the wire."""
        self._link.close()


def run(plan: Plan, report: Callable[[str], None], progress: Callable[[int, int], None] | None = None) -> Result:
    """Test the link. `progress` is called with the commands sent and answered once a second.

    KeyboardInterrupt ends it early, with the result so far. Raises ConfigError, DeviceError, MissingExtraError.
    """
    far: ThrusterDriver | Jumper
    if plan.stm32 == "jumper":
        far = Jumper(plan)
    else:
        far = open_driver(plan.stm32, plan.link, plan.channels, True, plan.seed, report)
    test = _Test(plan, far)
    try:
        test.run(progress)
    except KeyboardInterrupt:
        report("interrupted")
    finally:
        far.close()
    return test.result()


class _Test:
    """One run: the commands on their way, and the echoes."""

    def __init__(self, plan: Plan, far: ThrusterDriver | Jumper) -> None:
        self._plan = plan
        self._far = far
        self._waiting: dict[int, int] = {}  # sequence -> when it was sent
        self._trips_ns: list[int] = []
        self._sent = 0
        self._began = now_ns()

    def run(self, progress: Callable[[int, int], None] | None) -> None:
        """Send and receive for the plan's time, then receive until all commands are answered or lost."""
        period = round(NS_PER_S / self._plan.rate) if self._plan.rate else 1
        self._began = now_ns()
        schedule, end = RateKeeper(period, self._began), self._began + round(self._plan.seconds * NS_PER_S)
        shown_ns = self._began
        while (now := now_ns()) < end or (self._waiting and now < end + LOST_NS):
            if now < end and (schedule.due(now) if self._plan.rate else not self._waiting):
                self._send()
                self._receive()  # an STM32 in this process answers at once, without a descriptor to wait on
            wake = min(schedule.deadline_ns if now < end else end + LOST_NS, self._far.deadline_ns)
            if not self._plan.rate and self._waiting:
                wake = min(now + LOST_NS, self._far.deadline_ns)
            select.select(self._far.descriptors, (), (), max(0, wake - now_ns()) / NS_PER_S)
            self._receive()
            if progress and now - shown_ns > NS_PER_S:
                shown_ns = now
                progress(self._sent, len(self._trips_ns))

    def _send(self) -> None:
        self._sent += 1
        sequence = self._sent & 0xFFFF
        first = CALM_PULSES - WIDEST + self._sent % (2 * WIDEST)
        pulses = (first, *[CALM_PULSES] * (self._plan.channels - 1))
        self._waiting[sequence] = now_ns()
        replaced = self._end.counters.replaced
        self._far.send(ThrusterCommand(sequence, self._plan.spin, pulses))
        if self._end.counters.replaced > replaced:
            self._waiting.pop((self._sent - 1) & 0xFFFF, None)  # it was never sent, so nothing answers it

    def _receive(self) -> None:
        answered = [message.sequence for message in self._far.service(now_ns())]
        now = now_ns()
        for sequence in answered:
            if sequence in self._waiting:
                self._trips_ns.append(now - self._waiting.pop(sequence))
        for sequence in [s for s, sent in self._waiting.items() if now - sent > LOST_NS]:
            del self._waiting[sequence]

    @property
    def _end(self) -> Jumper | ThrusterLink:
        """The end of the link that sends."""
        end = self._far if isinstance(self._far, Jumper) else self._far.host
        assert end is not None
        return end

    def result(self) -> Result:
        """Return the figures of the commands sent so far."""
        trips, counters = sorted(self._trips_ns), self._end.counters
        seconds = max(now_ns() - self._began, 1) / NS_PER_S
        p50, p99, longest = (quantile(trips, share) / NS_PER_MS for share in (0.5, 0.99, 1.0))
        sent = self._sent - counters.replaced  # what a slow line did not take was never sent
        return Result(
            self._far.port, sent, len(trips), max(0, sent - len(trips)), seconds,
            p50, p99, longest, wire_ms(self._plan),
            {name: getattr(counters, name) for name in counters.__slots__},
        )  # fmt: skip


def wire_ms(plan: Plan) -> float:
    """Return the time that the bits of a command and of its answer take on the line, ms; nan where it has no speed."""
    link = plan.link
    address = parse_address(link.port)
    baud = (
        link.faults.baud if link.faults and link.faults.baud else link.baud if address.kind in ("uart", "rs485") else 0
    )
    if not baud or address.carries_can:
        return float("nan")
    command, answer = settled(link, plan.channels, plan.spin)
    bytes_sent = command if plan.stm32 == "jumper" else command + answer
    return len(bytes_sent) * BITS_A_BYTE / baud * 1e3


def settled(link: Link, channels: int, armed: bool) -> tuple[bytes, bytes]:
    """Return a command and its answer as they go over `link` after its two ends have connected.

    Before that they may be longer: MAVLink's host requests arming with each command until that is confirmed.
    """
    host, device = (end_protocol(link, role, channels) for role in ("host", "device"))
    pulses = (CALM_PULSES,) * channels
    for number in range(3):
        command = host.encode(ThrusterCommand(number, armed, pulses))
        device.feed(command)
        confirmed = device.replies() + device.tick(number * NS_PER_S)
        answer = device.encode(ThrusterTelemetry(number, armed, False, pulses, 0, 0, 0, 0))
        host.feed(confirmed + answer)
    return command, answer
