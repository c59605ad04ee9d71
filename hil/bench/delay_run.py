"""The way of commands through one configuration, beside the floor of the same machines in the same seconds."""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from hil.autonomy.control import VelocityCommand
from hil.bench.floor import Floor, wait_ns
from hil.bench.harness import READY_S, Bench, await_vehicle, program
from hil.bench.loopback import settled
from hil.bench.statistics import quantile
from hil.clock import NS_PER_MS, NS_PER_S, RateKeeper, now_ns, to_wall_ns
from hil.config import Scenario
from hil.links.address import parse_address
from hil.links.wires.faults import line_bits
from hil.master.client import VehicleClient
from hil.master.delay import DelayMeter
from sim.vehicle import load_vehicle

HOPS = ("publish", "network", "inbox", "control", "link encode", "wire", "STM32")
COMMAND_BYTES = 52 + 33  # geometry_msgs/Twist in CDR, and what rmw_zenoh adds to it
IN_SLAVE = ("python", "unicorn")  # kinds of STM32 that run in the slave's process
WARM_UP = 20  # commands that are not counted: arming, first samples
SETTLE_S = 0.5  # for the last traces to come
UNSURE = 0.75  # of a delay that its clocks are not known to
STEP_S = 0.4  # a step of the motion measurement
STEP_M_S = 0.4
MOVED_M_S2 = 0.02  # a change of acceleration that only the thrusters make


class Plan(NamedTuple):
    """How one configuration is measured.

    `rate` Hz of commands, over `seconds`; `burners`: processes that take all the processor they get, on this machine;
    `payload`: bytes that cross the network beside each command; `steps` of the measurement of motion.
    """

    rate: float = 20.0
    seconds: float = 10.0
    burners: int = 0
    payload: int = 0
    steps: int = 10


class Result(NamedTuple):
    """What came of it, in ms; `hops` and `delay` one a command, `at_s` when it was published.

    `wire` is the time on the line that is in each delay, see `wire_ms`. `warnings` say why the figures are not to be
    trusted.
    """

    delay: list[float]
    at_s: list[float]
    hops: dict[str, list[float]]
    motion: list[float]
    udp: list[float]
    tcp: list[float]
    wire: float
    sent: int
    clock_offset: float
    clock_uncertainty: float
    warnings: list[str]

    @property
    def floor(self) -> float:
        """The median of bare TCP one way, and the frame's time on its line."""
        return quantile(sorted(self.tcp), 0.5) + self.wire

    def at(self, share: float) -> float:
        """The quantile of the delay."""
        return quantile(sorted(self.delay), share)


