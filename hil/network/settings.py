"""Make the zenoh configuration of a session: endpoints, retries, leases, buffer sizes.

The numbers were found by measuring: two TCP links by priority with small send buffers and small batches, because
the kernel's buffer, and no queue of the library, is what a command waits in behind a picture (still smaller ones starve
a link that loses packets); a lease under a second. Through a router it is one link: of two, one in seven did not carry
anything any more after a router had been out of reach.
"""

import os
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from hil.common.endpoint import no_certificates, split_endpoint, validate_endpoint
from hil.common.errors import ConfigError
from hil.common.schema import Range
from hil.network.role import Role

if TYPE_CHECKING:
    from hil.network.security import Security

SEND_BUFFER = 16384  # bytes
NEW_SEND_BUFFER = 1 << 20  # of a router's link as long as it is new, see hil.network.router_links
BATCH = 8192  # bytes
KEEP_ALIVES = 4  # a lease
FIRST_RETRY_MS = 20
ROUTER_WAIT_MS = 5000  # that a master waits for a router to begin with
CLIENT_WAIT_MS = 500  # that one attempt of a client takes at most
# Bytes that one message to a role may have.
LARGEST = dict.fromkeys(("master", "planner", "client", "router"), 1 << 26) | {"slave": 1 << 20, "imaging": 1 << 20}
LARGEST_PICTURE = 1 << 26  # which a slave gets from its imaging process
# Where all but masters ping a slave, and how many of them a second it lets in over each link: what is beyond costs it
# next to nothing. Not behind a router, where they share a link, and one that comes just after another would be lost.
PINGS = "uuv_hil/*/ping"  # as in hil.network.tokens, which is not loaded before the vehicle is ready
PINGS_HZ = 250.0
# That a large message may take on a slow network (one of n batches at most 2^n ms), before the rest is left out.
LARGE_WAIT_US = 1_000_000
SAMPLE_WAIT_US = 5_000
# Messages with the priority of commands that may wait for the library's thread that sends, one a batch; 2 otherwise.
# On a busy machine that comes 0.3 s late now and then, and a recorder would not hear of the commands meanwhile.
URGENT_BATCHES = 16
# That what must not be left out, a recording that is played, waits for a network that takes nothing, before the link
# is closed; 5 s otherwise, in which nobody could end it.
STUCK_WAIT_US = 1_000_000


class Network(NamedTuple):
    """Settings of how slave and masters connect and notice a loss.

    `mode`: "direct": the slave listens, masters dial it. "routed": all dial a router in between, `uuv-hil router`,
    which forwards; the slave dials it at `router`, and does not need it to start; a master does.
    `discovery`: the slave answers masters that look for it by multicast. A peer from which nothing has come for
    `lease` is lost. `retry` is the longest pause between attempts to connect, `open_timeout` what one may take.
    `command_rate`: commands a second that a slave takes in; what is beyond it is dropped.
    """

    mode: Literal["direct", "routed"] = "direct"
    router: str = ""
    discovery: bool = False
    lease: Annotated[float, Range(0.2, 60.0, "s")] = 0.8
    retry: Annotated[float, Range(0.02, 10.0, "s")] = 0.05
    open_timeout: Annotated[float, Range(0.05, 10.0, "s")] = 0.3
    command_rate: Annotated[float, Range(1.0, 5000.0, "Hz")] = 200.0

    def validate(self) -> str | None:
        """Return why `mode` and `router` do not fit, or None."""
        if (self.mode == "routed") != bool(self.router):
            return 'mode = "routed" and router = "tcp/HOST:PORT" go together'
        return validate_endpoint("router", self.router) if self.router else None


