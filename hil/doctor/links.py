"""Check the thruster link: the serial port or CAN bus, and other programs that use it."""

import json
import os
import stat
from collections.abc import Iterator
from typing import Any

from boards.resources import describe_process, find_openers
from boards.tree import Tree
from hil.common.errors import ConfigError, MissingExtraError
from hil.doctor.findings import Case, Finding, User, accounts, may_open, parse_hexadecimal
from hil.links.address import parse_address

MAX_PORTS = 4  # in a remedy; a PC has 32


def check_serial_port(case: Case) -> Iterator[Finding]:
    """Check whether the link's serial port exists, and may be opened."""
    device, tree = case.device, case.tree
    if not device:
        return
    real = tree.resolve(device)
    name = device if real == device else f"{device} ({real})"
    status = _status(tree, real)
    if status is None:
        yield Finding(case.severity, "serial port", f"{name} does not exist", _missing_port_remedy(case, device, real))
    elif not may_open(status, case.user):
        remedy = permission_remedy(tree, status, case.user)
        mode = f"{stat.filemode(status.st_mode)}, user {status.st_uid}, group {status.st_gid}"
        yield Finding(case.severity, "serial port", f"{name}: no permission for {case.user.name} ({mode})", remedy)
    else:
        yield Finding("ok", "serial port", f"{name}: {case.user.name} may open it")


def check_console(case: Case) -> Iterator[Finding]:
    """Check whether the kernel or a login prompt writes to the link's serial port, where the STM32 would receive it."""
    tree = case.tree
    if not case.device:
        return
    real = os.path.basename(tree.resolve(case.device))
    words = [word.removeprefix("console=").partition(",")[0] for word in tree.text("/proc/cmdline").split()
             if word.startswith("console=") and word.isprintable()]  # fmt: skip
    consoles = {os.path.basename(tree.resolve(f"/dev/{word}")) for word in words}
    consoles |= set(tree.text("/sys/class/tty/console/active").split())
    if real in consoles:
        where = "/boot/firmware/cmdline.txt" if tree.exists("/boot/firmware") else "set by the boot loader"
        remedy = f"remove console={real} (or serial0) from the kernel's command line ({where}) and restart"
        yield Finding(case.severity, "console", f"the kernel's console is on {real}", remedy)
    for service in _login_services(tree, real):
        text = f"a login prompt is on {real}: {service}"
        yield Finding(case.severity, "console", text, f"sudo systemctl disable --now {service}")


def check_port_users(case: Case) -> Iterator[Finding]:
    """Check whether another process has the link's serial port open."""
    if not case.device:
        return
    real = case.tree.resolve(case.device)
    pids = find_openers(case.tree, real)
    for pid in pids:
        text = f"{real} is open in {describe_process(case.tree, pid)}"
        yield Finding(
            case.severity,
            "port in use",
            text,
            f"end it: kill {pid}; if it is a service (systemctl status {pid}), stop that",
        )
    status = _status(case.tree, real)
    if case.tree.live and os.geteuid() != 0 and not pids and status and may_open(status, case.user):
        text = f"none of your processes has {real} open; only root sees those of other users"
        yield Finding("note", "port in use", text, f"run the same command with sudo and --user {case.user.name}")


def check_speed(case: Case) -> Iterator[Finding]:
    """Check whether the link's line rate is sufficient for the commands of the scenario."""
    scenario = case.scenario
    if not scenario or scenario.controller != "builtin":
        return
    from hil.slave.drivers.ends import check_line_rate
    from sim.vehicle.vehicle import load_vehicle

    link = scenario.link._replace(port=case.device or scenario.link.port)
    try:
        check_line_rate(link, len(load_vehicle(scenario.vehicle)[0].channels), 1.0 / scenario.slave.control_period)
    except ConfigError as error:
        yield Finding("problem", "line rate", str(error))  # it names the remedy
    except MissingExtraError:
        return  # `check_packages` reports the missing package


def check_can_bus(case: Case) -> Iterator[Finding]:
    """Check whether the link's CAN interface exists, is up, and has the right bit rate and state."""
    address = parse_address(case.scenario.link.port) if case.scenario else None
    if not case.scenario or not address or address.interface != "socketcan":
        return
    name, rate = address.target, case.scenario.link.bitrate
    if not case.tree.exists(f"/sys/class/net/{name}"):
        steps = [bus.needs for bus in case.board.can if bus.interface == name] if case.board else []
        yield Finding(
            "problem", "CAN", f"{name} does not exist", steps[0] if steps else "connect the adapter; see: ip link"
        )
        return
    up = f"sudo ip link set {name} up type can bitrate {rate}"
    flags = parse_hexadecimal(case.tree.text(f"/sys/class/net/{name}/flags"))
    if flags is None:
        yield Finding("note", "CAN", f"whether {name} is up cannot be determined")
        return
    if not flags & 1:  # IFF_UP, netdevice(7)
        yield Finding("problem", "CAN", f"{name} is down", f"{up} (uuv-hil board install does it at each start)")
        return
    yield from _can_details(case.tree, name, rate, up)


