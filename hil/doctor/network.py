"""Check the network: the slave's ports, and the wireless interface."""

from collections.abc import Iterator

from boards.tree import Tree
from hil.common.endpoint import split_endpoint
from hil.common.errors import NetworkError
from hil.doctor.findings import Case, Finding, hexadecimal

LISTENING = "0A"  # TCP_LISTEN in /proc/net/tcp, proc(5)


def network_ports(case: Case) -> Iterator[Finding]:
    """Check whether the two TCP ports that the slave listens on are free."""
    if not case.scenario:
        return
    listen = case.scenario.slave.listen
    try:
        _, _, first = split_endpoint(listen)
    except NetworkError as error:
        yield Finding("problem", "network", str(error))
        return
    taken = listeners(case.tree)
    for port in (first, first + 1):
        if port in taken:
            owner = "".join(f" by process {pid}, {name}" for pid, name in case.tree.openers(f"socket:[{taken[port]}]"))
            remedy = "end it (is the slave running already? systemctl status uuv-hil), or take others: --listen"
            yield Finding("problem", "network", f"port {port} is taken{owner}", remedy)
    if first not in taken and first + 1 not in taken:
        yield Finding(
            "ok", "network", f"{listen} is free" + ("" if case.remote else ", for masters on this machine only")
        )
    if case.remote and case.scenario.security is None:
        text = "anybody who reaches the port can command the vehicle"
        yield Finding("note", "security", text, "uuv-hil keys, and a [security] section in the scenario")


def wlan(case: Case) -> Iterator[Finding]:
    """Check whether a wlan interface saves power between beacons, which delays received data by 0.1 s and more."""
    for name in case.tree.names("/sys/class/net"):
        if not any(case.tree.exists(f"/sys/class/net/{name}/{mark}") for mark in ("wireless", "phy80211")):
            continue
        answer = case.tree.run("iw", "dev", name, "get", "power_save")
        if answer is not None and answer.endswith("on"):
            remedy = f"sudo iw dev {name} set power_save off (uuv-hil board install keeps it off)"
            yield Finding(case.severity if case.remote else "note", "wlan", f"{name} saves power, and is late", remedy)
        elif answer is not None and answer.endswith("off"):
            yield Finding("ok", "wlan", f"{name} does not save power")
        else:
            yield Finding("note", "wlan", f"{name}: power saving cannot be determined", "sudo apt install iw")


def listeners(tree: Tree) -> dict[int, str]:
    """Return the inode of the listening socket of each TCP port that has one."""
    inodes = {}
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in tree.text(table).splitlines()[1:]:
            fields = line.split()
            if len(fields) > 9 and fields[3] == LISTENING:
                port = hexadecimal(fields[1].rpartition(":")[2])
                if port is not None:
                    inodes[port] = fields[9]
    return inodes
