"""Read the state of the board once a second: temperature, throttling, load, memory, network.

It is read from /proc and /sys, because psutil would lengthen the slave's start (hil/slave/usage.py).
"""

import os
from typing import TYPE_CHECKING

from boards.health import temperature, throttling
from boards.tree import Tree
from hil.ros.diagnostics import Diagnostics

if TYPE_CHECKING:
    from boards import Board

UNITS = "/etc/systemd/system"
WITHOUT_PROCESS = ("can", "firewall", "module")  # units of `uuv-hil board install` that prepare the board
GROUPS = ("/sys/fs/cgroup/system.slice", "/sys/fs/cgroup/systemd/system.slice")  # of the second and the first version


def add_machine_figures(figures: Diagnostics, tree: Tree, board: "Board | None") -> None:
    """Add figures of the machine to the diagnostics, as far as the machine provides them.

    Throttling is read from the kernel only. To ask the firmware of a Raspberry Pi takes a new process, which a
    real-time process should not start every second (`uuv-hil doctor` does ask).
    """
    throttle = throttling(tree, board, ask_firmware=False)
    celsius = temperature(tree, board)
    if celsius is not None:
        figures.temperature_c = celsius
    if throttle.now or throttle.known:
        figures.throttled = "; ".join(throttle.now) or "no"
    kilohertz = tree.number("/sys/devices/system/cpu/cpu0/cpufreq/scaling_cur_freq")
    if kilohertz:
        figures.cpu_mhz = kilohertz / 1000.0
    figures.load_1min = os.getloadavg()[0]
    available_kib = _memory_available_kib(tree)
    if available_kib:
        figures.memory_available_mib = available_kib / 1024
    figures.network_received_bytes, figures.network_sent_bytes = network_bytes(tree)
    if services := services_beside(tree):
        missing = [name for name, runs in services.items() if not runs]
        figures.services = f"not running: {', '.join(missing)}" if missing else "running"


def services_beside(tree: Tree) -> dict[str, bool]:
    """Return the services that are installed beside the slave, and whether each runs: then it has a control group."""
    units = [name for name in tree.names(UNITS) if name.startswith("uuv-hil-") and name.endswith(".service")]
    names = {unit: unit.removeprefix("uuv-hil-").removesuffix(".service") for unit in units}
    return {
        name: any(tree.exists(f"{group}/{unit}") for group in GROUPS)
        for unit, name in names.items()
        if name not in WITHOUT_PROCESS
    }


def network_bytes(tree: Tree) -> tuple[int, int]:
    """Return the bytes that all interfaces, loopback included, have received and sent since the machine started."""
    received = sent = 0
    for line in tree.text("/proc/net/dev").splitlines():
        _, colon, rest = line.partition(":")
        fields = rest.split()
        if colon and len(fields) >= 9 and fields[0].isdecimal():
            received, sent = received + int(fields[0]), sent + int(fields[8])
    return received, sent


def _memory_available_kib(tree: Tree) -> int:
    """Return the available memory (KiB); 0 where the kernel does not report it."""
    for line in tree.text("/proc/meminfo").splitlines():
        name, _, value = line.partition(":")
        if name == "MemAvailable":
            kib = value.partition("kB")[0].strip()
            return int(kib) if kib.isdecimal() else 0
    return 0
