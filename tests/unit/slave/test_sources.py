"""The sources of thruster commands at their limits: when they send, which steps they permit, and what stops them."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.ros.diagnostics import Diagnostics
from hil.slave.autopilot_port import CHECK_NS, MAX_OWED, AutopilotPort
from hil.slave.command_receiver import Received
from hil.slave.command_source import DRIVEN_NS, UNANSWERED_NS, CommandSource
from hil.slave.pilot_source import PilotSource
from hil.slave.ros.node import _Due

NEUTRAL, AHEAD = (1500,) * 2, (1700, 1300)
PERIOD_NS, STEP_NS = 20 * NS_PER_MS, 2_500_000


class Driver:
    """A thruster link that stores what is sent."""

    port, arming_refusal, command_ns = "pty", "", 0
    newest: ThrusterTelemetry | None = None

    def __init__(self) -> None:
        self.pwm_us, self.sent = NEUTRAL, list[ThrusterCommand]()

    def send(self, command: ThrusterCommand) -> None:
        self.sent.append(command)

    def applied_ns(self, telemetry: ThrusterTelemetry, now: int) -> int:
        return now - telemetry.age_us * 1000


def report(sequence: int, pwm_us: tuple[int, ...] = NEUTRAL) -> ThrusterTelemetry:
    return ThrusterTelemetry(sequence, True, False, pwm_us, 0, sequence, 0, 0)


# --- an autopilot


class Autopilot:
    """An autopilot whose answers are set by the test; `motors` are its own, too."""

    name, lockstep, connected, answers = "ArduPilot", True, True, True
    estimate = outputs_now = pulses_at = None
    silences, closed, checked = 0, False, 0
    outputs: tuple[int, ...] = ()

    def may_step(self) -> bool:
        return self.answers

    def receive(self, _now: int) -> Any:
        return self.outputs_now

    def update(self, outputs: Any) -> Any:
        return outputs.pulses

    def check(self, _now: int) -> None:
        self.checked += 1

    def at(self, _now: int) -> Any:
        self.silences += self.pulses_at is not None
        return self.pulses_at or SimpleNamespace(armed=True, pwm_us=AHEAD)

    def close(self) -> None:
        self.closed = True


class Program:
    """A program that has ended with these words."""

    closed, words = False, "ArduPilot has ended"

    def ended(self) -> str:
        return self.words

    def close(self) -> None:
        self.closed = True


class Flown:
    """A port with its autopilot, program and link."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, fails: bool = False) -> None:
        self.autopilot, self.program, self.driver = Autopilot(), Program(), Driver()
        self.lines: list[str] = []

        def start(*_: Any) -> Program:
            if fails:
                raise OSError("no such program")
            return self.program

        opening = "hil.autopilots.opening"
        monkeypatch.setattr(f"{opening}.open_autopilot", lambda *_: (self.autopilot, self.autopilot))
        monkeypatch.setattr(f"{opening}.start_program", start)
        unused, link = cast(Any, None), cast(Any, self.driver)
        self.port = AutopilotPort(unused, unused, unused, link, self.lines.append)


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> Flown:
    return Flown(monkeypatch)


def test_steps_wait_for_the_answer_of_an_autopilot_in_lockstep(flown: Flown) -> None:
    port, autopilot = flown.port, flown.autopilot
    assert [port.permitted_steps(due) for due in (1, 3, 0, 0, 0)] == [1, 1, 1, 1, 0], "one at a time, none is lost"
    autopilot.answers = False
    assert [port.permitted_steps(1) for _ in range(MAX_OWED)] == [0] * MAX_OWED
    assert port.held_steps == 0
    assert port.permitted_steps(2) == 0
    assert port.held_steps == 2
    autopilot.answers = True
    assert sum(port.permitted_steps(0) for _ in range(99)) == MAX_OWED
    autopilot.answers = False
    port.permitted_steps(7)
    autopilot.answers, autopilot.connected = True, False
    assert port.permitted_steps(5) == 5, "nothing waits for an autopilot that is not there"
    autopilot.connected = True
    assert port.permitted_steps(0) == 0, "nor is anything made up for"
    autopilot.lockstep = False
    assert port.permitted_steps(3) == 3


