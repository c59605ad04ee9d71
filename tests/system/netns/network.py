"""Machines of a test: network namespaces at one switch, whose links can be unplugged."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, Any

from tests.support.processes import ROOT

_made = 0


def _port(machine: str) -> str:
    """Return the device at the switch that a machine is plugged into."""
    return f"to-{machine}"


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


class Network:
    """Namespaces called like `machines`, with addresses 10.77.0.1 and on. Use as a context."""

    def __init__(self, *machines: str) -> None:
        global _made  # noqa: PLW0603 - names of namespaces are the machine's, not the test's
        _made += 1
        self._prefix = f"t{os.getpid() % 10000}x{_made}"
        self._machines = machines
        self._running: list[subprocess.Popen[Any]] = []

    def __enter__(self) -> "Network":
        try:
            self._build()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _build(self) -> None:
        switch = self.space("switch")
        ip("netns", "add", switch)
        ip("-n", switch, "link", "add", "switch", "type", "bridge", "forward_delay", "0")
        ip("-n", switch, "link", "set", "switch", "up")
        for number, machine in enumerate(self._machines, 1):
            space = self.space(machine)
            ip("netns", "add", space)
            ip("-n", space, "link", "add", "eth0", "type", "veth", "peer", "name", _port(machine), "netns", switch)
            ip("-n", space, "address", "add", f"10.77.0.{number}/24", "dev", "eth0")
            for device in ("lo", "eth0"):
                ip("-n", space, "link", "set", device, "up")
            ip("-n", switch, "link", "set", _port(machine), "master", "switch", "up")

    def __exit__(self, *_: object) -> None:
        for process in self._running:
            if process.poll() is None:
                process.kill()
            process.wait()
        for machine in (*self._machines, "switch"):
            subprocess.run(["ip", "netns", "delete", self.space(machine)], capture_output=True)

    def address(self, machine: str) -> str:
        return f"10.77.0.{self._machines.index(machine) + 1}"

    def start(self, machine: str, *arguments: object, output: IO[str] | None = None) -> subprocess.Popen[str]:
        """Start Python with `arguments` on a machine ("": outside all); it ends with the network."""
        inside = ["ip", "netns", "exec", self.space(machine)] if machine else []
        process = subprocess.Popen(
            [*inside, sys.executable, *map(str, arguments)],
            stdout=output or subprocess.DEVNULL,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONPATH": str(ROOT)},
        )
        self._running.append(process)
        return process

    def unplug(self, machine: str) -> None:
        """Disconnect the machine at the switch, so that its own link stays up."""
        ip("-n", self.space("switch"), "link", "set", _port(machine), "nomaster")

    def plug(self, machine: str) -> None:
        ip("-n", self.space("switch"), "link", "set", _port(machine), "master", "switch")

    def set_cable(self, machine: str, is_connected: bool) -> None:
        """Disconnect or connect the cable of the machine, whose link goes down or up."""
        ip("-n", self.space("switch"), "link", "set", _port(machine), "up" if is_connected else "down")

    def space(self, machine: str) -> str:
        """Return the name of its network namespace."""
        return f"{self._prefix}-{machine}"


class Lines:
    """The output of a process, line by line, with the instants at which it was seen; the process writes to `file`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.file = path.open("w")
        self.seen: list[tuple[float, str]] = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def first(self, text: str, after: float, within: float) -> float:
        """Return seconds from `after` until a line with `text` was seen; fails when there is none within the time."""
        while time.monotonic() < after + within + 1.0:
            found = [at for at, line in self.seen if text in line and at >= after]
            if found:
                return found[0] - after
            time.sleep(0.01)
        raise AssertionError(f"no {text!r} within {within} s in {self.seen}")

    def close(self) -> None:
        """Clean up after the process has ended."""
        self.file.close()
        self._reader.join()

    def _read(self) -> None:
        begun = ""
        with self._path.open() as reader:
            while not self.file.closed:
                *whole, begun = (begun + reader.read()).split("\n")
                self.seen += [(time.monotonic(), line) for line in whole]
                time.sleep(0.005)
