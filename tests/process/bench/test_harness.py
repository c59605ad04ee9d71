"""The benchmark harness: changed scenarios, processes, and that nothing is left behind."""

import os
from pathlib import Path

import pytest

from hil.bench.harness import Bench, Process, await_vehicle
from hil.bench.machine import describe
from hil.cli import main
from hil.common.errors import NetworkError
from tests.support.boards import recorded

FIRST_CPU = min(os.sched_getaffinity(0))


def test_a_command_that_cannot_run_the_slave_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("no_such_program -c 0", "'", ""):
        assert main(["bench", "load", "--under", text]) == 2
        assert "uuv-hil bench load: --under: " in capsys.readouterr().err


def test_output_of_a_process_is_awaited_and_its_end_is_reported(tmp_path: Path) -> None:
    with Process(["sh", "-c", "echo one; echo two; exit 3"], str(tmp_path / "log")) as process:
        assert process.expect("one", 60.0) == "one"
        assert process.wait(60) == 3
        assert process.last_line == "two"
        with pytest.raises(
            NetworkError, match=r"did not print 'three', but ended with exit code 3; its last output: t"
        ):
            process.expect("three", 60.0)


def test_a_slave_starts_and_stops_without_leftovers() -> None:
    with Bench("paper_field", {"slave.realtime": False}, ["taskset", "-c", str(FIRST_CPU)]) as bench:
        slave = bench.start_slave()
        with bench.client() as client:
            await_vehicle(client, slave)
            assert client.diagnostics().loop_rate_hz == 400
        assert os.sched_getaffinity(slave.pid) == {FIRST_CPU}
        assert slave.family() == [slave.pid]
        assert bench.labels == (f"limited: run by taskset -c {FIRST_CPU}",)
        folder = bench.folder
    assert not slave.running
    assert slave.stop() == 0
    assert not os.path.exists(folder)


HYPERVISOR = "flags : fpu hypervisor\n"
QEMU_LABEL = "emulated, or a virtual machine: QEMU"


@pytest.mark.parametrize(
    ("files", "architecture", "labels"),
    [
        ({"proc/cmdline": "quiet UUV_HIL_EMULATED=qemu-system\n"}, "aarch64", ("emulated: qemu-system",)),
        ({"proc/sys/kernel/arch": "x86_64\n"}, "aarch64", ("emulated: aarch64 on x86_64",)),
        ({"proc/sys/kernel/arch": "aarch64\n"}, "aarch64", ()),
        ({"proc/sys/kernel/arch": "aarch64\n"}, "armv8l", ()),  # by setarch, on the bare processor
        ({"proc/device-tree/model": "linux,dummy-virt\0"}, "aarch64", (QEMU_LABEL,)),
        ({"sys/class/dmi/id/sys_vendor": "QEMU\n"}, "aarch64", (QEMU_LABEL,)),
        ({"sys/class/dmi/id/sys_vendor": "QEMU\n", "proc/cpuinfo": HYPERVISOR}, "x86_64", ("virtual machine",)),
        (
            {"proc/cmdline": "UUV_HIL_EMULATED=qemu-system\n", "proc/device-tree/model": "linux,dummy-virt\0"},
            "aarch64",
            ("emulated: qemu-system",),
        ),
    ],
)
def test_each_sign_of_emulation_gives_its_label(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, files: dict[str, str], architecture: str, labels: tuple[str, ...]
) -> None:
    for path, text in files.items():
        recorded.plant(tmp_path, path, text)
    monkeypatch.delenv("UUV_HIL_EMULATED", raising=False)
    kernel = os.uname()
    monkeypatch.setattr("os.uname", lambda: os.uname_result((*kernel[:4], architecture)))
    assert describe(str(tmp_path))[1] == labels
