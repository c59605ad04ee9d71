"""The doctor tells what is there and what is not, and changes nothing."""

import compileall
import os
import resource
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from hil import cli
from hil.commands import doctor

ROOT = Path(__file__).parents[2]


def report(**environment: str) -> dict[str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "hil.cli", "doctor"],
        cwd=ROOT, capture_output=True, text=True, env=os.environ | environment,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    return {line[:11].strip(): line[12:] for line in done.stdout.splitlines()}


def test_every_row() -> None:
    rows = report(UUV_HIL_NATIVE="0")
    assert rows["Python"].startswith(".".join(map(str, sys.version_info[:3])))
    assert rows["zenoh"] == metadata.version("eclipse-zenoh")
    assert rows["pyserial"] == metadata.version("pyserial")
    assert rows["step"] == "Python, as UUV_HIL_NATIVE=0 says"
    assert "modules" in rows["bytecode"]
    assert rows["board"]
    assert "SCHED_FIFO" in rows["scheduling"]
    assert "locked" in rows["memory"]
    assert rows["lock limit"] == doctor.lock_limit(resource.getrlimit(resource.RLIMIT_MEMLOCK)[0])
    assert rows["serial port"]


def test_a_wish_that_cannot_be_is_a_finding() -> None:
    assert "UUV_HIL_NATIVE='maybe'" in report(UUV_HIL_NATIVE="maybe")["step"]


def test_help_by_the_one_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(["doctor", "--help"])
    assert end.value.code == 0
    assert "usage: uuv-hil doctor" in capsys.readouterr().out


def test_nothing_of_this_process_changes() -> None:
    def settings() -> tuple[int, list[str]]:
        status = Path("/proc/self/status").read_text().splitlines()
        return os.sched_getscheduler(0), [line for line in status if line.startswith("VmLck")]

    before = settings()
    assert "memory" in dict(doctor.findings())
    assert settings() == before


def test_what_is_not_installed() -> None:
    assert doctor.library("no-such-distribution", "tea") == (
        "not installed; it is for tea (pip install no-such-distribution)"
    )


def test_bytecode(tmp_path: Path) -> None:
    """Not there, there, then older than its source."""
    source = tmp_path / "sim" / "deep" / "one.py"
    source.parent.mkdir(parents=True)
    source.write_text("x = 1\n")
    assert doctor.bytecode(str(tmp_path)).startswith("1 of 1 modules are not compiled")
    compileall.compile_dir(str(tmp_path), quiet=1)
    assert doctor.bytecode(str(tmp_path)) == "compiled, 1 modules"
    source.write_text("x = 1000\n")
    assert doctor.bytecode(str(tmp_path)).startswith("1 of 1 modules are not compiled")


def test_ports_that_may_not_be_opened(tmp_path: Path) -> None:
    assert "no permission" in doctor._port(str(tmp_path / "ttyUSB9"), "n/a")
    (tmp_path / "ttyUSB1").touch()
    assert doctor._port(str(tmp_path / "ttyUSB1"), "FT232R") == f"{tmp_path / 'ttyUSB1'} (FT232R)"


def test_no_limit() -> None:
    assert doctor.lock_limit(resource.RLIM_INFINITY) == "unlimited"
    assert doctor.lock_limit(8 * 2**20).startswith("8 MiB")
