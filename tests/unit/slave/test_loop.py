"""The slave's loop: what it calls in each step, whom it tells of changes, and how a lost link ends with it."""

import os
import threading
from typing import Any, cast

import pytest

from hil.common.clock import NS_PER_MS, NS_PER_S, now_ns
from hil.common.errors import DeviceError
from hil.ros.diagnostics import Diagnostics
from hil.slave.drivers import driver as stm32
from hil.slave.drivers.ends import Ends
from hil.slave.drivers.external import ExternalDriver
from sim.run_events import PERIOD_NS
from sim.vehicle.failures import Failure
from tests.support.links.bench_link import BenchLink
from tests.support.processes import wait_for
from tests.unit.slave.test_vehicle_services import STEP_NS, Vehicle, vehicle

__all__ = ["vehicle"]  # the fixture

UPSIDE_DOWN = (0.0, 1.0, 0.0, 0.0)


class Calls:
    """An observer of the loop, a ROS node and a command source, that record how they are called."""

    due_ns = 0

    def __init__(self) -> None:
        self.made: list[tuple[Any, ...]] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments: self.made.append((name, *arguments))

    def of(self, name: str) -> list[list[Any]]:
        return [arguments for called, *arguments in self.made if called == name]


def test_each_step_is_observed_before_it_and_its_samples_reach_source_and_publisher(
    vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop, observer, source, publisher = vehicle.loop, Calls(), Calls(), Calls()
    monkeypatch.setattr(loop, "source", source)
    monkeypatch.setattr(loop.sample_publisher, "publish_sample", lambda topic, _: topic == "imu")
    monkeypatch.setattr(loop.sample_publisher, "wake_publisher", publisher.wake)
    loop.observers.append(observer)
    loop.pwm_us = pulses = (1510,) * len(loop.pwm_us)
    loop.advance(5)
    assert observer.of("record_step") == [[step * STEP_NS, pulses] for step in range(5)]
    sent, has_imu = list[bool](), False
    for name, *arguments in source.made:
        if name == "update_sensor":
            has_imu |= arguments[0] == "imu"
        else:
            sent.append(has_imu)
            has_imu = False
    assert source.of("end_step") == [[loop.simulation, has_sent] for has_sent in sent]
    assert set(sent) == {True, False}
    assert publisher.made == [("wake",)]
    loop.paused = True
    loop.advance_to(loop.schedule.deadline_ns)
    assert (loop.simulation.time_ns, publisher.made) == (5 * STEP_NS, 2 * [("wake",)]), "services publish meanwhile"


def test_the_watch_is_checked_once_a_period(vehicle: Vehicle) -> None:
    loop, events = vehicle.loop, vehicle.simulation.events
    loop.advance(1)
    assert loop.watch.due_ns == STEP_NS + PERIOD_NS
    vehicle.simulation.state.quaternion = list(UPSIDE_DOWN)
    loop.advance(PERIOD_NS // STEP_NS - 1)
    assert len(events) == 0
    vehicle.simulation.state.quaternion = list(UPSIDE_DOWN)
    loop.advance(1)
    assert [event.kind for event in events.events()] == ["capsize"]


def test_the_node_ticks_when_it_is_due(vehicle: Vehicle) -> None:
    loop, node = vehicle.loop, Calls()
    loop.ros, node.due_ns = node, 3 * STEP_NS
    for _ in range(4):
        loop.advance(1)
    assert node.made == [("tick", 3 * STEP_NS), ("tick", 4 * STEP_NS)]


def test_changes_from_outside_reach_the_simulation_and_the_observers(vehicle: Vehicle) -> None:
    loop, observer = vehicle.loop, Calls()
    loop.observers.append(observer)
    vehicle.command(0.4)
    loop.advance(2)
    now, failure = 2 * STEP_NS, Failure(vehicle.simulation.vehicle.thrusters[0].name, "off")
    observer.made.clear()
    pose = (1.0, 2.0, 3.0), (0.6, 0.0, 0.0, 0.8), (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    loop.set_state(*pose)
    loop.fail(failure)
    loop.stamp(7 * NS_PER_S)
    assert observer.made == [
        ("record_state", now, *pose),
        ("record_failures", now, (failure,)),
        ("record_epoch", now, 7 * NS_PER_S),
    ]
    state = vehicle.simulation.state
    assert (tuple(state.position), tuple(state.quaternion), tuple(state.nu)) == pose
    assert vehicle.simulation.failures(failure.thruster) == (failure,)
    assert not vehicle.pilot.active, "it waits for the next command"
    assert loop.sample_publisher.stamps.stamp(now + 5) == 7 * NS_PER_S + now + 5


def test_stamps_give_when_a_step_was_due_and_follow_skipped_steps_and_a_clock_that_was_set(vehicle: Vehicle) -> None:
    loop, stamps = vehicle.loop, vehicle.loop.sample_publisher.stamps

    def is_stamped_due() -> bool:
        ended_ns = loop.schedule.deadline_ns - STEP_NS  # the newest step that was due
        return stamps.stamp(vehicle.simulation.time_ns) == ended_ns + stamps.offset_ns

    first = loop.schedule.deadline_ns
    loop.advance_to(first + 2 * STEP_NS)
    assert vehicle.simulation.time_ns == 3 * STEP_NS
    assert is_stamped_due()
    loop.advance_to(loop.schedule.deadline_ns + 100 * NS_PER_S)  # it was stopped for long
    assert loop.schedule.skipped > 0
    assert is_stamped_due()
    stamps.found_ns = stamps.offset_ns + 5 * NS_PER_S
    loop.advance_to(loop.schedule.deadline_ns)
    assert stamps.offset_ns == stamps.found_ns
    assert is_stamped_due()


def test_the_last_trace_is_published_at_the_end(vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    stop, source, vehicle.loop.started_ns = os.eventfd(1), Calls(), 0
    monkeypatch.setattr(vehicle.loop.source, "finish", source.finish)
    vehicle.loop.run(stop)
    os.close(stop)
    assert source.made == [("finish",)]
    assert vehicle.loop.started_ns > 0, "figures count from there"


def test_a_source_that_keeps_the_step_does_those_that_waited_for_its_answer(
    vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop, source = vehicle.loop, vehicle.loop.source
    monkeypatch.setattr(source, "permitted_steps", lambda due: 3 + due)
    for source.keeps_step, steps in ((False, 0), (True, 3)):
        source.due_ns = 0
        loop.serve_source(now_ns())
        assert vehicle.simulation.time_ns == steps * STEP_NS


def test_the_step_before_the_schedule_ends_now(vehicle: Vehicle) -> None:
    before = now_ns()
    vehicle.loop.begin()
    assert vehicle.simulation.time_ns == STEP_NS
    stamps = vehicle.loop.sample_publisher.stamps
    assert before <= stamps.stamp(STEP_NS) - stamps.offset_ns <= now_ns()


def test_the_figures_tell_how_late_the_loop_is(vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    loop, figures = vehicle.loop, Diagnostics()
    schedule, wall_ns = loop.schedule, 10 * NS_PER_S
    schedule.due_total, schedule.skipped = 3900, 60
    for late_ms in [0.1] * 990 + [1.0] * 9 + [30.0]:
        schedule.lateness.add(round(late_ms * NS_PER_MS))
    loop.started_ns = 3 * NS_PER_S
    monkeypatch.setattr("hil.slave.loop.now_ns", lambda: 3 * NS_PER_S + wall_ns)
    loop.add_figures(figures)
    assert (figures.loop_rate_hz, figures.steps_skipped) == (400.0, 60)
    assert figures.real_time_factor == pytest.approx(0.975)
    assert figures.behind_ms == pytest.approx(100.0), "of 4,000 steps 40 are neither done nor skipped"
    assert figures.within_2ms == pytest.approx(0.999)
    assert figures.lateness_p50_us == pytest.approx(100.0, rel=0.2)
    assert figures.lateness_p99_us == pytest.approx(100.0, rel=0.2)
    assert figures.lateness_p999_us == pytest.approx(1000.0, rel=0.2)
    assert figures.lateness_max_us == 30_000.0
    assert figures.run_events == 0


# --- a lost link


class Bench:
    """A link that is lost, and opens again when the test lets it."""

    def __init__(self) -> None:
        self.first, self.again, self.may_open = BenchLink(), BenchLink(), threading.Event()
        self.attempts, self.fails, self.output = 0, 0, list[str]()
        self.driver = ExternalDriver(self.open, 2, NS_PER_S, self.output.append)
        self.first.broken = True
        self.driver.service(now_ns())

    def open(self) -> Ends:
        self.attempts += 1
        if self.attempts == 1:
            return self.first.bench_ends()
        self.may_open.wait(60.0)
        if self.attempts <= 1 + self.fails:
            raise DeviceError("not there yet")
        return self.again.bench_ends()


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setattr(stm32, "RETRY_S", 0.001)
    return Bench()


def test_a_link_that_is_opened_after_the_end_is_closed(bench: Bench) -> None:
    assert wait_for(lambda: bench.attempts == 2)
    assert bench.first.closed, "a device that is open cannot be opened again"
    bench.driver.close()
    bench.may_open.set()
    assert wait_for(lambda: bench.again.closed)
    assert bench.driver.lost


def test_a_link_that_was_opened_but_not_used_yet_is_closed(bench: Bench) -> None:
    bench.may_open.set()
    opening = bench.driver._opening
    assert opening
    assert wait_for(lambda: opening.opened_ends() is not None)
    bench.driver.close()
    assert bench.again.closed


def test_a_lost_link_is_tried_until_it_opens_and_then_used(bench: Bench) -> None:
    bench.fails = 3
    bench.may_open.set()
    driver, now = bench.driver, now_ns()
    assert (driver.lost, driver.losses, driver.descriptors, driver.children) == (True, 1, [], ())
    assert driver.service(now) == []
    assert driver.deadline_ns == now + stm32.CHECK_NS
    assert wait_for(lambda: bool(driver.service(now_ns()) or not driver.lost))
    assert (bench.attempts, driver.losses) == (5, 1)
    assert driver.host is cast(Any, bench.again)
    driver.close()
    assert bench.again.closed