@pytest.mark.parametrize(("ours", "its", "armed"), [(True, True, True), (False, True, False), (True, False, False)])
def test_outputs_are_sent_at_once_and_neutral_while_disarmed(flown: Flown, ours: bool, its: bool, armed: bool) -> None:
    port, autopilot, sent = flown.port, flown.autopilot, flown.driver.sent
    port.armed, port.due_ns = ours, NS_PER_S
    assert not port.serve(5)
    autopilot.outputs_now = cast(
        Any, SimpleNamespace(pulses=SimpleNamespace(armed=its, pwm_us=AHEAD), received_ns=3 * NS_PER_MS)
    )
    assert port.serve(5)
    assert [(command.armed, command.pwm_us) for command in sent] == [(armed, AHEAD if armed else NEUTRAL)]
    port.handle_telemetry([report(sent[0].sequence)], 9 * NS_PER_MS)
    assert port.delay.maximum == 6 * NS_PER_MS, "from the arrival of the outputs to their pulses"


def test_a_silent_autopilot_stops_the_thrusters_once(flown: Flown) -> None:
    port, autopilot, sent = flown.port, flown.autopilot, flown.driver.sent
    assert not port.serve(0)
    assert (port.due_ns, autopilot.checked, flown.lines) == (CHECK_NS, 1, ["ArduPilot has ended"])
    autopilot.pulses_at = cast(Any, SimpleNamespace(armed=False, pwm_us=NEUTRAL))
    autopilot.outputs_now = cast(Any, SimpleNamespace(pulses=SimpleNamespace(armed=True, pwm_us=AHEAD), received_ns=1))
    assert port.serve(CHECK_NS - 1)
    assert sent[-1].pwm_us == AHEAD
    assert port.serve(CHECK_NS)
    assert sent[-1].pwm_us == NEUTRAL, "the stop has priority"
    assert (port.due_ns, flown.lines) == (2 * CHECK_NS, ["ArduPilot has ended"])


def test_what_an_autopilot_waits_for_and_what_it_has_opened(flown: Flown, monkeypatch: pytest.MonkeyPatch) -> None:
    assert flown.port.problem() == "ArduPilot is silent, thrusters neutral"
    flown.autopilot.outputs = AHEAD
    assert flown.port.problem() == ""
    flown.autopilot.connected = False
    assert flown.port.problem().startswith("waiting for ArduPilot")
    flown.port.close()
    assert (flown.autopilot.closed, flown.program.closed) == (True, True)
    closed: list[bool] = []
    monkeypatch.setattr(Autopilot, "close", lambda _: closed.append(True))
    with pytest.raises(OSError, match="no such program"):
        Flown(monkeypatch, fails=True)
    assert closed == [True]


def test_samples_and_steps_reach_the_autopilot_whose_figures_are_reported(flown: Flown) -> None:
    port, autopilot, figures, made = flown.port, cast(Any, flown.autopilot), Diagnostics(), list[Any]()
    names = "outputs", "duplicates", "malformed", "lost", "resets", "stalls"
    autopilot.figures = SimpleNamespace(**{name: number for number, name in enumerate(names, 1)})
    autopilot.map, autopilot.outputs, autopilot.silences, port.held_steps = SimpleNamespace(frame="x"), AHEAD, 7, 8
    for name in ("update_sensor", "move_accessories", "advance"):
        setattr(autopilot, name, lambda *arguments: made.append(arguments))
    port.update_sensor("imu", 7)
    port.end_step(simulation := cast(Any, SimpleNamespace(time_ns=8, truth=lambda: 9)), True)
    assert made == [("imu", 7), (simulation,), (8, 9)]
    autopilot.estimate = SimpleNamespace(add_figures=made.append)
    for delay_ms in [6] * 98 + [90] * 2:
        port.delay.add(delay_ms * NS_PER_MS)
    port.add_figures(figures)
    assert made[3:] == [figures]
    counted = [figures[f"autopilot_{name}"] for name in ("packets", *names[1:], "silences", "steps_held")]
    shown = figures.autopilot, figures.autopilot_connected, figures.autopilot_outputs, figures.autopilot_frame
    assert (counted, figures.controller, shown) == ([*range(1, 9)], "autopilot", ("ArduPilot", True, AHEAD, "x"))
    assert (figures.autopilot_delay_p50_ms, figures.autopilot_delay_p99_ms) == pytest.approx((6.0, 90.0), rel=0.2)


