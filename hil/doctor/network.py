"""Check the network: the slave's ports, and the wireless interface."""

from collections.abc import Iterator

from boards.resources import describe_process, find_listeners
from hil.common.endpoint import split_endpoint
from hil.common.errors import NetworkError
from hil.doctor.findings import Case, Finding


def check_network_ports(case: Case) -> Iterator[Finding]:
    """Check whether the two TCP ports that the slave listens on are free."""
    if not case.scenario:
        return
    listen = case.scenario.slave.listen
    try:
        _, _, first = split_endpoint(listen)
    except NetworkError as error:
        yield Finding("problem", "network", str(error))
        return
    listeners = find_listeners(case.tree)
    if listeners is None:
        yield Finding("note", "network", f"whether port {first} is free cannot be determined: no /proc/net/tcp")
        return
    ports = [port for port in (first, first + 1) if port in listeners]
    for port in ports:
        pid = listeners[port]
        owner = "" if pid is None else f" by {describe_process(case.tree, pid)}"
        remedy = "end it (if the slave runs already, see: systemctl status uuv-hil), or use other ports: --listen"
        yield Finding("problem", "network", f"port {port} is used{owner}", remedy)
    if not ports:
        scope = "" if case.remote else ", for masters on this machine only"
        yield Finding("ok", "network", f"{listen} is free{scope}")


def check_security(case: Case) -> Iterator[Finding]:
    """Check whether the scenario has certificates if masters on other machines are expected."""
    if case.remote and case.scenario and case.scenario.security is None:
        text = "anyone who can connect to the port can command the vehicle"
        yield Finding(
            "note", "security", text, "make certificates with uuv-hil keys, and add [security] to the scenario"
        )


def check_wlan(case: Case) -> Iterator[Finding]:
    """Check whether a wlan interface saves power between beacons, which delays received data by 0.1 s or more."""
    for name in case.tree.names("/sys/class/net"):
        if not any(case.tree.exists(f"/sys/class/net/{name}/{mark}") for mark in ("wireless", "phy80211")):
            continue
        output = case.tree.run("iw", "dev", name, "get", "power_save")
        if output is not None and output.endswith("on"):
            remedy = f"sudo iw dev {name} set power_save off (uuv-hil board install keeps it off)"
            yield Finding(
                case.severity if case.remote else "note",
                "wlan",
                f"{name}: power saving is on, which delays messages",
                remedy,
            )
        elif output is not None and output.endswith("off"):
            yield Finding("ok", "wlan", f"{name}: power saving is off")
        else:
            yield Finding("note", "wlan", f"{name}: power saving cannot be determined", "sudo apt install iw")
