"""Limits by control groups of version 2, made by root: the measured resources of a process."""

import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from hil.bench.limits import ROOT, Confinement, Limits
from hil.bench.processes import read_threads, shares
from hil.common.errors import ConfigError
from tests.support.processes import wait_for
from tools import uml

BUSY_S = 1.0
ZRAM = "/dev/zram0"  # a disk in memory, compressed: what a Raspberry Pi swaps to
in_the_guest = pytest.mark.usefixtures("guest", "cgroup2")


def do(command: str) -> None:
    """Run a command and assert that it succeeds."""
    subprocess.run(shlex.split(command), check=True, stdout=subprocess.DEVNULL)


@contextmanager
def mounted() -> Iterator[None]:
    """Mount control groups of version 2 where they belong."""
    do(f"mount -t cgroup2 cgroup2 {ROOT}")
    try:
        yield
    finally:
        do(f"umount {ROOT}")


@pytest.fixture(scope="module")
def cgroup2() -> Iterator[None]:
    """Mount control groups for the tests of a module."""
    with mounted():
        yield


@pytest.fixture
def swap() -> Iterator[None]:
    """Provide 256 MiB to swap to."""
    for module in uml.module_files(["zram"]):
        do(f"busybox insmod {module}")
    Path("/sys/block/zram0/disksize").write_text("256M")
    do(f"mkswap {ZRAM}")
    do(f"swapon {ZRAM}")
    yield
    do(f"swapoff {ZRAM}")


def share_of_a_core(confinement: Confinement) -> float:
    """Measure the share of a core that a busy process gets: its processor time over the elapsed time."""
    process = subprocess.Popen(confinement.command(["sh", "-c", "while :; do :; done"]))
    time.sleep(0.1)
    before = read_threads([process.pid])
    time.sleep(BUSY_S)
    (share,) = shares(before, read_threads([process.pid])).values()
    process.kill()
    process.wait()
    return share


def most_of_a_core(confinement: Confinement, expected: float) -> float:
    """Return the largest of up to ten shares, or the first sufficient one: a busy machine may stop the guest."""
    largest_share = 0.0
    for _ in range(10):
        largest_share = max(largest_share, share_of_a_core(confinement))
        if largest_share > 0.95 * expected:
            break
    return largest_share


def exit_code_of_process_with_memory(mib: int, confinement: Confinement) -> int:
    """Return the exit code of a process that writes to so much memory."""
    return subprocess.run(confinement.command([sys.executable, "-c", f"bytearray(b'x') * ({mib} << 20)"])).returncode


@in_the_guest
@pytest.mark.parametrize("share", [0.25, 0.03])
def test_a_process_gets_its_share_of_a_core(share: float) -> None:
    with Confinement(Limits(cpu_share=share)) as place:
        assert place.by == "cgroup v2"
        assert most_of_a_core(place, share) == pytest.approx(share, rel=0.1)


@in_the_guest
def test_a_process_without_cpu_limit_gets_a_whole_core() -> None:
    with Confinement(Limits(memory_mib=64.0)) as place:
        assert most_of_a_core(place, 1.0) > 0.9


@in_the_guest
def test_a_process_beyond_its_memory_limit_is_killed() -> None:
    with Confinement(Limits(memory_mib=48.0)) as confinement:
        assert exit_code_of_process_with_memory(24, confinement) == 0
        assert exit_code_of_process_with_memory(64, confinement) == -signal.SIGKILL
    with Confinement(Limits(cpu_share=1.0)) as confinement:
        assert exit_code_of_process_with_memory(64, confinement) == 0


@in_the_guest
@pytest.mark.usefixtures("swap")
def test_memory_beyond_the_limit_is_not_swapped_out() -> None:
    with Confinement(Limits(memory_mib=48.0)) as confinement:
        assert exit_code_of_process_with_memory(64, confinement) == -signal.SIGKILL
        (group,) = Path(ROOT).glob("uuv-hil-bench-*")
        (group / "memory.swap.max").write_text("max")
        assert exit_code_of_process_with_memory(64, confinement) == 0, "there was something to swap to"


@in_the_guest
def test_no_process_or_group_is_left_after_the_confinement() -> None:
    before = os.listdir(ROOT)
    with Confinement(Limits(cpu_share=0.5, memory_mib=64.0)) as place:
        process = subprocess.Popen(place.command(["sh", "-c", "sleep 60 & wait"]))
        (group,) = Path(ROOT).glob("uuv-hil-bench-*")
        assert wait_for(lambda: len(members(group)) == 2)
        (child,) = members(group) - {process.pid}
    assert process.wait(60) == -signal.SIGKILL
    assert wait_for(lambda: not psutil.pid_exists(child))
    assert os.listdir(ROOT) == before


def members(group: Path) -> set[int]:
    """Return the processes in a group."""
    return set(map(int, (group / "cgroup.procs").read_text().split()))


def as_on_a_raspberry_pi() -> None:
    """Check limits in that kernel: a share of a core works, a memory limit does not."""
    with mounted():
        with Confinement(Limits(cpu_share=0.25)) as place:
            print(place.by, most_of_a_core(place, 0.25))
        try:
            Confinement(Limits(memory_mib=64.0)).__enter__()
        except ConfigError as error:
            print(error)


def test_a_kernel_with_a_disabled_memory_controller_is_reported() -> None:
    call = f"from {__name__} import {as_on_a_raspberry_pi.__name__} as test; test()"
    ended = uml.run([sys.executable, "-c", call], cwd=str(uml.ROOT), options=["cgroup_disable=memory"])
    assert ended.status == 0, ended.output
    by_and_share, error = ended.output.splitlines()
    assert by_and_share.startswith("cgroup v2 ")
    assert float(by_and_share.split()[-1]) == pytest.approx(0.25, rel=0.1)
    assert error.startswith(f"--memory: no memory controller in {ROOT}; ")
    assert "cgroup_enable=memory" in error
    assert "/boot/firmware/cmdline.txt" in error