# --- the pilot


class Pilot:
    """A pilot that records when it is updated."""

    active, trips, deadman_trips, requested_depth = False, False, 3, 4.0
    failed_thrusters: tuple[str, ...] = ()
    unwatched_thrusters: tuple[str, ...] = ()

    def __init__(self) -> None:
        self.steps: list[float] = []
        self.commands: list[Any] = []

    def update_sensor(self, topic: str, sample: Any) -> None:
        self.commands.append((topic, sample))

    def update(self, _now: int, dt: float) -> tuple[ThrusterCommand, bool]:
        self.steps.append(dt)
        return ThrusterCommand(len(self.steps), self.active, AHEAD if self.active else NEUTRAL), self.trips

    def set_command(self, command: Any, _now: int) -> None:
        self.commands.append(command)
        self.active = True


class Led:
    """A pilot's source, whose receiver gives what the test puts there."""

    def __init__(self) -> None:
        self.pilot, self.driver, self.waiting = Pilot(), Driver(), list[Received]()
        self.lines, self.traces = list[str](), list[Any]()
        receiver = SimpleNamespace(take_latest=lambda: self.waiting.pop() if self.waiting else None)
        self.source = PilotSource(
            cast(Any, self.pilot), cast(Any, self.driver), cast(Any, receiver), PERIOD_NS, STEP_NS,
            self.traces.append, self.lines.append,
        )  # fmt: skip

    def command(self) -> None:
        self.waiting.append(Received(VelocityCommand(surge=1.0), 1, 0, 0))


def test_the_controller_runs_when_it_is_due_and_at_once_for_a_command() -> None:
    led, begin = Led(), NS_PER_S
    wait_ns = PERIOD_NS - STEP_NS // 2
    assert [led.source.serve(begin + at) for at in (0, wait_ns - 1, wait_ns)] == [True, False, True]
    led.command()
    for at in (wait_ns + NS_PER_MS, wait_ns + NS_PER_MS, 9 * PERIOD_NS):
        led.source.due_ns = 0
        led.source.serve(begin + at)
    limit = 2 * PERIOD_NS / NS_PER_S  # a pause of the process is no long step of the integrators
    assert led.pilot.steps == pytest.approx([limit, wait_ns / NS_PER_S, 1e-3, 1e-6, limit])


def test_samples_reach_the_pilot() -> None:
    led = Led()
    led.source.update_sensor("imu", 5)
    assert led.pilot.commands == [("imu", 5)]


def test_a_command_is_dropped_while_disarmed_or_refused_by_the_link() -> None:
    led = Led()
    led.source.armed = False
    led.command()
    led.source.serve(1)
    assert (led.pilot.commands, led.source.commands, led.waiting) == ([], 0, [])
    led.source.armed, led.driver.arming_refusal, led.pilot.active = True, "too slow", True
    led.command()
    led.source.serve(2)
    assert (led.pilot.commands, led.source.commands, led.pilot.active) == ([], 1, False)
    led.driver.arming_refusal = ""
    for now in (3, 4):
        led.command()
        led.source.serve(now)
        assert (len(led.pilot.commands), led.lines) == (now - 2, ["commands arrive: thrusters armed"])
    assert led.source.problem() == ""
    led.source.set_neutral()
    assert led.source.problem().endswith("thrusters neutral")
    led.driver.pwm_us = AHEAD
    assert led.source.problem().endswith("not neutral yet")


