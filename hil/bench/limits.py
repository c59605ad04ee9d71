"""Less than the machine has, so that a laptop stands for a small board: fewer processors, a share of one, less memory.

Processors are chosen by affinity. A share of one, and memory, are what a control group gives, made directly as root
(version 2 or 1 of cgroups) or asked of systemd. Figures under limits are labelled: another processor's cache, memory
and clock remain the laptop's.
"""

import os
import shutil
from typing import NamedTuple, Self

from hil.errors import ConfigError

ROOT = "/sys/fs/cgroup"
PERIOD_US = 20_000  # of the quota: a process that has used it up waits at most so long
MIB = 1 << 20


class Limits(NamedTuple):
    """`cpus` by number, all if empty; `cpu_share` of one core, `memory_mib`, 0 for no limit."""

    cpus: tuple[int, ...] = ()
    cpu_share: float = 0.0
    memory_mib: float = 0.0

    @property
    def label(self) -> str:
        """In words; empty without limits."""
        words = []
        if self.cpus:
            words.append(f"processor {','.join(map(str, self.cpus))} only")
        if self.cpu_share:
            words.append(f"{self.cpu_share:.0%} of a core")
        if self.memory_mib:
            words.append(f"{self.memory_mib:.0f} MiB")
        return f"limited: {', '.join(words)}" if words else ""


class Confinement:
    """A place for processes under `limits`. Use as a context: the place is gone when it is left, and what was in it
    has to be too.

    `by` says what does it. Raises ConfigError when this machine, or this user, cannot have such limits.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.by = ""
        self._groups: list[str] = []
        self._prefix: tuple[str, ...] = ()
        wrong = set(limits.cpus) - os.sched_getaffinity(0)
        if wrong:
            allowed = ",".join(map(str, sorted(os.sched_getaffinity(0))))
            raise ConfigError(f"no processor {min(wrong)} here; there are: {allowed}")

    def __enter__(self) -> Self:
        if self.limits.cpu_share or self.limits.memory_mib:
            self._confine()
        return self

    def __exit__(self, *_: object) -> None:
        for group in self._groups:
            try:
                os.rmdir(group)
            except OSError:  # a process in it has not been reaped yet; an empty group costs nothing
                continue

    def command(self, command: list[str]) -> list[str]:
        """The same command, confined; its process id is that of the program."""
        if self._groups:
            joins = "".join(f"echo $$ > {group}/cgroup.procs && " for group in self._groups)
            return ["/bin/sh", "-c", f'{joins}exec "$@"', "sh", *command]
        return [*self._prefix, *command]

    def _confine(self) -> None:
        if os.geteuid() == 0 and (os.path.exists(f"{ROOT}/cgroup.controllers") or os.path.isdir(f"{ROOT}/cpu")):
            try:
                self._make_groups()
                return
            except OSError as error:
                reason = f"the control group cannot be made: {error.strerror}: {error.filename}"
        else:
            reason = "needs root, or a systemd that runs scopes for this user (loginctl enable-linger)"
        if not self._ask_systemd():
            raise ConfigError(f"--cpu-quota, --memory: {reason}")

    def _make_groups(self) -> None:
        share, memory = self.limits.cpu_share, round(self.limits.memory_mib * MIB)
        quota = round(share * PERIOD_US)
        if os.path.exists(f"{ROOT}/cgroup.controllers"):
            self.by = "cgroup v2"
            _write(f"{ROOT}/cgroup.subtree_control", "+cpu +memory")
            group = self._make("")
            if share:
                _write(f"{group}/cpu.max", f"{quota} {PERIOD_US}")
            if memory:
                _write(f"{group}/memory.max", str(memory))
            return
        self.by = "cgroup v1"
        if share:
            group = self._make("cpu")
            _write(f"{group}/cpu.cfs_period_us", str(PERIOD_US))
            _write(f"{group}/cpu.cfs_quota_us", str(quota))
        if memory:
            _write(f"{self._make('memory')}/memory.limit_in_bytes", str(memory))

    def _make(self, controller: str) -> str:
        group = os.path.join(ROOT, controller, f"uuv-hil-bench-{os.getpid()}-{id(self):x}")
        os.mkdir(group)
        self._groups.append(group)
        return group

    def _ask_systemd(self) -> bool:
        if not shutil.which("systemd-run") or not os.environ.get("XDG_RUNTIME_DIR"):
            return False
        properties = [f"CPUQuota={self.limits.cpu_share:.0%}"] if self.limits.cpu_share else []
        properties += [f"MemoryMax={round(self.limits.memory_mib * MIB)}"] if self.limits.memory_mib else []
        options = [word for name in properties for word in ("-p", name)]
        self._prefix = ("systemd-run", "--user", "--scope", "--quiet", *options, "--")
        self.by = "systemd"
        return True


def parse_share(text: str) -> float:
    """A share of one core: "25%" or 0.25. Raises ConfigError."""
    try:
        share = float(text[:-1]) / 100 if text.endswith("%") else float(text)
    except ValueError:
        share = 0.0
    if not 0.01 <= share <= 64.0:
        raise ConfigError(f"--cpu-quota {text!r}: expected a share of one core from 1%, such as 25%")
    return share


def parse_memory(text: str) -> float:
    """An amount of memory in MiB: "512M", "1G", "512 MiB". Raises ConfigError."""
    number = text.rstrip("iBMGmg ")
    unit = text[len(number) :].strip().upper()[:1]
    try:
        size = float(number) * {"M": 1.0, "G": 1024.0}[unit]
    except (ValueError, KeyError):
        size = 0.0
    if size < 16.0:
        raise ConfigError(f"--memory {text!r}: expected at least 16M, such as 512M or 1G")
    return size


def parse_cpus(text: str) -> tuple[int, ...]:
    """Processor numbers: "0", "0,2", "0-3". Raises ConfigError."""
    found: set[int] = set()
    try:
        for part in text.split(","):
            first, dash, last = part.partition("-")
            found.update(range(int(first), int(last if dash else first) + 1))
    except ValueError:
        found = set()
    if not found:
        raise ConfigError(f"--cpus {text!r}: expected numbers of processors, such as 0 or 0,2 or 0-3")
    return tuple(sorted(found))


def _write(path: str, text: str) -> None:
    with open(path, "w") as file:
        file.write(text)
