"""Time stamps are those of the measurement: for hours, after skipped steps, and after the clock was set."""

import signal
import time
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any, cast

import pytest

from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S, SET_NS, RateKeeper
from hil.network.roles import open_master_session
from hil.recording.stamps import Stamps
from hil.ros import encoders as ros
from hil.ros.frames import decode_clock
from hil.ros.topics import TOPICS
from hil.slave.command_source import CommandSource
from hil.slave.loop import Loop
from hil.slave.ros.node import RosNode
from tests.support.processes import Program, wait_for, write_scenario

START_NS = 1_000 * NS_PER_S  # by the monotonic clock
WALL_OFFSET_NS = 1_700_000_000 * NS_PER_S


class LoopBench:
    """A loop whose simulation only counts time, on a schedule with the clock of the test."""

    def __init__(self, step_ns: int) -> None:
        self.step_ns = step_ns
        vehicle = SimpleNamespace(capsize_tilt=1.0, dimensions=(1.0, 1.0, 1.0))
        self.simulation = SimpleNamespace(time_ns=0, step=self._step, vehicle=vehicle, events=None, accessories=None)
        self.stamps = Stamps(0, WALL_OFFSET_NS)
        self.output: list[int] = []  # stamps
        sample_publisher = SimpleNamespace(stamps=self.stamps, publish_sample=self._sample, wake_publisher=lambda: None)
        driver: Any = SimpleNamespace(pwm_us=(), descriptors=list)
        source, publisher = CommandSource(driver), cast(Any, sample_publisher)
        self.loop = Loop(cast(Any, self.simulation), driver, source, publisher, step_ns, print)
        self.loop.watch.due_ns = NEVER_NS  # there is nothing to look at
        self.loop.schedule = RateKeeper(step_ns, START_NS)

    def _step(self, _pulses: object) -> list[tuple[str, int]]:
        self.simulation.time_ns += self.step_ns
        return [("imu", self.simulation.time_ns)]

    def _sample(self, _topic: str, time_ns: int) -> bool:
        self.output.append(self.stamps.stamp(time_ns))
        return True


def test_stamps_stay_right_for_hours_with_skipped_steps_and_a_set_clock() -> None:
    random, bed = Random(7), LoopBench(500 * NS_PER_MS)
    offset_ns, most_ns, skips, sets = WALL_OFFSET_NS, 0, 0, 0
    while bed.loop.schedule.deadline_ns < START_NS + 5 * 3600 * NS_PER_S:
        late_ns = random.randrange(0, 300_000)
        kind = random.random()
        if kind < 0.003:  # so long that steps are skipped
            late_ns += random.randrange(1, 40 * bed.step_ns * 3)
            skips += 1
        elif kind < 0.006:
            offset_ns += random.randrange(-3600 * NS_PER_S, 3600 * NS_PER_S)
            sets += 1
            assert bed.stamps.check_clock(offset_ns) != 0
        else:
            assert bed.stamps.check_clock(offset_ns + random.randrange(-SET_NS, SET_NS)) == 0, (
                "that is how clocks are read"
            )
        now = bed.loop.schedule.deadline_ns + late_ns
        bed.output.clear()
        bed.loop.advance_to(now)
        late_by_ns = now + offset_ns - bed.output[-1]
        assert bed.output == [bed.output[-1] - bed.step_ns * back for back in reversed(range(len(bed.output)))]
        most_ns = max(most_ns, late_by_ns - late_ns % bed.step_ns, -late_by_ns)
    assert skips > 50 < sets
    assert most_ns < NS_PER_MS


def test_late_samples_from_before_a_skip_have_their_own_stamp() -> None:
    stamps = Stamps(100, 0)
    assert stamps.stamp(5) == 105
    stamps.begin(10, 1000)
    stamps.begin(20, 5000)
    stamps.begin(20, 6000)  # nothing was measured in between
    assert [stamps.stamp(time) for time in (10, 11, 20, 21)] == [110, 1011, 1020, 6021]
    for number in range(1000):
        stamps.begin(100 + number, number)
    assert stamps.stamp(1099) == 1099 + 998
    assert len(stamps._older) < 100


def test_the_clock_topic_has_the_same_time(monkeypatch: pytest.MonkeyPatch) -> None:
    output: dict[str, bytes] = {}
    bed = LoopBench(2_500_000)
    bed.stamps.begin(0, 7 * NS_PER_S)
    sample_publisher = SimpleNamespace(stamps=bed.stamps, publish=output.__setitem__)
    node: Any = SimpleNamespace(
        _loop=SimpleNamespace(sample_publisher=sample_publisher, simulation=SimpleNamespace(accessories=None)),
        _clock=SimpleNamespace(passes=lambda _: True, due_ns=1),
        _wrench=SimpleNamespace(passes=lambda _: False, due_ns=1),
        _joints=SimpleNamespace(passes=lambda _: False, due_ns=1),
    )
    RosNode.tick(node, 5)
    assert decode_clock(output["/clock"]) == 7 * NS_PER_S + 5 == bed.stamps.stamp(5)


def test_stamps_are_right_again_after_the_slave_was_stopped(tmp_path: Path) -> None:
    """Stamps used to stay too old by the time for which the slave was stopped."""
    scenario, port = write_scenario(tmp_path)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with open_master_session(f"tcp/127.0.0.1:{port}") as session:
            lags: list[float] = []

            def smallest_lag_s() -> float:
                return min(lags, default=1e9)

            def on_sample(topic: str, payload: bytes, _: bytes) -> None:
                found: Any = ros.decode_imu(payload) if topic == TOPICS["imu"].name else None
                if found:
                    lags.append((time.time_ns() - found.time_ns) / NS_PER_S)

            session.subscribe("uuv1", "imu", on_sample, 64)
            assert wait_for(lambda: smallest_lag_s() < 0.2)
            slave.process.send_signal(signal.SIGSTOP)
            time.sleep(1.5)
            slave.process.send_signal(signal.SIGCONT)
            lags.clear()
            assert wait_for(lambda: len(lags) > 20 and smallest_lag_s() < 0.2), min(lags, default=None)
            assert min(lags) > -0.01, "no message comes before it was measured"
