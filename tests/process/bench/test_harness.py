"""The benchmark harness: changed scenarios, resource limits, processes, and that nothing is left behind."""

import os
from pathlib import Path

import pytest

from hil.bench import limits
from hil.bench.harness import Bench, Process, await_vehicle
from hil.bench.limits import Confinement, Limits, parse_cpus, parse_memory
from hil.bench.machine import describe
from hil.commands.bench.options import CPU_SHARE
from hil.common.errors import ConfigError, NetworkError
from hil.common.scratch import lock_unused
from tests.support.boards import recorded

FIRST_CPU = min(os.sched_getaffinity(0))


def test_resource_limits_are_parsed() -> None:
    assert [parse_cpus(text) for text in ("0", "0,2", "1-3,0")] == [(0,), (0, 2), (0, 1, 2, 3)]
    assert [parse_memory(text) for text in ("512M", "1G", "64 MiB")] == [512.0, 1024.0, 64.0]
    assert [CPU_SHARE(text) for text in ("25%", "0.5", "150%")] == [0.25, 0.5, 1.5]
    assert Limits((0,), 0.25, 512.0).label == "limited: processor 0 only, 25% of a core, 512 MiB"
    assert Limits(cpu_share=0.125).label == "limited: 12.5% of a core"
    assert Limits().label == ""


# What a systemd-run does in place of the program that looks for the group's files.
@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("echo cgroup.procs cpu.max memory.max", ""),
        ("echo cgroup.procs memory.max", r"^--cpu-quota: .* keeps the cpu controller from users; .*Delegate=pids mem"),
        ("echo cgroup.procs cpu.max", r"^--memory: .* keeps the memory controller from users"),
        ("echo Failed to connect to bus >&2; exit 1", r"^--cpu-quota, .*: Failed to connect to bus; .*enable-linger"),
    ],
)
def test_cgroup_controllers_that_systemd_delegates_are_used_or_reported_as_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, message: str
) -> None:
    recorded.plant(tmp_path, "cgroup.controllers", "cpu memory\n")
    recorded.plant(tmp_path, "systemd-run", f"#!/bin/sh\n{script}\n")
    (tmp_path / "systemd-run").chmod(0o755)
    monkeypatch.setattr("hil.bench.limits.ROOT", str(tmp_path))
    monkeypatch.setattr("hil.bench.limits.SYSTEMD", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    confinement = Confinement(Limits(cpu_share=0.125, memory_mib=64.0))
    if message:
        with pytest.raises(ConfigError, match=message):
            confinement.__enter__()
        return
    with confinement:
        output = confinement.command(["program", "-x"])
    assert output[0] == "systemd-run"
    assert ("--user" in output) == (os.geteuid() != 0)
    given = [output[index + 1] for index, word in enumerate(output) if word == "-p"]
    assert given == ["CPUQuota=12.5%", "CPUQuotaPeriodSec=20000us", "MemoryMax=67108864", "MemorySwapMax=0"]
    assert output[-3:] == ["--", "program", "-x"]


def test_a_process_is_pinned_and_the_test_itself_is_not(tmp_path: Path) -> None:
    before = os.sched_getaffinity(0)
    with (
        Confinement(Limits(cpus=(FIRST_CPU,))) as place,
        Process(["sleep", "9"], str(tmp_path / "log"), place) as process,
    ):
        assert os.sched_getaffinity(process.pid) == {FIRST_CPU}
        assert process.family() == [process.pid]
    assert os.sched_getaffinity(0) == before
    assert not process.running


def test_output_of_a_process_is_awaited_and_its_end_is_reported(tmp_path: Path) -> None:
    with Process(["sh", "-c", "echo one; echo two; exit 3"], str(tmp_path / "log")) as process:
        assert process.expect("one", 60.0) == "one"
        assert process.wait(60) == 3
        assert process.last_line == "two"
        with pytest.raises(
            NetworkError, match=r"did not print 'three', but ended with exit code 3; its last output: t"
        ):
            process.expect("three", 60.0)


@pytest.mark.parametrize(
    ("limits", "by", "label"),
    [
        (Limits(memory_mib=16.0), "cgroup v1", "limited: 16 MiB (cgroup v1, files in the page cache not counted)"),
        (Limits(cpu_share=0.25), "systemd", "limited: 25% of a core (systemd, no real-time scheduling)"),
        (Limits(cpus=(FIRST_CPU,)), "", f"limited: processor {FIRST_CPU} only"),
    ],
)
def test_only_a_processor_share_limit_turns_off_real_time(
    monkeypatch: pytest.MonkeyPatch, limits: Limits, by: str, label: str
) -> None:
    def confine(self: Confinement) -> None:
        self.by = by

    monkeypatch.setattr(Confinement, "_confine", confine)
    with Bench("paper_field", limits=limits) as bench:
        assert bench.labels == (label,)
        assert bench.scenario.slave.realtime == (not limits.cpu_share)


def test_a_slave_starts_and_stops_without_leftovers() -> None:
    with Bench("paper_field", {"slave.realtime": False}, Limits(cpus=(FIRST_CPU,))) as bench:
        slave = bench.start_slave()
        with bench.client() as client:
            await_vehicle(client, slave)
            assert client.diagnostics().loop_rate_hz == 400
        assert bench.labels == (f"limited: processor {FIRST_CPU} only",)
        folder = bench.folder
    assert not slave.running
    assert slave.stop() == 0
    assert not os.path.exists(folder)


def plant_first_process(root: Path, machine: int) -> None:
    (root / "proc/1").mkdir(parents=True)
    (root / "proc/1/exe").write_bytes(b"\x7fELF" + bytes(14) + machine.to_bytes(2, "little"))


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


def test_a_32_bit_system_on_a_64_bit_kernel_is_not_emulated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Raspberry Pi OS of 32 bits is such a system, before Linux 6.1."""
    plant_first_process(tmp_path, 0x28)
    kernel = os.uname()
    monkeypatch.delenv("UUV_HIL_EMULATED", raising=False)
    monkeypatch.setattr("os.uname", lambda: os.uname_result((*kernel[:4], "aarch64")))
    assert describe(str(tmp_path))[1] == ()


def test_control_groups_of_killed_benchmarks_are_removed(tmp_path: Path) -> None:
    for name in ("uuv-hil-bench-1-a", "uuv-hil-bench-1-b", "another"):
        (tmp_path / name).mkdir()
    in_use = lock_unused(str(tmp_path / "uuv-hil-bench-1-b"))
    assert in_use is not None
    limits._remove_abandoned(str(tmp_path))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["another", "uuv-hil-bench-1-b"]
    os.close(in_use)
    limits._remove_abandoned(str(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["another"]
