"""How the machine below the slave is doing: temperature, throttling, load, memory, network. Once a second is cheap."""

import os
from typing import TYPE_CHECKING

from boards.health import temperature, throttling
from boards.tree import Tree

if TYPE_CHECKING:
    from boards import Board


def machine_figures(tree: Tree, board: "Board | None") -> dict[str, str]:
    """For the diagnostics; without what this machine does not tell.

    Throttling is what the kernel knows: to ask a Raspberry Pi's firmware itself takes a process of its own, which
    a real-time process does not start every second (`uuv-hil doctor` does).
    """
    slow = throttling(tree, board, ask_firmware=False)
    warm = temperature(tree, board)
    megahertz = tree.number("/sys/devices/system/cpu/cpu0/cpufreq/scaling_cur_freq")
    figures = {
        "temperature_c": f"{warm:.1f}" if warm is not None else "",
        "throttled": "; ".join(slow.now) or ("no" if slow.known else ""),
        "cpu_mhz": f"{megahertz / 1000.0:.0f}" if megahertz else "",
        "load_1min": f"{os.getloadavg()[0]:.2f}",
        "memory_available_mib": _memory_available_mib(tree),
    }
    received, sent = network_bytes(tree)
    figures |= {"network_received_bytes": str(received), "network_sent_bytes": str(sent)}
    return {name: value for name, value in figures.items() if value}


def network_bytes(tree: Tree) -> tuple[int, int]:
    """What all interfaces of the machine have received and sent since it started, loopback too."""
    received = sent = 0
    for line in tree.text("/proc/net/dev").splitlines():
        _, colon, rest = line.partition(":")
        fields = rest.split()
        if colon and len(fields) >= 9 and fields[0].isdecimal():
            received, sent = received + int(fields[0]), sent + int(fields[8])
    return received, sent


def _memory_available_mib(tree: Tree) -> str:
    for line in tree.text("/proc/meminfo").splitlines():
        name, _, value = line.partition(":")
        if name == "MemAvailable":
            kib = value.partition("kB")[0].strip()
            return f"{int(kib) / 1024:.0f}" if kib.isdecimal() else ""
    return ""
