"""Limit processors, CPU share and memory of a benchmark, so that a laptop has the resources of a small board.

Processors are chosen by affinity. A share of one, and memory, are limited by a control group: where systemd manages
those of version 2, it makes one, as root or as a user; elsewhere root makes them, of version 2 or 1. Memory beyond the
limit is not swapped out. A page is charged to the group that uses it first, so files that others have read before,
mostly Python and its libraries, are not counted. Figures under limits are labelled: another
processor's cache, memory and clock remain the laptop's.

Files of control groups: Linux, Documentation/admin-guide/cgroup-v2.rst, cgroup-v1/memory.rst, and
Documentation/scheduler/sched-bwc.rst. Properties of systemd: systemd.resource-control(5).
"""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

from hil.common.errors import ConfigError
from hil.common.scratch import lock_unused

ROOT = "/sys/fs/cgroup"
SYSTEMD = "/run/systemd/system"  # a folder that exists if systemd was booted: sd_booted(3)
PERIOD_US = 20_000  # of the quota: longest wait of a process that has used up its quota
MIN_QUOTA_US = 1_000  # the kernel's least; below 5 % of a core the period is longer
REMOVAL_S = 2.0  # limit until killed processes end
MIB = 1 << 20
MAX_MIB = 1 << 30  # a PiB
MAX_CPUS = 1 << 16  # more than any kernel supports
OPTIONS = {"cpu": "--cpu-quota", "memory": "--memory"}  # controller -> its option
REMEDIES = {
    "cpu": "use a kernel with CONFIG_CFS_BANDWIDTH",
    "memory": "take cgroup_disable=memory out of the kernel's command line; on a Raspberry Pi, add "
    "cgroup_enable=memory to the line in /boot/firmware/cmdline.txt; and reboot",
}
LINGER = "log in as this user, or loginctl enable-linger and set XDG_RUNTIME_DIR=/run/user/$(id -u)"
DELEGATE = "put Delegate=pids memory cpu below [Service] with: sudo systemctl edit user@.service, and reboot"
GROUP = "uuv-hil-bench-"  # prefix of a group's name
# Names the files of the group it runs in; without a "$", which is a variable to some versions of systemd-run.
LOOK = f"sed -n 's|^0::|{ROOT}|p' /proc/self/cgroup | xargs ls"


class Limits(NamedTuple):
    """`cpus` by number, all if empty; `cpu_share` of one core, `memory_mib`, 0 for no limit."""

    cpus: tuple[int, ...] = ()
    cpu_share: float = 0.0
    memory_mib: float = 0.0

    @property
    def label(self) -> str:
        """The limits as text; empty without limits."""
        words = []
        if self.cpus:
            words.append(f"processor {','.join(map(str, self.cpus))} only")
        if self.cpu_share:
            words.append(f"{self.cpu_share * 100:g}% of a core")
        if self.memory_mib:
            words.append(f"{self.memory_mib:.0f} MiB")
        return f"limited: {', '.join(words)}" if words else ""

    @property
    def controllers(self) -> list[str]:
        """Controllers of control groups ("cpu", "memory") that the limits need."""
        return [name for name, limit in (("cpu", self.cpu_share), ("memory", self.memory_mib)) if limit]