def _can_details(tree: Tree, name: str, rate: int, up: str) -> Iterator[Finding]:
    """Check bit rate and state of an interface that is up, as the kernel's netlink reports them."""
    try:
        details = json.loads(tree.run("ip", "-details", "-json", "link", "show", name) or "")[0]
    except (ValueError, LookupError, TypeError, RecursionError):
        details = None
    link = _json_object(details, "linkinfo")
    kind, data = link.get("info_kind"), _json_object(link, "info_data")
    if kind and kind != "can":
        yield Finding("ok", "CAN", f"{name} is up; an interface of the kind {kind} has no bit rate")
        return
    bitrate, state = _json_object(data, "bittiming").get("bitrate"), data.get("state")
    if bitrate is None or state is None:
        yield Finding("note", "CAN", f"{name} is up; bit rate and state are unknown", "sudo apt install iproute2")
    if bitrate not in (None, rate):
        remedy = f"sudo ip link set {name} down; {up}; or [link] bitrate = {bitrate}"
        yield Finding("problem", "CAN", f"{name} runs at {bitrate} bit/s, but the scenario has {rate}", remedy)
    if state not in (None, "ERROR-ACTIVE"):
        remedy = "check: one bit rate at both ends, CAN-H and CAN-L not swapped, 120 ohms at each end, STM32 powered"
        # Separate from the bit rate: a driver without restart-ms (gs_usb) would refuse the whole command.
        restart = f"sudo ip link set {name} down; sudo ip link set {name} type can restart-ms 100 (if the driver can)"
        remedy += f"; then {restart}; {up}" if state == "BUS-OFF" else ""
        yield Finding("problem", "CAN", f"{name} is in the state {state}", remedy)
    if bitrate == rate and state == "ERROR-ACTIVE":
        yield Finding("ok", "CAN", f"{name} is up at {rate} bit/s, {state}")


def _json_object(value: Any, key: str) -> dict[str, Any]:
    """Return the JSON object under `key`; empty if it is no object."""
    inner = value.get(key) if isinstance(value, dict) else None
    return inner if isinstance(inner, dict) else {}


def permission_remedy(tree: Tree, status: os.stat_result, user: User) -> str:
    """Return how `user` may open a device: by joining its group if that may read and write, else by a udev rule.

    The group of root is never proposed.
    """
    names = {row.number: row.name for row in accounts(tree, "/etc/group")}
    group = names.get(status.st_gid, "") if status.st_gid and status.st_mode >> 3 & 6 == 6 else ""
    join = f"sudo usermod -aG {group or 'dialout'} {user.name}, then log in again"
    return join if group else f"uuv-hil board install assigns it to the group dialout, by a udev rule; {join}"


def _missing_port_remedy(case: Case, device: str, real: str) -> str:
    """Return the remedy for a missing serial port: the steps that the board needs, or another port of its kind."""
    port = next((port for port in case.board.serial if port.device == device), None) if case.board else None
    if port and port.needs:
        return port.needs
    kind = _kind(os.path.basename(real))
    others = [f"/dev/{name}" for name in case.tree.names("/dev") if _kind(name) == kind][:MAX_PORTS]
    if others:
        remedy = f'there is {", ".join(others)}: [link] port = "{others[0]}"'
    else:
        remedy = "see: sudo dmesg | grep tty" if port else "connect it; see: ls /dev/serial/by-id/"
    return f"{remedy} ({port.at})" if port else remedy


def _kind(name: str) -> str:
    return name.rstrip("0123456789")


def _login_services(tree: Tree, tty: str) -> list[str]:
    """Return the services that are enabled and open a login prompt on a serial port."""
    wanted = [
        name
        for folder in tree.names("/etc/systemd/system")
        if folder.endswith(".wants")
        for name in tree.names(f"/etc/systemd/system/{folder}")
    ]
    # nvgetty's script chooses its port among those that exist.
    jetson = tty.startswith("ttyTHS") and tree.exists(f"/dev/{tty}")
    services = [f"serial-getty@{tty}.service", *(["nvgetty.service"] if jetson else [])]
    return [service for service in services if service in wanted]


def _status(tree: Tree, device: str) -> os.stat_result | None:
    try:
        return os.stat(tree.path(device))
    except OSError:
        return None
