"""Machines of a test: network namespaces at one switch, whose links can be unplugged. Needs root and iproute2."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import IO, Any

from hil.common.children import ROOT

_made = 0


def _port(machine: str) -> str:
    """Return the device at the switch that a machine is plugged into."""
    return f"to-{machine}"


def ip(*arguments: str) -> None:
    """Run `ip`. Raises OSError, subprocess.CalledProcessError."""
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


def _settings(space: str) -> Path:
    """Return the folder whose files the programs of a namespace find in /etc, see ip-netns(8)."""
    return Path("/etc/netns", space)


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
            subprocess.run(["ip", "netns", "delete", self.space(machine)], check=False, capture_output=True)
            shutil.rmtree(_settings(self.space(machine)), ignore_errors=True)

    def set_file(self, machine: str, name: str, text: str) -> None:
        """Write a file in the machine's /etc, before its first program starts; later texts are seen by all of them."""
        _settings(self.space(machine)).mkdir(parents=True, exist_ok=True)
        (_settings(self.space(machine)) / name).write_text(text, encoding="utf-8")

    def set_address(self, machine: str, action: str, number: int) -> None:
        """Let the machine lose ("delete") or get ("add") the address 10.77.0.`number`."""
        ip("-n", self.space(machine), "address", action, f"10.77.0.{number}/24", "dev", "eth0")

    def silence_name_server(self, machine: str) -> None:
        """Give the machine a name server that does not answer, before its first program starts."""
        self.set_file(machine, "resolv.conf", "nameserver 10.77.0.99\n")
        silent = ("neighbour", "add", "10.77.0.99", "lladdr", "02:00:00:00:00:99", "dev", "eth0")
        ip("-n", self.space(machine), *silent)

    def inside(self, machine: str) -> list[str]:
        """Return the words before a command that run it on a machine."""
        return ["ip", "netns", "exec", self.space(machine)]

    def address(self, machine: str) -> str:
        """Return the address that the machine has at first."""
        return f"10.77.0.{self._machines.index(machine) + 1}"

    def start(self, machine: str, *arguments: object, output: IO[str] | None = None) -> subprocess.Popen[str]:
        """Start Python with `arguments` on a machine ("": outside all); it ends with the network."""
        inside = self.inside(machine) if machine else []
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
        """Connect the machine again."""
        ip("-n", self.space("switch"), "link", "set", _port(machine), "master", "switch")

    def set_cable(self, machine: str, is_connected: bool) -> None:
        """Disconnect or connect the cable of the machine, whose link goes down or up."""
        ip("-n", self.space("switch"), "link", "set", _port(machine), "up" if is_connected else "down")

    def space(self, machine: str) -> str:
        """Return the name of its network namespace."""
        return f"{self._prefix}-{machine}"