class Confinement:
    """Start processes under `limits`. Use as a context, which at its end kills the remaining processes of its group.

    `by` is the means: systemd or a control group. Raises ConfigError where such limits are
    not possible or not permitted.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.by = ""
        self._groups: list[str] = []
        self._locks: list[int | None] = []  # of the groups, so that other benchmarks do not remove them
        self._prefix: tuple[str, ...] = ()
        wrong = set(limits.cpus) - os.sched_getaffinity(0)
        if wrong:
            allowed = ",".join(map(str, sorted(os.sched_getaffinity(0))))
            raise ConfigError(f"no processor {min(wrong)} here; there are: {allowed}")

    def __enter__(self) -> "Confinement":
        if self.limits.controllers:
            self._confine()
        return self

    def __exit__(self, *_: object) -> None:
        while self._groups:
            _remove(self._groups.pop())
        while self._locks:
            lock = self._locks.pop()
            if lock is not None:
                os.close(lock)

    def command(self, command: list[str]) -> list[str]:
        """Return the command with the limits applied; its process id is that of the program."""
        if self._groups:
            joins = "".join(f"echo $$ > {group}/cgroup.procs && " for group in self._groups)
            return ["/bin/sh", "-c", f'{joins}exec "$@"', "sh", *command]
        return [*self._prefix, *command]

    def _confine(self) -> None:
        version = 2 if os.path.exists(f"{ROOT}/cgroup.controllers") else 1
        for name in self.limits.controllers:
            if not _has(name, version):
                raise ConfigError(f"{OPTIONS[name]}: no {name} controller in {ROOT}; {REMEDIES[name]}")
        # A group that root made beside those of systemd would lose its quota when the last unit with one ends.
        if version == 2 and os.path.isdir(SYSTEMD):
            self._request_scope()
            return
        if os.geteuid() != 0:
            raise ConfigError("--cpu-quota, --memory: be root; no systemd keeps control groups of version 2 here")
        try:
            self._make_groups(version)
        except OSError as error:
            self.__exit__()
            reason = f"{error.strerror}: {error.filename}"
            raise ConfigError(f"--cpu-quota, --memory: the control group cannot be made: {reason}") from None

    def _make_groups(self, version: int) -> None:
        self.by = f"cgroup v{version}"
        if version == 2:
            _write(f"{ROOT}/cgroup.subtree_control", " ".join(f"+{name}" for name in self.limits.controllers))
        for name, files in _settings(self.limits, version).items():
            group = self._make("" if version == 2 else name)
            for file, text in files.items():
                if "swap" not in file or os.path.exists(f"{group}/{file}"):  # a kernel without swap has no such file
                    _write(f"{group}/{file}", text)

    def _make(self, hierarchy: str) -> str:
        group = os.path.join(ROOT, hierarchy, f"{GROUP}{os.getpid()}-{id(self):x}")
        if group not in self._groups:
            _remove_abandoned(os.path.dirname(group))
            os.mkdir(group)
            self._groups.append(group)
            self._locks.append(lock_unused(group))
        return group

    def _request_scope(self) -> None:
        """Run each process in its own systemd scope; test one, as systemd does not report missing controllers."""
        self.by = "systemd"
        manager = () if os.geteuid() == 0 else ("--user",)
        options = [word for name in _properties(self.limits) for word in ("-p", name)]
        self._prefix = ("systemd-run", *manager, "--scope", "--quiet", "--collect", *options, "--")
        try:
            completed = subprocess.run(self.command(["sh", "-c", LOOK]), capture_output=True, text=True, check=False)
        except OSError as error:
            raise ConfigError(
                f"--cpu-quota, --memory: systemd-run: {error.strerror}; be root, or install systemd"
            ) from None
        if completed.returncode:
            reason = (completed.stderr.strip().splitlines() or ["systemd starts no scope"])[-1]
            raise ConfigError(f"--cpu-quota, --memory: {reason}; {LINGER}")
        for name in self.limits.controllers:
            if f"{name}.max" not in completed.stdout.split():
                raise ConfigError(f"{OPTIONS[name]}: systemd keeps the {name} controller from users; {DELEGATE}")


def _has(controller: str, version: int) -> bool:
    if version == 1:
        return os.path.exists(f"{ROOT}/{controller}/cgroup.procs")
    with open(f"{ROOT}/cgroup.controllers", encoding="utf-8") as file:
        return controller in file.read().split()


def _quota_us(share: float) -> tuple[int, int]:
    """Return the permitted processor time (us of one core), and its period (us)."""
    period = max(PERIOD_US, round(MIN_QUOTA_US / share))
    return round(share * period), period


def _settings(limits: Limits, version: int) -> dict[str, dict[str, str]]:
    """Return by controller the files of its group, with the values to write."""
    settings = {}
    if limits.cpu_share:
        quota, period = _quota_us(limits.cpu_share)
        one = {"cpu.cfs_period_us": str(period), "cpu.cfs_quota_us": str(quota)}
        settings["cpu"] = one if version == 1 else {"cpu.max": f"{quota} {period}"}
    if limits.memory_mib:
        size = str(round(limits.memory_mib * MIB))
        one = {"memory.limit_in_bytes": size, "memory.swappiness": "0"}
        settings["memory"] = one if version == 1 else {"memory.max": size, "memory.swap.max": "0"}
    return settings


def _properties(limits: Limits) -> Iterator[str]:
    """Yield the properties for systemd, whose shares have one decimal."""
    if limits.cpu_share:
        yield f"CPUQuota={limits.cpu_share:.1%}"
        yield f"CPUQuotaPeriodSec={_quota_us(limits.cpu_share)[1]}us"
    if limits.memory_mib:
        yield f"MemoryMax={round(limits.memory_mib * MIB)}"
        yield "MemorySwapMax=0"


def _remove_abandoned(folder: str) -> None:
    """Remove the groups of benchmarks that were killed; their processes have ended with them."""
    for name in os.listdir(folder):
        with suppress(OSError):  # it is in use, or removed meanwhile
            lock = lock_unused(os.path.join(folder, name)) if name.startswith(GROUP) else None
            if lock is not None:
                try:
                    os.rmdir(os.path.join(folder, name))
                finally:
                    os.close(lock)


def _remove(group: str) -> None:
    """Remove a group and kill its processes; a group that cannot be removed is left, because it is empty."""
    deadline = time.monotonic() + REMOVAL_S
    while os.path.isdir(group) and time.monotonic() < deadline:
        try:
            os.rmdir(group)
        except OSError:
            _kill(group)
            time.sleep(0.005)


def _kill(group: str) -> None:
    with open(f"{group}/cgroup.procs", encoding="utf-8") as file:
        for process in file.read().split():
            with suppress(ProcessLookupError):
                os.kill(int(process), signal.SIGKILL)


def parse_memory(text: str) -> float:
    """Return an amount of memory in MiB: "512M", "1G", "512 MiB". Raises ConfigError."""
    number = text.rstrip("iBMGmg ")
    unit = text[len(number) :].strip().upper()[:1]
    try:
        size = float(number) * {"M": 1.0, "G": 1024.0}[unit]
    except (ValueError, KeyError):
        size = 0.0
    if not 16.0 <= size <= MAX_MIB:
        raise ConfigError(f"expected at least 16M, such as 512M or 1G, found {text!r}")
    return size


def parse_cpus(text: str) -> tuple[int, ...]:
    """Return the processor numbers in "0", "0,2", "0-3". Raises ConfigError."""
    cpus: set[int] = set()
    try:
        for part in text.split(","):
            first, dash, last = part.partition("-")
            cpus.update(range(int(first), min(int(last if dash else first), MAX_CPUS) + 1))
    except ValueError:
        cpus = set()
    if not cpus:
        raise ConfigError(f"expected numbers of processors, such as 0 or 0,2 or 0-3, found {text[:40]!r}")
    return tuple(sorted(cpus))


def _write(path: str, text: str) -> None:
    try:
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        error.filename = path  # a refused value names no file
        raise
