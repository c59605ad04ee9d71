"""`bench jitter`, `load`, `stream` and `soak`: their arithmetic exactly, each once against a real slave, bad input."""

import json
import mmap
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from math import isnan, nan
from pathlib import Path
from random import Random

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.bench import load_run
from hil.bench.footer import footer
from hil.bench.harness import Bench, Process, await_vehicle
from hil.bench.jitter_run import bare_loop, changes_for, read_cyclictest
from hil.bench.limits import Limits
from hil.bench.load_run import Cost, Course, Setting, course, difference, groups, of_group, settings
from hil.bench.processes import Memory, Threads, read_threads, shares, thread_names
from hil.bench.record import load, new_record
from hil.bench.soak_run import Observation, Outage, Soak, trend
from hil.bench.stream_run import Listening, Stream, expected, missing
from hil.cli import main
from hil.commands.bench import jitter as bench_jitter
from hil.commands.bench import stream as bench_stream
from hil.commands.bench.soak import judge
from hil.common.clock import RateKeeper
from hil.common.errors import NetworkError
from hil.scenario.config import load_scenario
from tests.support.busy import retried_when_busy
from tests.support.processes import Program, wait_for

CYCLICTEST = """# /dev/cpu_dma_latency set to 0us
# Histogram
000009 000000
000010 000002
000011 000006
000050 000002
# Total: 000000010
# Min Latencies: 00010
# Avg Latencies: 00018
# Max Latencies: 00050
"""


def test_cyclictest_is_read() -> None:
    late = read_cyclictest(CYCLICTEST)
    assert late is not None
    assert late == (11.0, 50.0, 50.0, 50, 18)
    assert read_cyclictest("policy: fifo: no such thing") is None


@retried_when_busy("how late processes wake up")
def test_a_bare_loop_is_a_floor() -> None:
    with Bench("paper_field", changes_for(200.0)) as bench:
        late = bare_loop(bench, 0.5)
    assert 0.0 < late.p50 <= late.p99 <= late.maximum
    assert late.p50 < 5000.0


ONE = min(os.sched_getaffinity(0))
SLEEPER = """
import select, sys
from hil.common.clock import LOOP_PRIORITY, RateKeeper, now_ns, schedule_fifo
schedule_fifo(LOOP_PRIORITY)
keeper = RateKeeper(2_500_000, now_ns())
for _ in range(600):
    select.select((), (), (), max(keeper.deadline_ns - now_ns(), 0) / 1e9)
    keeper.due(now_ns())
print(keeper.lateness.quantile(0.5) / 1e3)
"""


@retried_when_busy("how late processes wake up")
def test_a_bare_loop_wakes_early_as_the_slave_does() -> None:
    sleeper = subprocess.run([sys.executable, "-c", SLEEPER], capture_output=True, text=True, check=True)
    with Bench("paper_field", changes_for(400.0)) as bench:
        assert bare_loop(bench, 1.5).p50 < float(sleeper.stdout)


def test_a_bare_loop_has_the_slaves_limits() -> None:
    with Bench("paper_field", changes_for(400.0), Limits(cpus=(ONE,))) as bench:
        start, asked = bench.start, []

        def watched(name: str, command: list[str], limited: bool = False) -> Process:
            process = start(name, command, limited)
            asked.append(os.sched_getaffinity(process.pid))
            return process

        bench.start = watched  # type: ignore[method-assign]
        bare_loop(bench, 0.2)
    assert asked == [{ONE}]


def test_a_late_wake_up_counts_for_each_period_it_missed() -> None:
    keeper = RateKeeper(1000, 0)
    assert keeper.due(1000) == 1
    assert keeper.due(4500) == 3  # periods that ended at 2000, 3000 and 4000
    assert keeper.lateness.count == 4
    assert keeper.lateness.maximum == 2500
    assert keeper.lateness.share_within(600) == 0.5  # 0 and 500 of 0, 2500, 1500, 500
    assert keeper.lateness.share_within(2500) == 1.0


def threads(cpu_s: dict[str, float], at_s: float, **mib: float) -> Threads:
    """Of processes 1 and 2."""
    return Threads(cpu_s, {int(pid[1:]): Memory(each, each / 2) for pid, each in mib.items()}, 5, at_s)


