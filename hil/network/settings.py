"""Make the zenoh configuration of a session: endpoints, retries, leases, buffer sizes.

The values were found by measurement. Two TCP links, split by priority, have small send buffers and small batches,
because a command waits behind a picture in the kernel's send buffer, not in a queue of the library. Still smaller
buffers starve a link with packet loss. The lease is below 1 s. Through a router there is one link: with two, one in
seven carried nothing any more after the router had been unreachable.
"""

import os
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from hil.common.endpoint import no_certificates, split_endpoint, validate_endpoint
from hil.common.errors import ConfigError
from hil.common.schema import Range
from hil.network.tokens import Role

if TYPE_CHECKING:
    from hil.network.security import Security

SEND_BUFFER = 16384  # bytes
NEW_SEND_BUFFER = 1 << 20  # bytes, of a router's link while it is new, see workarounds.blocked_router
BATCH = 8192  # bytes
KEEP_ALIVES = 4  # in one lease
FIRST_RETRY_MS = 20
ROUTER_WAIT_MS = 5000  # a master's wait for the router at its start
# How to listen at an address that is not there yet: in the background.
LATE: dict[str, Any] = {
    "timeout_ms": -1,
    "exit_on_failure": False,
    "retry": {"period_init_ms": 500, "period_max_ms": 500, "period_increase_factor": 1},
}
CLIENT_WAIT_MS = 500  # limit of one attempt of a client to connect
# Limit of one message to a role, in bytes.
LARGEST = dict.fromkeys(("master", "planner", "client", "router"), 1 << 26) | {"slave": 1 << 20, "imaging": 1 << 20}
LARGEST_PICTURE = 1 << 26  # bytes, limit of a message from the imaging process to its slave
# Key of the pings to a slave, masters' excepted, and the rate limit for each link: further pings cost the slave almost
# nothing. Not behind a router, where all pings share a link and one that follows another closely would be lost.
PINGS = "uuv_hil/*/ping"  # as in hil.network.tokens, which is not loaded before the vehicle is ready
PINGS_HZ = 250.0
# How long a large message may wait on a slow network before the rest of it is dropped (batch n waits at most 2^n ms).
LARGE_WAIT_US = 1_000_000
SAMPLE_WAIT_US = 5_000
# Batches of command priority that may wait for the library's sending thread, one message each; the default is 2. On a
# busy machine that thread is sometimes 0.3 s late, and a recorder would miss the commands of that time.
URGENT_BATCHES = 16
# How long a message that must not be dropped, as of a replayed recording, waits for a blocked network before the link
# is closed. The default is 5 s, during which the process could not be stopped.
STUCK_WAIT_US = 1_000_000


class Network(NamedTuple):
    """Settings of how slave and masters connect and detect a loss.

    `mode`: "direct": the slave listens, masters connect to it. "routed": all connect to a router in between, `uuv-hil
    router`, which forwards. The slave connects to it at `router` and starts without it; a master needs it to start.
    `discovery`: the slave answers masters that search by multicast. A peer that sent nothing for `lease` is lost.
    `retry` is the longest pause between attempts to connect, `open_timeout` the limit of one attempt. `command_rate`:
    commands a second that a slave accepts; further ones are dropped.
    """

    mode: Literal["direct", "routed"] = "direct"
    router: str = ""
    discovery: bool = False
    lease: Annotated[float, Range(0.2, 60.0, "s")] = 0.8
    retry: Annotated[float, Range(0.02, 10.0, "s")] = 0.05
    open_timeout: Annotated[float, Range(0.05, 10.0, "s")] = 0.3
    command_rate: Annotated[float, Range(1.0, 5000.0, "Hz")] = 200.0

    def validate(self) -> str | None:
        """Return why `mode` and `router` do not fit together, or None."""
        if (self.mode == "routed") != bool(self.router):
            return 'mode = "routed" and router = "tcp/HOST:PORT" go together'
        return validate_endpoint("router", self.router) if self.router else None


def endpoints(endpoint: str, secure: bool = False, one: bool = False, send_buffer: int = SEND_BUFFER) -> list[str]:
    """Return the two links of "tcp/HOST:PORT": urgent traffic on PORT, the rest on PORT + 1; or `one` link for all.

    With `secure` the links use TLS, whatever the scheme is. `send_buffer` (bytes) is the kernel's. Raises NetworkError
    if the endpoint does not have this form, ConfigError if it requests TLS without certificates.
    """
    if not secure and (problem := no_certificates(endpoint)):
        raise ConfigError(problem)
    _, host, port = split_endpoint(endpoint)
    scheme, buffer = "tls" if secure else "tcp", f"#so_sndbuf={send_buffer}"
    if one:
        return [f"{scheme}/{host}:{port}{buffer}"]
    return [f"{scheme}/{host}:{port}?prio=1-3{buffer}", f"{scheme}/{host}:{port + 1}?prio=4-7{buffer}"]


