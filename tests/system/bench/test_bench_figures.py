"""Figures of the benchmarks, without a slave: parsing, counting, statistics and verdicts."""

import mmap
import os
import time
from contextlib import ExitStack
from math import isnan
from pathlib import Path
from random import Random

import pytest

from hil.bench.load_run import Setting, course, difference
from hil.bench.processes import read_usage, shares
from hil.bench.soak_run import Observation, Outage, Soak, trend
from hil.bench.stream_run import expected, missing
from hil.commands.bench.soak import judge
from hil.scenario.config import load_scenario
from tests.support.bench_figures import usage


def test_processor_shares_of_processes_are_computed() -> None:
    before, after = usage({1: 1.0, 2: 0.5}, 100.0), usage({1: 1.5, 2: 0.5, 3: 0.2}, 102.0)
    assert shares(before, after) == {1: 0.25, 2: 0.0, 3: pytest.approx(0.1)}


def test_processor_time_and_memory_of_this_process_are_measured() -> None:
    began, spent = time.monotonic(), time.process_time()
    first = read_usage([os.getpid()])
    burn = sum(range(30_000_000))
    second = read_usage([os.getpid(), 2**22 + 1])
    share = (time.process_time() - spent) / (time.monotonic() - began)  # less than 1 where others are busy
    assert burn
    assert sum(shares(first, second).values()) == pytest.approx(share, rel=0.5)
    assert second.pss_mib > second.private_mib > 5.0
    assert second.descriptors >= 3
    assert second.threads >= 1


def test_a_shared_file_mapping_is_no_private_memory(tmp_path: Path) -> None:
    path = tmp_path / "shared"
    path.write_bytes(os.urandom(16 << 20))
    before = read_usage([os.getpid()])
    with path.open("rb") as file, ExitStack() as stack:
        maps = [stack.enter_context(mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)) for _ in range(2)]
        assert sum(maps[0][::4096]) == sum(maps[1][::4096])
        after = read_usage([os.getpid()])
    assert after.pss_mib - before.pss_mib > 15.0
    assert after.private_mib - before.private_mib < 3.0


def test_figures_of_a_course_are_separated_by_process() -> None:
    observations = [
        usage({1: 0.0, 2: 0.0}, 0.0, p1=10.0, p2=5.0),
        usage({1: 0.5, 2: 0.1}, 1.0, p1=11.0, p2=5.0),
        usage({1: 0.7, 2: 0.5}, 2.0, p1=12.0, p2=6.0),
    ]
    figures = course(Setting("as it is", {}), observations, {1: "uuv1 slave", 2: "uuv1 STM32"})
    assert figures.cpu == pytest.approx([0.6, 0.6])
    assert figures.memory == [16.0, 18.0]
    slave, stm32 = figures.processes.values()
    assert slave.cpu == pytest.approx([0.5, 0.2])
    assert slave.memory == [11.0, 12.0]
    assert stm32.cpu == pytest.approx([0.1, 0.4])


def test_a_difference_is_distinguished_from_noise() -> None:
    calm, more = [5.0, 5.1, 5.0, 5.1], [6.0, 6.1, 6.0, 6.1]
    assert difference(more, calm)[0] == pytest.approx(1.0)
    assert difference(more, calm)[1]
    assert not difference(more, [4.0, 5.1, 5.0, 6.2])[1]
    assert not difference(more, calm, [[6.5, 6.6]])[1], "the same setting once more was as far away"


def test_growth_is_distinguished_from_noise() -> None:
    random = Random(3)
    at = [10.0 * i for i in range(360)]
    noise = [random.gauss(20.0, 0.2) for _ in at]
    slope, low, high = trend(at, noise)
    assert low < 0.0 < high
    assert abs(slope) < 0.2
    slope, low, high = trend(at, [value + 1e-3 * t / 3.6 for value, t in zip(noise, at, strict=True)])
    assert 0.5 < low < 1.0 < high
    assert slope == pytest.approx(1.0, abs=0.2)
    assert isnan(trend([1.0], [1.0])[0])


def test_the_expected_rates_of_a_scenario() -> None:
    changes = {"sensors.dvl.rate": 4, "sensors.odometry.rate": 50, "sensors.camera": {}, "ros.wrench": 5}
    found = expected(load_scenario("paper_field", changes))
    assert found == {
        "diagnostics": 1.0, "imu": 100.0, "dvl": 4.0, "dvl_twist": 4.0, "altitude": 4.0, "pressure": 20.0,
        "odom": 50.0, "ground_truth": 20.0, "thruster_wrench": 5.0, "joint_states": 10.0,
        "motors": 10.0,
    }  # fmt: skip


def test_the_missing_share_follows_from_the_nominal_rate() -> None:
    assert missing(599, 100.0, 10.0) == pytest.approx(0.4)
    assert missing(9, 1.0, 10.0) == 0.0, "one more or less is chance"
    assert missing(0, 1.0, 1.9) == 0.0, "also where only one was due"
    assert missing(0, 1.0, 2.0) == 1.0
    assert isnan(missing(5, float("nan"), 1.0))


def looks_of(hours: float, grows_private: float = 0.0, swings: float = 0.0) -> list[Observation]:
    """Return observations a minute apart: private memory grows by MiB an hour, shared memory swings by MiB."""
    random, count = Random(2), round(hours * 60)
    return [
        Observation(60.0 * i, 15.0 + swings * (i * 2 > count), 11.0 + grows_private * i / 60 + random.gauss(0.0, 0.05),
             10, 30, 1.0, 0.0, 0.5)
        for i in range(count + 1)
    ]  # fmt: skip


def test_a_leak_is_found_in_private_memory_after_enough_time(capsys: pytest.CaptureFixture[str]) -> None:
    assert judge(Soak(looks_of(2.0, grows_private=1.0), [], []), 0.5)[0].startswith("memory grows by 1.0")
    assert judge(Soak(looks_of(2.0, swings=2.0), [], []), 0.5) == [], "the neighbours went"
    assert "no verdict" not in capsys.readouterr().out
    assert judge(Soak(looks_of(0.4, grows_private=20.0), [], []), 0.5) == []
    assert "no verdict on memory: that takes 30 minutes" in capsys.readouterr().out


def test_silences_and_late_reconnections_are_found() -> None:
    found = judge(Soak(looks_of(0.1), [0.01, 1.2, None], [Outage(36.0, 4.0, "uuv1 did not answer")]), 0.5)
    assert found == [
        "a master that reconnected got no sample (1 of 3 times)",
        "a reconnection took 1.2 s",
        "silence from 0.010 h on, for 4.0 s: uuv1 did not answer",
    ]