def test_shares_of_threads() -> None:
    before = threads({"1/1 main": 1.0, "1/2 rx": 0.5}, 100.0)
    after = threads({"1/1 main": 1.5, "1/2 rx": 0.5, "1/3 rx": 0.2}, 102.0)
    assert shares(before, after) == {"1/1 main": 0.25, "1/2 rx": 0.0, "1/3 rx": pytest.approx(0.1)}


def test_threads_of_one_name_are_told_apart() -> None:
    names = thread_names({"1/10 rx", "1/9 rx", "2/11 rx", "1/1 main program"})
    assert names == {"1/1 main program": "main program", "1/9 rx": "rx", "1/10 rx": "rx #2", "2/11 rx": "rx"}


@retried_when_busy("two clocks are read one after the other", attempts=10)
def test_a_look_at_this_process() -> None:
    began, spent = time.monotonic(), time.process_time()
    first = read_threads([os.getpid()])
    burn = sum(range(30_000_000))
    second = read_threads([os.getpid(), 2**22 + 1])
    share = (time.process_time() - spent) / (time.monotonic() - began)  # less than 1 where others are busy
    assert burn
    assert sum(shares(first, second).values()) == pytest.approx(share, rel=0.25)
    assert second.pss_mib > second.private_mib > 5.0
    assert second.descriptors >= 3


def test_a_map_of_a_shared_file_is_no_private_memory(tmp_path: Path) -> None:
    path = tmp_path / "shared"
    path.write_bytes(os.urandom(16 << 20))
    before = read_threads([os.getpid()])
    with path.open("rb") as file, ExitStack() as stack:
        maps = [stack.enter_context(mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)) for _ in range(2)]
        assert sum(maps[0][::4096]) == sum(maps[1][::4096])
        after = read_threads([os.getpid()])
    assert after.pss_mib - before.pss_mib > 15.0
    assert after.private_mib - before.private_mib < 3.0


def test_what_a_load_is_made_of() -> None:
    names = [setting.name for setting in settings(("imu", "dvl", "laser"), [100.0], [1, 2])]
    assert names[0] == "as it is"
    assert {"without dvl", "without laser", "with gps", "with pressure", "100 Hz", "1 vehicle", "2 vehicles"} < {*names}
    assert "without imu" not in names, "the controller lives on it"
    assert names[-1] == "as it is, again"
    assert [setting.name for setting in settings(None, [], [])] == ["as it is"]


def test_a_course_tells_process_from_process() -> None:
    looks = [
        threads({"1/1 main": 0.0, "2/2 main": 0.0}, 0.0, p1=10.0, p2=5.0),
        threads({"1/1 main": 0.5, "2/2 main": 0.1}, 1.0, p1=11.0, p2=5.0),
        threads({"1/1 main": 0.7, "2/2 main": 0.2, "2/3 rx": 0.3}, 2.0, p1=12.0, p2=6.0),
    ]
    found = course(Setting("as it is", {}), looks, {1: "uuv1 slave", 2: "uuv1 STM32"})
    assert found.cpu == pytest.approx([0.6, 0.6])
    assert found.memory == [16.0, 18.0]
    slave, stm32 = found.processes.values()
    assert slave.cpu == pytest.approx([0.5, 0.2])
    assert slave.memory == [11.0, 12.0]
    assert slave.threads == {"main": pytest.approx([0.5, 0.2])}
    assert stm32.cpu == pytest.approx([0.1, 0.4])
    assert stm32.threads == {"main": pytest.approx([0.1, 0.1]), "rx": pytest.approx([0.0, 0.3])}
    assert groups([found]) == ["slave", "STM32"]
    assert of_group(found, "STM32").memory == [5.0, 6.0]
    assert of_group(found, "imaging").cpu == []


def test_a_difference_is_told_from_noise() -> None:
    calm, more = [5.0, 5.1, 5.0, 5.1], [6.0, 6.1, 6.0, 6.1]
    assert difference(more, calm).is_distinct
    assert difference(more, calm).more == pytest.approx(1.0)
    assert not difference(more, [4.0, 5.1, 5.0, 6.2]).is_distinct
    assert not difference(more, calm, [[6.5, 6.6]]).is_distinct, "the same setting once more was as far away"


def test_growth_is_told_from_noise() -> None:
    random = Random(3)
    at = [10.0 * i for i in range(360)]
    noise = [random.gauss(20.0, 0.2) for _ in at]
    slope, interval = trend(at, noise)
    assert interval.low < 0.0 < interval.high
    assert abs(slope) < 0.2
    slope, interval = trend(at, [value + 1e-3 * t / 3.6 for value, t in zip(noise, at, strict=True)])
    assert interval.low < 1.0 < interval.high
    assert interval.low > 0.5
    assert slope == pytest.approx(1.0, abs=0.2)
    assert isnan(trend([1.0], [1.0])[0])


