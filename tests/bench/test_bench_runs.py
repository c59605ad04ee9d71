"""`bench jitter`, `load`, `stream` and `soak`: their arithmetic exactly, each once against a real slave, bad input."""

import os
import signal
import subprocess
import time
from math import isnan
from pathlib import Path
from random import Random

import pytest

from hil.autonomy.control import VelocityCommand
from hil.bench.harness import Bench, await_vehicle
from hil.bench.jitter_run import bare_loop, read_cyclictest
from hil.bench.load_run import settings
from hil.bench.processes import Threads, by_name, look, shares
from hil.bench.record import load
from hil.bench.soak_run import trend
from hil.cli import main
from hil.clock import RateKeeper
from tests.processes import Program, wait_for

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


def test_a_bare_loop_is_a_floor() -> None:
    late = bare_loop(200.0, 0.5, None)
    assert 0.0 < late.p50 <= late.p99 <= late.maximum
    assert late.p50 < 5000.0


def test_a_late_wake_up_counts_for_each_period_it_missed() -> None:
    keeper = RateKeeper(1000, 0)
    assert keeper.due(1000) == 1
    assert keeper.due(4500) == 3  # periods that ended at 2000, 3000 and 4000
    assert keeper.lateness.count == 4
    assert keeper.lateness.maximum == 2500
    assert keeper.lateness.share_within(600) == 0.5  # 0 and 500 of 0, 2500, 1500, 500
    assert keeper.lateness.share_within(2500) == 1.0


def test_shares_of_threads() -> None:
    before = Threads({"1/1 main": 1.0, "1/2 rx": 0.5}, 10.0, 5, 100.0)
    after = Threads({"1/1 main": 1.5, "1/2 rx": 0.5, "1/3 rx": 0.2}, 11.0, 6, 102.0)
    found = shares(before, after)
    assert found == {"1/1 main": 0.25, "1/2 rx": 0.0, "1/3 rx": pytest.approx(0.1)}
    assert by_name(found) == {"main": 0.25, "rx": pytest.approx(0.1)}


def test_a_look_at_this_process() -> None:
    began, spent = time.monotonic(), time.process_time()
    first = look([os.getpid()])
    burn = sum(range(3_000_000))
    second = look([os.getpid(), 2**22 + 1])
    share = (time.process_time() - spent) / (time.monotonic() - began)  # less than 1 where others are busy
    assert burn
    busy = by_name(shares(first, second))
    assert sum(busy.values()) == pytest.approx(share, rel=0.25)
    assert second.pss_mib > 5.0
    assert second.descriptors >= 3


def test_what_a_load_is_made_of() -> None:
    names = [setting.name for setting in settings(True, [100.0], [1, 2])]
    assert names[0] == "as it is"
    assert {"without dvl", "with gps", "100 Hz", "1 vehicle", "2 vehicles"} <= set(names)
    assert "without imu" not in names, "the controller lives on it"


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
    assert main(["bench", "jitter", "--rates", "200", "--seconds", "2", "--json", file]) == 0
    assert "200 Hz, slave" in capsys.readouterr().out
    figures = load(file).figures
    assert 0.0 < figures["200 Hz slave p50"].median < 10_000.0
    assert 50.0 < figures["200 Hz within 2 ms"].median <= 100.0


def test_stream_of_a_real_slave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(tmp_path / "stream.json")
    assert main(["bench", "stream", "--seconds", "2", "--set", "sensors.imu.rate=50", "--json", file]) == 0
    figures = load(file).figures
    assert figures["imu rate"].median == pytest.approx(50.0, rel=0.1)
    assert figures["imu loss"].median == 0.0
    assert figures["imu bandwidth"].median == pytest.approx(50.0 * 357, rel=0.15)  # 324 B of CDR, 33 attached
    assert 0.0 < figures["imu age p50"].median < 20.0


def test_load_of_real_slaves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, png = str(tmp_path / "load.json"), tmp_path / "load.png"
    assert main(["bench", "load", "--seconds", "2", "--vehicles", "2", "--json", file, "--png", str(png)]) == 0
    figures = load(file).figures
    one, two = figures["as it is cpu"].median, figures["2 vehicles cpu"].median
    assert 0.5 < one < 100.0
    assert one < two
    assert figures["2 vehicles memory"].median > 1.3 * figures["as it is memory"].median
    assert png.read_bytes().startswith(b"\x89PNG")
    assert "threads of 2 vehicles: " in capsys.readouterr().out


def test_soak_of_a_real_slave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(tmp_path / "soak.json")
    words = ["bench", "soak", "--hours", "0.0015", "--every", "0.5", "--leave-every", "2.5", "--leak", "1e9"]
    assert main([*words, "--json", file]) == 0, capsys.readouterr().out
    figures = load(file).figures
    assert len(figures["return"].values) >= 2
    assert max(figures["return"].values) < 1.0


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
        (["jitter", "--rates", "fast"], "--rates 'fast'"),
        (["jitter", "--seconds", "0"], "--seconds"),
        (["load", "--vehicles", "1.5"], "--vehicles '1.5'"),
        (["load", "--rates", "1e9"], "--rates"),
        (["stream", "--seconds", "-1"], "--seconds"),
        (["soak", "--every", "10", "--leave-every", "1"], "--leave-every"),
        (["stream", "nowhere"], "no scenario 'nowhere'"),
    ],
)
def test_bad_input_is_named(words: list[str], text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", *words]) not in (0, 1)
    assert text in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_what_was_started(number: int, tmp_path: Path) -> None:
    with Program(tmp_path, "bench", "stream", "--seconds", "60", environment={"TMPDIR": str(tmp_path)}) as program:
        assert wait_for(lambda: list(tmp_path.glob("uuv-hil-bench-*/slave-*.log")), 15)
        (log,) = tmp_path.glob("uuv-hil-bench-*/slave-*.log")
        assert wait_for(lambda: "ready" in log.read_text(), 15)
        assert program.stop(number) == 130
    left = subprocess.run(["pgrep", "-f", str(tmp_path)], capture_output=True, text=True)
    assert left.stdout == ""
    assert not list(tmp_path.glob("uuv-hil-bench-*"))
