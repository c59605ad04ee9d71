"""Measure the delay of commands in one configuration, and the bare network's delay in the same seconds."""

import math
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.bench.floors.network import Floor, RoundTrips, wait_ns
from hil.bench.harness import READY_S, Bench, Process, await_vehicle, labels_of, program
from hil.bench.loopback import settled
from hil.bench.presence import check_end, check_present
from hil.bench.record import median
from hil.client.client import VehicleClient
from hil.client.delay import DelayMeter, find_doubts
from hil.common.children import foreign_command, start_child
from hil.common.clock import NS_PER_MS, NS_PER_S, RateKeeper, from_wall_ns, now_ns, to_wall_ns
from hil.common.quantiles import quantile
from hil.links.address import parse_address
from hil.links.wires.faults import line_bits
from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import Scenario
from hil.scenario.records import Link
from sim.vehicle.vehicle import load_vehicle

HOPS = ("publish", "network", "queue", "control", "link encode", "wire", "STM32")
COMMAND_BYTES = 52 + 33  # geometry_msgs/Twist in CDR, and what rmw_zenoh adds to it
IN_SLAVE = ("python", "unicorn")  # kinds of STM32 that run in the slave's process
WARM_UP = 20  # commands that are not counted: arming, first samples
SETTLE_S = 0.5  # time for the last traces to arrive
OFF = 0.05  # permitted relative error of a rate or a baud, and permitted share of lost bare messages, without a warning
BURN = "while True: sum(range(1_000_000))"
STEP_S = 0.40618  # between steps in surge; not a multiple of an IMU's 10 ms, so that steps have different phases
STEP_M_S = 0.4
MOVED_M_S2 = 0.05  # only thrusters change the acceleration by more: 0.13 and above in the first 2.5 ms


class Plan(NamedTuple):
    """Settings of the measurement of one configuration.

    `rate` Hz of commands, over `seconds`; `burners`: processes that take all the processor they get, on this machine;
    `steps` of the measurement of motion.
    """

    rate: float = 20.0
    seconds: float = 10.0
    burners: int = 0
    steps: int = 10


Echo = tuple[str, int, int]  # host, UDP port, TCP port of a `hil.bench.floors.network.serve`


class Result(NamedTuple):
    """Result of one run.

    `values` in ms: "delay" and "hop ..." have one value a command; "motion"; "udp floor" and "tcp floor", empty where
    there is no echo beside the slave. `wire` is the least time on the line, that of the bits (`wire_ms`). `rate` is the
    rate at which commands were sent, Hz. `warnings` are reasons to doubt the figures, `labels` are what a slave
    elsewhere reports of its machine.
    """

    values: dict[str, list[float]]
    wire: float
    sent: int
    rate: float
    clock_offset: float
    clock_uncertainty: float
    warnings: list[str]
    labels: tuple[str, ...] = ()

    @property
    def floor(self) -> float:
        """The median of bare TCP one way, and the frame's time on its line; nan without an echo that answers."""
        return quantile(sorted(self.values["tcp floor"]), 0.5) + self.wire

    def at(self, share: float) -> float:
        """Return the quantile of the delay."""
        return quantile(sorted(self.values["delay"]), share)

    def middle(self, name: str) -> float:
        """Return the median of some of its values; nan without values."""
        return median(self.values[name])