def test_jitter_of_a_real_slave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(tmp_path / "jitter.json")
    words = ["--rates", "200", "--seconds", "1", "--repeat", "2", "--set", "sensors.imu.rate=50"]
    assert main(["bench", "jitter", *words, "--output", file]) == 0
    said = capsys.readouterr().out
    assert "200 Hz, slave" in said
    assert "medians of 2 runs" in said
    assert "cyclictest is what the kernel does for a program that sleeps" in said
    record = load(file)
    assert len(record.figures["200 Hz slave p50"].values) == 2
    assert 0.0 < record.figures["200 Hz slave p50"].median < 10_000.0
    assert 50.0 < record.figures["200 Hz within 2 ms"].median <= 100.0
    assert record.settings["scenario"] == "paper_field"
    assert record.settings["set"] == ["sensors.imu.rate=50"]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--cpus", "99"], "no processor 99"),
        (["nowhere"], "no scenario 'nowhere'"),
        (["--rates", "400,50"], "sensor 'imu'"),
        (["--repeat", "0"], "--repeat"),
    ],
)
def test_jitter_errs_before_it_measures(
    words: list[str], text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_jitter, "cyclictest", lambda *_: pytest.fail("measured first"))
    assert main(["bench", "jitter", *words]) == 2
    assert text in capsys.readouterr().err


def test_stream_of_a_real_slave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(tmp_path / "stream.json")
    changes = ["--set", "sensors.imu.rate=50", "--set", "sensors.ground_truth.drop_out=1.0"]
    assert main(["bench", "stream", "--seconds", "2", "--repeat", "2", *changes, "--output", file]) == 0
    figures = load(file).figures
    assert len(figures["imu rate"].values) == 2
    assert figures["imu rate"].median == pytest.approx(50.0, rel=0.1)
    assert figures["imu loss"].median == 0.0
    assert figures["imu missing"].median < 10.0
    assert figures["imu bandwidth"].median == pytest.approx(50.0 * 357, rel=0.15)  # 324 B of CDR, 33 attached
    assert 0.0 < figures["imu age p50"].median < 20.0
    assert figures["ground_truth rate"].median == 0.0
    assert figures["ground_truth missing"].median == 100.0
    assert "nothing came on ground_truth" in capsys.readouterr().out


def test_what_a_scenario_sends() -> None:
    changes = {"sensors.dvl.rate": 4, "sensors.odometry.rate": 50, "sensors.camera": {}, "ros.wrench": 5}
    found = expected(load_scenario("paper_field", changes))
    assert found == {
        "diagnostics": 1.0, "imu": 100.0, "dvl": 4.0, "dvl_twist": 4.0, "altitude": 4.0, "pressure": 20.0,
        "odom": 50.0, "ground_truth": 20.0, "thruster_wrench": 5.0, "joint_states": 10.0,
    }  # fmt: skip


def test_a_topic_is_not_dead_that_only_one_message_was_due_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """But it is where one was due in each of several runs."""
    silent = Stream("diagnostics", 0.0, 1.0, nan, 0.0, nan, nan, 0.0)
    heard = Listening([silent, silent._replace(topic="imu", nominal=100.0)], [])
    monkeypatch.setattr(bench_stream, "_listen", lambda *_: (heard, ()))
    for repeat, dead in (("1", "imu"), ("3", "diagnostics, imu")):
        assert main(["bench", "stream", "--seconds", "1", "--repeat", repeat]) == 0
        assert f"nothing came on {dead}, though a slave of this scenario should" in capsys.readouterr().out


def test_what_is_missing_by_the_nominal_rate() -> None:
    assert missing(599, 100.0, 10.0) == pytest.approx(0.4)
    assert missing(9, 1.0, 10.0) == 0.0, "one more or less is chance"
    assert missing(0, 1.0, 1.9) == 0.0, "also where only one was due"
    assert missing(0, 1.0, 2.0) == 1.0
    assert isnan(missing(5, float("nan"), 1.0))