class Observer(VehicleClient):
    """A master that keeps the accelerations it hears of, with when they came (monotonic ns)."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.surge: list[tuple[int, float]] = []
        super().__init__(*arguments, **options)

    def _deliver(self, topic: str, payload: bytes, attachment: bytes) -> None:
        super()._deliver(topic, payload, attachment)
        if topic == "imu" and "imu" in self.latest:
            newest = self.latest["imu"]
            self.surge.append((newest.received_ns, newest.value.acceleration[0]))


def measure(bench: Bench, plan: Plan, endpoint: str = "", echo: tuple[str, int, int] | None = None) -> Result:
    """Measure one configuration. `endpoint` is that of a slave elsewhere, `echo` of `hil.bench.floor` beside it.

    Raises HilError.
    """
    wire = 0.0
    if bench.scenario.stm32 == "qemu" and not endpoint:
        from hil.bench.bare_qemu import answer_ms

        wire = answer_ms(bench.scenario)
    slave = None if endpoint else bench.start_slave()
    with _floor(bench, echo) as floor, _burners(plan.burners), _observer(bench, endpoint) as client:
        await_vehicle(client, slave)
        client.delays.same_clock = client.contact.same_clock
        spans = _command(client, floor, plan)
        wire = wire_ms(bench.scenario, client.diagnostics()) or wire
        motion = _motion(client, plan.steps)
        wait_ns(now_ns() + round(SETTLE_S * NS_PER_S))
        return _result(client.delays, spans, motion, floor, wire)


def wire_ms(scenario: Scenario, slave: dict[str, str]) -> float:
    """The time on its line, ms, of what a measured delay holds; 0 where the line has no speed (a pty, a socket).

    That is the command's frame, or its frames on a CAN bus, and unless the STM32 is in the slave, where it can be seen
    when its outputs take the command, the answer's too: it is heard only then.
    """
    link = scenario.link
    baud = link.faults.baud if link.faults and link.faults.baud else 0
    if not baud and slave.get("link_port", "").startswith("/dev/tty"):
        baud = link.baud
    if not baud:
        return 0.0
    command, answer = settled(link, len(load_vehicle(scenario.vehicle)[0].channels), armed=True)
    said = command if scenario.stm32 in IN_SLAVE else command + answer
    return line_bits(said, on_can=parse_address(link.port).carries_can) / baud * 1e3


def judge(meter: DelayMeter) -> list[str]:
    """Why the delays of `meter` are not to be trusted; nothing if they may be.

    One clock that is not one, or an offset that is not known well enough, shows in delays below zero, in exchanges
    that contradict the offset, or in an uncertainty nearly as large as the delay.
    """
    if not meter.samples:
        return ["no command was answered by the STM32"]
    found = []
    totals, network = meter.totals_ns(), meter.hop_ns(0)
    negative = sum(total < 0 or hop < 0 for total, hop in zip(totals, network, strict=True))
    if negative:
        found.append(f"{negative} of {len(totals)} commands arrived before they were sent: a clock is wrong")
    offset, uncertainty = meter.offset_ns()
    if meter.same_clock:
        true = meter.clock.at(meter.samples[-1].published_ns)
        if true and abs(true.offset_ns) > true.uncertainty_ns:
            found.append(f"the slave's clock is {true.offset_ns / 1e6:.3f} ms off, though it should be the master's")
    elif uncertainty > UNSURE * abs(quantile(sorted(totals), 0.5)):
        found.append(f"the clocks' offset of {offset / 1e6:.3f} ms is known only to +-{uncertainty / 1e6:.3f} ms")
    if meter.clock.steps:
        found.append(f"a clock was set {meter.clock.steps} times meanwhile")
    return found


def _command(client: Observer, floor: Floor, plan: Plan) -> list[tuple[int, int]]:
    """Command for the plan's time, the floor measured half a period after each; when each put began and ended (wall).

    Where no half period is left, as at high rates, the floor is measured with every so many commands.
    """
    period = round(NS_PER_S / plan.rate)
    every = max(1, round(plan.rate / 50.0))
    spans: list[tuple[int, int]] = []
    schedule = RateKeeper(period, now_ns())
    for number in range(WARM_UP + round(plan.seconds * plan.rate)):
        wait_ns(schedule.deadline_ns)
        if plan.payload:
            floor.load(plan.payload)
        began = now_ns()
        client.command(VelocityCommand(0.1, 0.0, 0.0, yaw_rate=0.02 if number % 2 else -0.02))
        spans.append((to_wall_ns(began), to_wall_ns(now_ns())))
        if number >= WARM_UP and number % every == 0:
            wait_ns(began + period // 2)
            floor.measure()
        schedule.due(now_ns())
    return spans[WARM_UP:]


def _motion(client: Observer, steps: int) -> list[float]:
    """From the publish of a step in surge until the first acceleration that shows it is here, ms."""
    found = []
    for number in range(steps):
        sign = 1.0 if number % 2 else -1.0
        sent = now_ns()
        client.command(VelocityCommand(sign * STEP_M_S, 0.0, 0.0))
        wait_ns(sent + round(STEP_S * NS_PER_S))
        first = first_motion(list(client.surge), sent, sign)
        if first and number:  # the first step is from rest
            found.append((first - sent) / NS_PER_MS)
    return found


def first_motion(samples: Sequence[tuple[int, float]], sent: int, sign: float) -> int:
    """When the first sample came that leaves, towards `sign`, the line through the last two before `sent`; 0: none.

    samples: when each came (ns) and its acceleration (m/s²), without noise.
    """
    before = [value for came, value in samples if came <= sent][-2:]
    if len(before) < 2:
        return 0
    slope = before[1] - before[0]
    after = [(came, value) for came, value in samples if came > sent]
    for number, (came, value) in enumerate(after, 1):
        if sign * (value - before[1] - number * slope) > MOVED_M_S2:
            return came
    return 0


def _result(
    meter: DelayMeter, spans: Sequence[tuple[int, int]], motion: list[float], floor: Floor, wire: float
) -> Result:
    """The commands of `spans` only: neither the warm-up's nor the motion's."""
    first, last = (spans[0][0], spans[-1][1]) if spans else (0, 0)
    ended = dict(_published(meter, spans))
    hops: dict[str, list[float]] = {name: [] for name in HOPS}
    delay, at_s = [], []
    for sample, total in zip(meter.samples, meter.totals_ns(), strict=True):
        if not first <= sample.published_ns <= last:
            continue
        network = sample.hops[0] - meter.clock_at(sample.published_ns).offset_ns
        publish = min(ended.get(sample.published_ns, sample.published_ns) - sample.published_ns, max(network, 0))
        inbox, control, link, stm32 = (hop / NS_PER_MS for hop in sample.hops[1:])
        on_wire = min(wire, max(stm32, 0.0))
        parts = (publish / NS_PER_MS, (network - publish) / NS_PER_MS, inbox, control, link, on_wire, stm32 - on_wire)
        for name, value in zip(HOPS, parts, strict=True):
            hops[name].append(value)
        delay.append(total / NS_PER_MS)
        at_s.append((sample.published_ns - first) / NS_PER_S)
    offset, uncertainty = (value / NS_PER_MS for value in meter.offset_ns())
    udp, tcp = ([value / NS_PER_MS for value in values] for values in (floor.udp_ns, floor.tcp_ns))
    warnings = judge(meter)
    return Result(delay, at_s, hops, motion, udp, tcp, wire, len(spans), offset, uncertainty, warnings)


def _published(meter: DelayMeter, spans: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """When the put of each command that has a trace ended: both are in order."""
    rest = iter(spans)
    span = next(rest, None)
    for sample in meter.samples:
        while span and span[1] < sample.published_ns:
            span = next(rest, None)
        if span and span[0] <= sample.published_ns:
            yield sample.published_ns, span[1]


@contextmanager
def _observer(bench: Bench, endpoint: str) -> Iterator[Observer]:
    scenario = bench.scenario
    where, node = endpoint or bench.endpoint, scenario.slave.node
    with Observer(where, node, network=scenario.network, security=scenario.security) as client:
        yield client


@contextmanager
def _floor(bench: Bench, echo: tuple[str, int, int] | None) -> Iterator[Floor]:
    """To the echo elsewhere, or to one in a process of this machine."""
    if echo:
        with Floor(*echo, COMMAND_BYTES) as floor:
            yield floor
        return
    with bench.start("echo", [*program(), "bench", "echo"]) as process:
        host, udp, tcp = process.expect(":", READY_S).split(":")
        with Floor(host, int(udp), int(tcp), COMMAND_BYTES) as floor:
            yield floor


@contextmanager
def _burners(number: int) -> Iterator[None]:
    """Processes that do nothing but take processor time."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