def test_a_stop_is_confirmed_by_a_neutral_report_after_it() -> None:
    led = Led()
    led.pilot.trips = True
    led.source.serve(5 * NS_PER_S)
    assert len(led.lines) == 1
    led.driver.newest = report(1, AHEAD)
    for overtaken in (led.driver.newest, report(0)):
        led.source.handle_telemetry([overtaken], 5 * NS_PER_S)
    led.driver.newest = report(2)
    led.source.handle_telemetry([], 5 * NS_PER_S)
    assert len(led.lines) == 1, "nothing has come"
    for _ in range(2):
        led.source.handle_telemetry([led.driver.newest], 5 * NS_PER_S + 30 * NS_PER_MS)
    assert led.lines[1:] == ["thrusters neutral: confirmed by the STM32 30 ms after the deadman"]
    led.source.serve(6 * NS_PER_S)
    for led.pilot.active in (True, False):  # a new command, perhaps of zero speed
        led.source.handle_telemetry([led.driver.newest], 6 * NS_PER_S)
    assert len(led.lines) == 3, "the deadman, but nothing is confirmed"


def test_traces_leave_with_the_next_sample_or_after_50_ms_and_the_last_at_the_end() -> None:
    led = Led()

    def execute(number: int) -> list[int]:
        """Let the STM32 carry out a command; return the numbers of the traces that have left."""
        led.waiting.append(Received(VelocityCommand(surge=1.0), number, 7, now_ns()))
        led.source.serve(now_ns())
        led.source.handle_telemetry([report(led.driver.sent[-1].sequence)], now_ns())
        return [trace.sequence for trace in led.traces]

    def end_step(time_ms: int, has_sent: bool = False) -> list[int]:
        led.source.end_step(cast(Any, SimpleNamespace(time_ns=time_ms * NS_PER_MS)), has_sent)
        return [trace.sequence for trace in led.traces]

    assert (execute(1), execute(2), end_step(10), end_step(11, has_sent=True)) == ([], [], [], [1, 2])
    assert (execute(3), end_step(50), execute(4), end_step(60), end_step(61)) == (
        [1, 2], [1, 2], [1, 2], [1, 2], [1, 2, 3, 4]
    )  # fmt: skip
    execute(5)
    led.source.finish()
    led.source.finish()
    assert [trace.sequence for trace in led.traces] == [1, 2, 3, 4, 5]
    trace = led.traces[0]
    instants = [trace.received_ns, trace.taken_ns, trace.computed_ns, trace.written_ns, trace.applied_ns]
    assert (trace.published_ns, instants) == (7, sorted(instants))


def test_the_figures_name_thrusters_that_fail_and_those_without_telemetry() -> None:
    led, figures = Led(), Diagnostics()
    led.pilot.active, led.pilot.failed_thrusters, led.pilot.unwatched_thrusters = True, ("port", "bow"), ("stern",)
    led.source.add_figures(figures)
    assert (figures.thrusters_failed, figures.thrusters_unwatched) == ("port, bow", "stern")
    assert led.source.problem().startswith("failed: port, bow: ")


def test_commands_without_an_echo_count_after_a_second_and_their_numbers_wrap() -> None:
    driver = Driver()
    source, figures = CommandSource(cast(Any, driver)), Diagnostics()
    source._sequence = 0xFFFE
    assert [source.next_sequence() for _ in range(3)] == [0xFFFF, 0, 1]
    source._awaited = {1: (0, "old"), 2: (NS_PER_S, "young")}
    source.handle_telemetry([], UNANSWERED_NS)
    assert source.unanswered == 0
    source.handle_telemetry([], UNANSWERED_NS + 1)
    assert (source.unanswered, list(source._awaited)) == (1, [2])
    source.handle_telemetry([], 2 * UNANSWERED_NS + 1)
    assert source.unanswered == 1, "they are searched once a second"
    source.handle_telemetry([], 2 * UNANSWERED_NS + 2)
    assert source.unanswered == 2
    assert source.permitted_steps(3) == 3
    for ago_ns, driven in ((DRIVEN_NS // 2, True), (2 * DRIVEN_NS, False)):
        driver.command_ns = now_ns() - ago_ns
        source.add_figures(figures)
        assert (figures.thrusters_driven, figures.commands_unanswered, figures.deadman_trips) == (driven, 2, 0)


# --- what is reported


def test_what_is_due_is_published_once_a_period_and_missed_periods_are_left_out() -> None:
    due = _Due(10.0)
    assert [due.passes(at * NS_PER_MS) for at in (0, 99, 100, 350, 399, 400)] == [True, False, True, True, False, True]
    assert not _Due(0.0).passes(10**18)
