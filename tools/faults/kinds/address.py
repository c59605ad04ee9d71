"""Faults of the machines' addresses and names, in network namespaces."""

import signal
from collections.abc import Callable

from tools.faults.rig import HOST, START_S, Rig
from tools.faults.rows import Fault
from tools.faults.spaces import Network, ip

FIRST, OTHER = 1, 7  # last byte of the slave's addresses
LATE_S = 2.0


def _machines(rig: Rig) -> Network:
    assert rig.machines
    return rig.machines


def _unavailable(rig: Rig) -> str:
    return "" if rig.machines else "needs root and network namespaces (ip netns)"


def _lose_address(rig: Rig) -> None:
    ip("-n", _machines(rig).space("slave"), "address", "flush", "dev", "eth0")


def _get_address(number: int) -> Callable[[Rig], None]:
    """Give the slave an address; its name leads there from now on."""

    def change(rig: Rig) -> None:
        _machines(rig).set_file("planner", "hosts", f"10.77.0.{number} {HOST}\n")
        _machines(rig).set_address("slave", "add", number)

    return change


def _lose_address_and_power(rig: Rig) -> None:
    _lose_address(rig)
    rig.end("slave")


def _start_before_address(rig: Rig) -> None:
    """Start the slave with an address that its machine gets later."""
    rig.start_slave("--listen", f"tcp/10.77.0.{FIRST}:{rig.port}")
    rig.processes["slave"].expect("waiting for it", START_S)
    rig.pause(LATE_S)
    _get_address(FIRST)(rig)


def _lose_name_server(rig: Rig) -> None:
    """End the planner, and let nobody answer for the slave's name."""
    _machines(rig).set_file("planner", "hosts", "")
    rig.signal("planner", signal.SIGKILL)


def _start_without_name_server(rig: Rig) -> None:
    """Start a planner with an endpoint whose name nobody resolves, and with the slave's address."""
    rig.end("planner")
    endpoints = [f"tcp/{host}:{rig.port}" for host in (HOST, f"10.77.0.{FIRST}")]
    rig.start_planner("planner", endpoint=",".join(endpoints))
    rig.instruct("astern")


FAULTS = (
    Fault("address", "slave's address changed", _lose_address, _get_address(OTHER), unavailable=_unavailable),
    Fault("address", "slave's address late", _lose_address_and_power, _start_before_address, unavailable=_unavailable),
    Fault("address", "name server dead, new planner", _lose_name_server, _start_without_name_server, hold_s=0.0,
          unavailable=_unavailable),
)  # fmt: skip