class Observer(VehicleClient):
    """A master that records accelerations with their times of receipt (monotonic ns)."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.surge: list[tuple[int, float]] = []
        super().__init__(*arguments, **options)
        self.delays.store()

    def _deliver(self, topic: str, payload: bytes, attachment: bytes) -> None:
        super()._deliver(topic, payload, attachment)
        if topic == "imu" and "imu" in self.latest:
            newest = self.latest["imu"]
            self.surge.append((newest.received_ns, newest.value.acceleration[0]))


def pooled(runs: Sequence[Result]) -> Result:
    """Return the runs of one configuration, joined to one result."""
    first, *others = runs
    if not others:
        return first
    return first._replace(
        values={name: [x for run in runs for x in run.values[name]] for name in first.values},
        wire=min(run.wire for run in runs),
        sent=sum(run.sent for run in runs),
        rate=median([run.rate for run in runs]),
        clock_uncertainty=max(run.clock_uncertainty for run in runs),
        warnings=[f"run {number}: {words}" for number, run in enumerate(runs, 1) for words in run.warnings],
    )


def measure(bench: Bench, plan: Plan, endpoint: str = "", echo: Echo | None = None) -> Result:
    """Measure one configuration. `endpoint` is that of a slave elsewhere, `echo` the echo server beside it.

    Without `echo` a slave elsewhere has no floor. Raises HilError.
    """
    slave = None if endpoint else bench.start_slave()
    with ExitStack() as stack:
        echo = echo or (None if endpoint else stack.enter_context(_own_echo(bench)))
        floor = stack.enter_context(Floor(*echo, COMMAND_BYTES)) if echo else None
        stack.enter_context(_burners(plan.burners))
        client = stack.enter_context(_observer(bench, endpoint))
        await_vehicle(client, slave)
        client.delays.same_clock = client.contact.same_clock
        spans = _command(client, slave, plan, floor)
        counted = wire_ms(bench.scenario, client.diagnostics(), bool(endpoint))
        motion = _motion(client, slave, plan.steps)
        wait_ns(now_ns() + round(SETTLE_S * NS_PER_S))
        check_end(client, slave)
        result = _result(client.delays, spans, motion, floor, counted)
        paced = not endpoint and _pace(bench.scenario.link) > 0
        result.warnings.extend(_doubts(result, plan, floor, client.contact.losses, paced))
        return result._replace(wire=counted, labels=labels_of(client.diagnostics()) if endpoint else ())


def wire_ms(scenario: Scenario, slave: Diagnostics, elsewhere: bool = False) -> float:
    """Return the line's share of a measured delay, ms; 0 for a line without a speed (a pty, a socket).

    slave: its diagnostics. For a slave `elsewhere` they are the only source of protocol, baud, number of thrusters, and
    of whether a UART leads to a real STM32. They do not contain the speed of a CAN bus, so that is not counted.

    It is the time of the command's frames and of the answer's, because the answer ends the delay. For an STM32 in the
    slave's process the answer does not count: the slave knows when its outputs change.
    """
    link = scenario.link
    on_uart = slave.link_wire in ("uart", "rs485")
    channels = len(slave.pwm_us or ()) or len(load_vehicle(scenario.vehicle)[0].channels)
    if elsewhere:
        if not on_uart:
            return 0.0
        link = _link_of(link, slave)
    baud = _pace(link) or (link.baud if on_uart else 0)
    if not baud:
        return 0.0
    command, answer = settled(link, channels, armed=True)
    bytes_sent = command if scenario.stm32 in IN_SLAVE and not elsewhere else command + answer
    return line_bits(bytes_sent, on_can=parse_address(link.port).carries_can) / baud * 1e3


def _pace(link: Link) -> int:
    """Return the baud at which a timer of this project paces the link, 0 without one."""
    return link.faults.baud if link.faults else 0


def _link_of(own_link: Link, slave: Diagnostics) -> Link:
    """Return the UART of a slave elsewhere. Its frame layout is taken to be ours if the protocol is the same."""
    protocol: Any = slave.link_protocol or own_link.protocol
    baud, port = slave.link_baud or own_link.baud, slave.link_port or own_link.port
    link = own_link._replace(protocol=protocol, baud=baud, port=port, faults=None)
    return link if protocol == own_link.protocol else link._replace(options={})


def _command(client: Observer, slave: Process | None, plan: Plan, floor: Floor | None) -> list[tuple[int, int]]:
    """Send commands for the plan's time; return when each put began and ended (wall clock).

    The floor is measured half a period after each command, at high rates after every n-th.
    """
    period = round(NS_PER_S / plan.rate)
    every = max(1, round(plan.rate / 50.0))
    spans: list[tuple[int, int]] = []
    schedule = RateKeeper(period, now_ns())
    for number in range(WARM_UP + round(plan.seconds * plan.rate)):
        wait_ns(schedule.deadline_ns)
        check_present(client, slave)
        began = now_ns()
        client.command(VelocityCommand(0.1, 0.0, 0.0, yaw_rate=0.02 if number % 2 else -0.02))
        spans.append((to_wall_ns(began), to_wall_ns(now_ns())))
        if floor and number >= WARM_UP and number % every == 0:
            wait_ns(began + period // 2)
            floor.measure(began + period)
        schedule.due(now_ns())
    wait_ns(began + period)  # otherwise the next command replaces the last one in the slave's command_receiver
    return spans[WARM_UP:]


def _motion(client: Observer, slave: Process | None, steps: int) -> list[float]:
    """Return the times (ms) from each step in surge until the first acceleration that shows it arrives."""
    delays, began = [], now_ns()
    for number in range(steps):
        check_present(client, slave)
        sign = 1.0 if number % 2 else -1.0
        sent = now_ns()
        client.command(VelocityCommand(sign * STEP_M_S, 0.0, 0.0))
        wait_ns(began + round((number + 1) * STEP_S * NS_PER_S))  # not from `sent`, whose lateness would add up
        first = first_motion(list(client.surge), _applied_ns(client.delays, sent), sign)
        if first and number:  # the first step is from rest
            delays.append((first - sent) / NS_PER_MS)
    return delays


def _applied_ns(meter: DelayMeter, sent: int) -> int:
    """Return when the STM32 applied the newest command (monotonic ns); without a trace its time of publish, `sent`."""
    if not meter.stored or (published := from_wall_ns(meter.samples(1)[-1].published_ns)) < sent:
        return sent
    return published + max(meter.totals_ns(newest=1)[0], 0)


def first_motion(samples: Sequence[tuple[int, float]], applied: int, sign: float) -> int:
    """Return the time (ns) of the first sample that shows the motion after `applied`, 0 if none does.

    A sample shows it if it leaves, towards `sign`, the line through the last two samples before `applied`.

    samples: time of arrival (ns) and acceleration (m/s²) of each, without noise.
    """
    before = [value for came, value in samples if came <= applied][-2:]
    if len(before) < 2:
        return 0
    slope = before[1] - before[0]
    after = [(came, value) for came, value in samples if came > applied]
    for number, (came, value) in enumerate(after, 1):
        if sign * (value - before[1] - number * slope) > MOVED_M_S2:
            return came
    return 0


def _result(
    meter: DelayMeter, spans: Sequence[tuple[int, int]], motion: list[float], floor: Floor | None, wire: float
) -> Result:
    """Return the commands of `spans` only: neither the warm-up's nor the motion's. `wire`: ms counted on the line."""
    first, last = (spans[0][0], spans[-1][1]) if spans else (0, 0)
    ended = dict(_published(meter, spans))
    values: dict[str, list[float]] = {"delay": [], "motion": motion, **{f"hop {name}": [] for name in HOPS}}
    for name, round_trip in (("udp floor", floor and floor.udp), ("tcp floor", floor and floor.tcp)):
        values[name] = [taken / NS_PER_MS for taken in round_trip.taken_ns] if round_trip else []
    for sample, total in zip(meter.samples(), meter.totals_ns(), strict=True):
        if not first <= sample.published_ns <= last:
            continue
        network = sample.hops[0] - meter.clock_at(sample.published_ns).offset_ns
        publish = min(ended.get(sample.published_ns, sample.published_ns) - sample.published_ns, max(network, 0))
        command_receiver, control, link, stm32 = (hop / NS_PER_MS for hop in sample.hops[1:])
        early = min(max(wire - stm32, 0.0), link)  # bits that were sent before the write had ended
        link, stm32 = link - early, stm32 + early
        on_wire = min(wire, max(stm32, 0.0))
        parts = (
            publish / NS_PER_MS,
            (network - publish) / NS_PER_MS,
            command_receiver,
            control,
            link,
            on_wire,
            stm32 - on_wire,
        )
        for name, value in zip(HOPS, parts, strict=True):
            values[f"hop {name}"].append(value)
        values["delay"].append(total / NS_PER_MS)
    offset, uncertainty = (value / NS_PER_MS for value in meter.offset_ns())
    rate = (len(spans) - 1) * NS_PER_S / (spans[-1][0] - first) if len(spans) > 1 else math.nan
    return Result(values, wire, len(spans), rate, offset, uncertainty, find_doubts(meter))


def _doubts(result: Result, plan: Plan, floor: Floor | None, losses: int, paced: bool) -> Iterator[str]:
    """Return further reasons to doubt the result.

    The result's `wire` is the time of the line that was counted; `paced`: a timer of this project makes it.
    """
    values = result.values
    missing = result.sent - len(values["delay"])
    if missing and values["delay"]:
        yield f"{missing} of {result.sent} commands were not answered by the STM32: lost, or overtaken by the next"
    if losses:
        yield f"the vehicle was lost {losses} times meanwhile"
    if abs(result.rate / plan.rate - 1.0) > OFF:
        yield f"commands were sent at {result.rate:.1f} Hz instead of {plan.rate:g}: this machine has no time for more"
    beyond = [wire + rest for wire, rest in zip(values["hop wire"], values["hop STM32"], strict=True)]
    if not paced and result.wire and beyond and median(beyond) < (1.0 - OFF) * result.wire:
        yield f"the line took less than the {result.wire:.3f} ms of its bits: its baud is not what the slave says"
    steps = max(plan.steps - 1, 0)
    if len(values["motion"]) < steps:
        yield (
            f"{steps - len(values['motion'])} of {steps} steps in surge did not show in the acceleration within "
            f"{STEP_S:.1f} s: this vehicle answers too slowly, or has no accelerometer"
        )
    for name, round_trip in (("UDP", floor.udp), ("TCP", floor.tcp)) if floor else ():
        yield from _losses(name, round_trip)


def _losses(name: str, round_trip: RoundTrips) -> Iterator[str]:
    sent = round_trip.lost + len(round_trip.taken_ns)
    if not round_trip.taken_ns:
        yield f"the echo answered nothing by {name}; is the port right, and open in a firewall between?"
    elif round_trip.lost > max(OFF * sent, 1.0):
        yield f"{round_trip.lost} of {sent} bare messages by {name} were not answered in time; the others are the floor"


def _published(meter: DelayMeter, spans: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Yield (time of publication, end of its put) of each command that has a trace; both are in order."""
    remaining = iter(spans)
    span = next(remaining, None)
    for sample in meter.samples():
        while span and span[1] < sample.published_ns:
            span = next(remaining, None)
        if span and span[0] <= sample.published_ns:
            yield sample.published_ns, span[1]


@contextmanager
def _observer(bench: Bench, endpoint: str) -> Iterator[Observer]:
    scenario = bench.scenario
    where, node = endpoint or bench.endpoint, scenario.slave.node
    with Observer(where, node, network=scenario.network, security=scenario.security) as client:
        yield client


@contextmanager
def _own_echo(bench: Bench) -> Iterator[Echo]:
    """Provide an echo in a process of this machine."""
    with bench.start("echo", [*program(), "bench", "echo"]) as process:
        host, udp, tcp = process.expect(":", READY_S).split(":")
        yield host, int(udp), int(tcp)


@contextmanager
def _burners(number: int) -> Iterator[None]:
    """Start processes that only use processor time; Ctrl-C at the terminal does not reach them."""
    command = foreign_command(sys.executable, "-I", "-c", BURN)
    processes = [start_child(command) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
