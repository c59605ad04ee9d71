"""`bench load`, `stream` and `soak`: their arithmetic, one run of each with a real slave, wrong input."""

import re
import signal
from pathlib import Path

import pytest

from hil.bench import load_run
from hil.bench.load_run import Cost, Course, Setting
from hil.bench.record import load
from hil.bench.soak_run import RETURN_S
from hil.cli import main
from hil.common.errors import NetworkError
from tests.support.processes import Program, wait_for


def test_stream_measures_a_real_slave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(tmp_path / "stream.json")
    changes = ["--set", "sensors.imu.rate=50", "--set", "sensors.ground_truth.drop_out=1.0"]
    assert main(["bench", "stream", "--seconds", "2", "--repeat", "2", *changes, "--output", file]) == 0
    figures = load(file).figures
    assert len(figures["rate [imu]"].values) == 2
    rate_hz = figures["rate [imu]"].median
    assert 0.0 < rate_hz == pytest.approx(50.0 * (1.0 - figures["missing [imu]"].median / 100.0), rel=0.1)
    assert figures["loss [imu]"].median == 0.0
    assert figures["bandwidth [imu]"].median == pytest.approx(rate_hz * 357, rel=0.05)  # 324 B of CDR, 33 attached
    assert 0.0 < figures["age p50 [imu]"].median <= figures["age p99 [imu]"].median
    assert figures["rate [ground_truth]"].median == 0.0
    assert figures["missing [ground_truth]"].median == 100.0
    assert re.search(r"^ground_truth +0\.0 ", capsys.readouterr().out, re.M)


def test_load_measures_real_slaves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, png = tmp_path / "load.json", tmp_path / "load.png"
    words = ["--seconds", "2", "--vehicles", "2", "--set", "stm32=process", "--output", str(file), "--plot", str(png)]
    assert main(["bench", "load", *words]) == 0
    figures = load(str(file)).figures
    one, two = figures["cpu [as it is]"].median, figures["cpu [2 vehicles]"].median
    assert 0.5 < one < 100.0
    assert 0.8 * one < two
    assert figures["memory [2 vehicles]"].median > 1.3 * figures["memory [as it is]"].median
    assert png.read_bytes().startswith(b"\x89PNG")
    assert {"slave cpu [as it is]", "STM32 cpu [as it is]", "uuv2 STM32 memory [2 vehicles]"} < {*figures}
    assert len(figures["slave cpu [as it is]"].values) == 2
    output = capsys.readouterr().out
    assert re.search(r"^- uuv2 STM32 +[\d.]+ ", output, re.M)
    assert re.search(r"^as it is, again ", output, re.M)


def test_a_failed_setting_of_load_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(setting: Setting, *_: object) -> Course:
        if setting.name == "with laser":
            raise NetworkError("it fell over")
        return Course(setting, {"slave": Cost([0.05, 0.06], [20.0, 20.0])})

    monkeypatch.setattr(load_run, "run", run)
    file = tmp_path / "load.json"
    assert main(["bench", "load", "--each-sensor", "--output", str(file)]) == 1
    output = capsys.readouterr().out
    assert "left out: with battery: sensor 'battery': paper_six has no battery" in output
    assert "left out: with gps: " in output
    assert "FAILED: with laser: it fell over" in output
    assert re.search("^with laser +failed$", output, re.M)
    assert "cpu [with profiler]" in load(str(file)).figures
    assert load(str(file)).details["with laser"] == {"failure": "it fell over"}


def test_soak_measures_a_real_slave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, png = str(tmp_path / "soak.json"), tmp_path / "soak.png"
    words = ["bench", "soak", "--hours", "0.0015", "--every", "0.5", "--leave-every", "2.5", "--plot", str(png)]
    assert main([*words, "--output", file]) == 0, capsys.readouterr().out
    figures = load(file).figures
    assert len(figures["return"].values) == 2, "the start is none"
    assert max(figures["return"].values) < RETURN_S
    assert figures["real-time factor"].median == pytest.approx(1.0, abs=0.1)
    assert {"steps skipped", "threads", "private memory"} < {*figures}
    assert 1.0 < figures["private memory"].median < figures["memory"].median
    assert png.read_bytes().startswith(b"\x89PNG")


def test_results_before_an_interrupt_are_reported(tmp_path: Path) -> None:
    words = ("bench", "table", "--seconds", "1", "--repeat", "99", "--output", str(tmp_path / "table.json"))
    with Program(tmp_path, *words, environment={"TMPDIR": str(tmp_path)}) as program:
        assert wait_for(lambda: len(list(tmp_path.glob("uuv-hil-scratch-bench-*/slave-*.log"))) >= 3, 60)
        assert program.stop(signal.SIGINT) == 130
    assert "STOPPED: this machine: run" in program.output
    record = load(str(tmp_path / "table.json"))
    assert 1 <= len(record.figures["startup"].values) < 99
    assert record.labels[-1].startswith("STOPPED: this machine: run")