@retried_when_busy("processes that get no turn for a while")
def test_load_of_real_slaves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, png = tmp_path / "load.json", tmp_path / "load.png"
    words = ["--seconds", "2", "--vehicles", "2", "--set", "stm32=process", "--output", str(file), "--plot", str(png)]
    assert main(["bench", "load", *words]) == 0
    figures = load(str(file)).figures
    one, two = figures["as it is cpu"].median, figures["2 vehicles cpu"].median
    assert 0.5 < one < 100.0
    assert one < two
    assert figures["2 vehicles memory"].median > 1.3 * figures["as it is memory"].median
    assert png.read_bytes().startswith(b"\x89PNG")
    details = json.loads(file.read_text())["details"]
    assert [*details["as it is"]] == ["slave", "STM32"]
    assert {*details["2 vehicles"]} == {f"uuv{number} {what}" for number in (1, 2) for what in ("slave", "STM32")}
    slave = details["as it is"]["slave"]
    assert len(slave["cpu"]) == len(slave["memory_mib"]) == 2
    assert len(slave["threads"]) > 3
    assert sum(values[0] for values in slave["threads"].values()) == pytest.approx(slave["cpu"][0])
    said = capsys.readouterr().out
    assert re.search(r"^2 vehicles +uuv2 STM32 ", said, re.M)
    assert re.search(r"^as it is, again ", said, re.M)


def test_load_leaves_out_what_cannot_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(setting: Setting, *_: object) -> Course:
        if setting.name == "with laser":
            raise NetworkError("it fell over")
        return Course(setting, [0.05, 0.06], [20.0, 20.0], {"slave": Cost([0.05, 0.06], [20.0, 20.0], {})})

    monkeypatch.setattr(load_run, "run", run)
    file = tmp_path / "load.json"
    assert main(["bench", "load", "--each-sensor", "--output", str(file)]) == 1
    said = capsys.readouterr().out
    assert "left out: with battery: sensor 'battery': paper_six has no battery" in said
    assert "left out: with gps: " in said
    assert "FAILED: with laser: it fell over" in said
    assert re.search("^with laser +failed$", said, re.M)
    assert "with profiler cpu" in load(str(file)).figures
    assert load(str(file)).details["with laser"] == {"failure": "it fell over"}


def looks_of(hours: float, grows_private: float = 0.0, swings: float = 0.0) -> list[Observation]:
    """A look every minute; MiB an hour of private growth, MiB by which the shared part swings."""
    random, count = Random(2), round(hours * 60)
    return [
        Observation(60.0 * i, 15.0 + swings * (i * 2 > count), 11.0 + grows_private * i / 60 + random.gauss(0.0, 0.05),
             10, 30, 1.0, 0.0, 0.5)
        for i in range(count + 1)
    ]  # fmt: skip


def test_a_leak_is_of_private_memory_and_takes_time(capsys: pytest.CaptureFixture[str]) -> None:
    assert judge(Soak(looks_of(2.0, grows_private=1.0), [], []), 0.5)[0].startswith("memory grows by 1.0")
    assert judge(Soak(looks_of(2.0, swings=2.0), [], []), 0.5) == [], "the neighbours went"
    assert "no verdict" not in capsys.readouterr().out
    assert judge(Soak(looks_of(0.4, grows_private=20.0), [], []), 0.5) == []
    assert "no verdict on memory: that takes 30 minutes" in capsys.readouterr().out


def test_a_silence_and_a_late_return_are_found() -> None:
    found = judge(Soak(looks_of(0.1), [0.01, 1.2, None], [Outage(36.0, 4.0, "uuv1 did not answer")]), 0.5)
    assert found == [
        "a master that came back was not answered (1 of 3 times)",
        "a return took 1.2 s",
        "silence from 0.010 h on, for 4.0 s: uuv1 did not answer",
    ]


def test_the_foot_of_a_picture_tells_where_when_and_under_what() -> None:
    record = new_record("soak", {}, {}, ("limited: 5% of a core",))
    text = footer(record)
    assert record.made in text
    assert os.uname().nodename in text
    assert "limited: 5% of a core" in text


@retried_when_busy("a slave that gets no turn for a while is behind its time")
def test_soak_of_a_real_slave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, png = str(tmp_path / "soak.json"), tmp_path / "soak.png"
    words = ["bench", "soak", "--hours", "0.0015", "--every", "0.5", "--leave-every", "2.5", "--plot", str(png)]
    assert main([*words, "--output", file]) == 0, capsys.readouterr().out
    figures = load(file).figures
    assert len(figures["return"].values) == 2, "the start is none"
    assert max(figures["return"].values) < 1.0
    assert figures["real-time factor"].median == pytest.approx(1.0, abs=0.01)
    assert {"steps skipped", "threads", "private memory"} < {*figures}
    assert 1.0 < figures["private memory"].median < figures["memory"].median
    assert png.read_bytes().startswith(b"\x89PNG")