def endpoints(endpoint: str, secure: bool = False, one: bool = False, send_buffer: int = SEND_BUFFER) -> list[str]:
    """Return the two links of "tcp/HOST:PORT": urgent traffic on PORT, the rest on PORT + 1; or `one` for all.

    With `secure` they are TLS, whatever the scheme says. `send_buffer` (bytes) is the kernel's. Raises NetworkError
    when the endpoint is not of this form, ConfigError when it asks for TLS without certificates.
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
) -> str:
    """Return the configuration of a session, as text for the library. Raises NetworkError, ConfigError.

    `pictures`: a slave passes on those of its imaging process.
    """
    buffer = NEW_SEND_BUFFER if role == "router" else SEND_BUFFER
    how = security is not None, role == "router" or network.mode == "routed", buffer
    table: dict[str, Any] = {
        "mode": _mode(role, network),
        "listen": {"endpoints": [link for endpoint in listen for link in endpoints(endpoint, *how)]},
        "connect": {
            "endpoints": [link for endpoint in connect for link in endpoints(endpoint, *how)],
            "retry": {
                "period_init_ms": FIRST_RETRY_MS,
                "period_max_ms": _milliseconds(network.retry),
                "period_increase_factor": 2,
            },
        },
        "scouting": {
            "delay": 0,  # half a second, otherwise
            # Found, not connected to: only masters dial.
            "multicast": {
                "enabled": network.discovery and role in ("slave", "router"),
                "autoconnect": {"peer": [], "router": []},
            },
            "gossip": _gossip(role, security),
        },
        "timestamping": {"enabled": role == "router"},  # what latched topics need is a number; a slave saves the time
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
    """Return the settings of links; `one` for all priorities."""
    tx: dict[str, Any] = {"lease": _milliseconds(network.lease), "keep_alive": KEEP_ALIVES, "batch_size": BATCH}
    if role in ("slave", "imaging"):  # in a router what comes behind a large message would wait too
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
    """Add certificates and, where others dial us, what they may do. Raises NetworkError."""
    from hil.network.security import access, planner_access, tls  # no session without certificates pays for it

    machine: Role = "slave" if role == "imaging" else role
    table["transport"]["link"] |= {"tls": tls(security.folder(machine)), "protocols": ["tls"]}
    if role == "imaging":  # it dials its own machine, whose name there need not be in the certificate
        table["transport"]["link"]["tls"]["verify_name_on_connect"] = False
    elif role in ("slave", "router"):
        table["access_control"] = access(security)
    elif role == "planner":
        table["access_control"] = planner_access(security)


def _mode(role: Role, network: Network) -> str:
    """Return what the library calls it. Only one that is a router to the library tells ROS 2 contexts of each other.

    And only what comes from a router or a client is passed on to the peers of another router, as ROS 2 contexts are.
    """
    if role in ("slave", "router"):
        return "router"
    if network.mode == "routed":
        return "router" if role == "imaging" else "client"  # the pictures' process starts without a router, too
    return "peer" if role in ("master", "planner") else "client"


def _gossip(role: Role, security: "Security | None") -> dict[str, Any]:
    """Return the settings of gossip, by which our clients learn about each other and connect directly.

    ROS 2 contexts need it: their messages go from one to the other, and through no router. None of ours ever dials
    whose addresses it gets. Under TLS gossip is off: who may not listen must not learn who is there, and what goes past
    the vehicle, or the router, is not under its access control.
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
    """Let as few of the library's threads as a slave needs read; before the process's first session is opened.

    Little comes in: one thread reads it, and waits for it, where by default each message wakes one that wakes another.
    A second one where there are pictures to forward: a thread that does may wait a second for room on the way out, and
    those that accept connections and look what comes on them are then kept apart. What the environment says does not
    hold: with a recorder's single thread the slave would pass on no message of several batches, such as a sonar's.
    """
    few = "(rx: (worker_threads: 2))" if pictures else "(rx: (worker_threads: 1), acc: (handover: rx))"
    os.environ["ZENOH_RUNTIME"] = few


def json5(value: Any) -> str:
    """Return plain values as JSON5; the json module would cost 2 ms of every start."""
    if isinstance(value, dict):
        return "{" + ",".join([f"{key!r}:{json5(item)}" for key, item in value.items()]) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ",".join([json5(item) for item in value]) + "]"
    return {True: "true", False: "false"}[value] if isinstance(value, bool) else repr(value)


def _milliseconds(seconds: float) -> int:
    return round(seconds * 1000)