def settings(
    role: Role,
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    network: Network,
    security: "Security | None",
    pictures: bool = False,
    is_late: bool = False,
) -> str:
    """Return a session's configuration as text for zenoh. Raises NetworkError, ConfigError.

    `pictures`: the slave forwards the samples of its imaging process. `is_late`: wait for the address to listen at.
    """
    buffer = NEW_SEND_BUFFER if role == "router" else SEND_BUFFER
    how = security is not None, role == "router" or network.mode == "routed", buffer
    table: dict[str, Any] = {
        "mode": _mode(role, network),
        "listen": {"endpoints": [link for endpoint in listen for link in endpoints(endpoint, *how)]}
        | (LATE if is_late else {}),
        "connect": {
            "endpoints": [link for endpoint in connect for link in endpoints(endpoint, *how)],
            "retry": {
                "period_init_ms": FIRST_RETRY_MS,
                "period_max_ms": _milliseconds(network.retry),
                "period_increase_factor": 2,
            },
        },
        "scouting": {
            "delay": 0,  # the default is 0.5 s
            "multicast": {"enabled": False},  # hil.network.responder answers
            "gossip": _gossip(role, security),
        },
        # Of a client: the times of arrival. Latched topics need sequence numbers only, so a slave has none.
        "timestamping": {"enabled": role in ("router", "client")},
        "transport": _transport(role, network, how[1], pictures),
    }
    if table["mode"] == "client":
        wait_ms = CLIENT_WAIT_MS if role in ("client", "imaging") else ROUTER_WAIT_MS
        table["connect"] |= {"timeout_ms": wait_ms, "exit_on_failure": True}
    if role == "slave" and network.mode == "direct":
        rules = [{"key_expr": PINGS, "freq": PINGS_HZ}]
        table["downsampling"] = [{"messages": ["put", "delete"], "flows": ["ingress"], "rules": rules}]
    if security:
        _secure(table, role, security)
    return json5(table)


def _transport(role: Role, network: Network, one: bool, pictures: bool) -> dict[str, Any]:
    """Return the settings of links; `one` link for all priorities, or two."""
    tx: dict[str, Any] = {"lease": _milliseconds(network.lease), "keep_alive": KEEP_ALIVES, "batch_size": BATCH}
    if role in ("slave", "imaging"):  # not in a router, where other messages would wait behind a large one
        drop = {"wait_before_drop": SAMPLE_WAIT_US, "max_wait_before_drop_fragments": LARGE_WAIT_US}
        block = {"wait_before_close": STUCK_WAIT_US}
        size = {"real_time": URGENT_BATCHES}
        tx["queue"] = {"congestion_control": {"drop": drop, "block": block}, "size": size}
    return {
        "unicast": {
            "max_links": 1 if one else 2,
            "open_timeout": _milliseconds(network.open_timeout),
            "accept_timeout": _milliseconds(network.open_timeout),
        },
        "link": {"tx": tx, "rx": {"max_message_size": LARGEST_PICTURE if pictures else LARGEST[role]}},
        "shared_memory": {"enabled": False},
    }


def _secure(table: dict[str, Any], role: Role, security: "Security") -> None:
    """Add certificates, and access control where others connect to us. Raises NetworkError."""
    from hil.network.security import access, planner_access, tls  # not loaded by sessions without certificates

    machine: Role = "slave" if role == "imaging" else role
    table["transport"]["link"] |= {"tls": tls(security.folder(machine)), "protocols": ["tls"]}
    if role == "imaging":  # it connects to its own machine by an address that need not be in the certificate
        table["transport"]["link"]["tls"]["verify_name_on_connect"] = False
    elif role in ("slave", "router"):
        table["access_control"] = access(security)
    elif role == "planner":
        table["access_control"] = planner_access(security)


def _mode(role: Role, network: Network) -> str:
    """Return zenoh's mode for a role.

    Only a "router" announces ROS 2 contexts to each other. Only data from a router or client is forwarded to the peers
    of another router, which ROS 2 contexts are.
    """
    if role in ("slave", "router"):
        return "router"
    if network.mode == "routed":
        return "router" if role == "imaging" else "client"  # the imaging process has to start without a router too
    return "peer" if role in ("master", "planner") else "client"


def _gossip(role: Role, security: "Security | None") -> dict[str, Any]:
    """Return the settings of gossip, by which clients learn of each other's addresses and connect directly.

    ROS 2 contexts need it: their messages go directly, through no router. Our own sessions never connect to such
    addresses. With TLS gossip is off: a machine without rights must not learn of the others, and direct traffic would
    bypass the access control of the vehicle or router.
    """
    if role not in ("slave", "router") or security:
        return {"enabled": False}
    return {
        "enabled": True,
        "multihop": False,
        "target": {"router": ["router", "peer"]},
        "autoconnect": {"router": []},
    }


def save_threads(pictures: bool) -> None:
    """Limit the library's reading threads to what a slave needs; call before the first session is opened.

    A slave receives little: one thread waits and reads, whereas by default each message wakes one thread that wakes
    another. With `pictures` there are two, because a thread that forwards one may wait a second for the output; the
    threads that accept connections are then separate. A value in the environment is overwritten: with the single thread
    of a recorder, the slave would forward no message of several batches, such as a sonar's.
    """
    few = "(rx: (worker_threads: 2))" if pictures else "(rx: (worker_threads: 1), acc: (handover: rx))"
    os.environ["ZENOH_RUNTIME"] = few


def json5(value: Any) -> str:
    """Return plain values as JSON5; the json module would lengthen every start by 2 ms."""
    if isinstance(value, dict):
        return "{" + ",".join([f"{key!r}:{json5(item)}" for key, item in value.items()]) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ",".join([json5(item) for item in value]) + "]"
    return {True: "true", False: "false"}[value] if isinstance(value, bool) else repr(value)


def _milliseconds(seconds: float) -> int:
    return round(seconds * 1000)