def test_a_master_that_comes_after_another_is_not_refused() -> None:
    with Bench("paper_field") as bench:
        slave = bench.start_slave()
        for _ in range(6):
            with bench.client() as client:
                await_vehicle(client, slave)
                for _ in range(3):
                    client.command(VelocityCommand())
                assert client.refusal() == ""


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["jitter", "--rates", "fast"], "--rates: expected a number from 50 to 5000 Hz, found 'fast'"),
        (["jitter", "--seconds", "0"], "--seconds"),
        (["load", "--vehicles", "1.5"], "--vehicles: expected a whole number from 1 to 64, found '1.5'"),
        (["load", "--rates", "1e9"], "--rates"),
        (["stream", "--seconds", "-1"], "--seconds"),
        (["soak", "--every", "10", "--leave-every", "10"], "--leave-every"),
        (["soak", "--hours", "0.001"], "--every"),
        (["soak", "--leak", "nan"], "--leak"),
        (["load", "--vehicles", "nan"], "--vehicles: expected"),
        (["load", "--vehicles", "inf"], "--vehicles: expected"),
        (["stream", "target_hunting"], "this is a fleet (uuv1, uuv2, uuv3, uuv4), and a benchmark is of one vehicle"),
        (["table", "--plot", "table.xyz"], "pictures end in"),
        (
            ["table", "--connect", "tcp/127.0.0.1:1", "--set", "slave.step=0.001"],
            "slave.step: a slave that runs elsewhere",
        ),
        (["table", "--set", "link.port=/dev/ttyNONE", "--set", "stm32=device"], "/dev/ttyNONE"),
        (["startup", "--set", "link.port=/dev/ttyNONE", "--set", "stm32=device"], "/dev/ttyNONE"),
        (["stream", "nowhere"], "no scenario 'nowhere'"),
        (["stream", "--repeat", "0"], "--repeat"),
        (["stream", "--connect", "tcp/127.0.0.1:1", "--cpus", "0"], "start that one as it shall be"),
        (["stream", "--connect", "tcp/127.0.0.1:1", "--set", "seed=2"], "start that one as it shall be"),
        (["stream", "--output", "/proc/no/file"], "cannot be written"),
        (["load", "--plot", "/proc/no/file"], "cannot be written"),
        (["load", "--rates", "50", "--set", "slave.step=0.02"], "sensor 'imu'"),
        (["soak", "--output", "/proc/no/file"], "cannot be written"),
        (["jitter", "--output", "/proc/no/file"], "cannot be written"),
    ],
)
def test_bad_input_is_named(words: list[str], text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", *words]) not in (0, 1)
    assert text in capsys.readouterr().err


def test_what_was_measured_before_an_interrupt_is_told(tmp_path: Path) -> None:
    words = ("bench", "table", "--seconds", "1", "--repeat", "99", "--output", str(tmp_path / "table.json"))
    with Program(tmp_path, *words, environment={"TMPDIR": str(tmp_path)}) as program:
        assert wait_for(lambda: len(list(tmp_path.glob("uuv-hil-scratch-bench-*/slave-*.log"))) >= 3, 60)
        assert program.stop(signal.SIGINT) == 130
    assert "STOPPED: this machine: run" in program.output
    record = load(str(tmp_path / "table.json"))
    assert 1 <= len(record.figures["startup"].values) < 99
    assert record.labels[-1].startswith("STOPPED: this machine: run")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_what_was_started(number: int, tmp_path: Path) -> None:
    with Program(tmp_path, "bench", "stream", "--seconds", "60", environment={"TMPDIR": str(tmp_path)}) as program:
        assert wait_for(lambda: list(tmp_path.glob("uuv-hil-scratch-bench-*/slave-*.log")))
        (log,) = tmp_path.glob("uuv-hil-scratch-bench-*/slave-*.log")
        assert wait_for(lambda: "ready" in log.read_text())
        assert program.stop(number) == 130
    left = subprocess.run(["pgrep", "-f", str(tmp_path)], capture_output=True, text=True)
    assert left.stdout == ""
    assert not list(tmp_path.glob("uuv-hil-scratch-bench-*"))
