"""What a session is told: who listens and who dials, how soon a loss is seen, how much may come in.

The numbers were found by measuring: two TCP links by priority with small send buffers and small batches, because
the kernel's buffer, and no queue of the library, is what a command waits in behind a picture (still smaller ones starve
a link that loses packets); a lease under a second. Through a router it is one link: of two, one in seven did not carry
anything any more after a router had been out of reach.
"""

import os
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from hil.errors import NetworkError
from hil.schema import Range

if TYPE_CHECKING:
    from hil.transport.security import Security

SEND_BUFFER = 16384  # bytes
BATCH = 8192  # bytes
KEEP_ALIVES = 4  # a lease
FIRST_RETRY_MS = 20
ROUTER_WAIT_MS = 5000  # that a master waits for a router to begin with
VISIT_WAIT_MS = 500  # that one attempt of a visitor takes at most
# Bytes that one message to a role may have.
LARGEST = {"slave": 1 << 20, "master": 1 << 26, "visitor": 1 << 26, "router": 1 << 26, "imaging": 1 << 20}
LARGEST_PICTURE = 1 << 26  # which a slave gets from its imaging process
# Where all but masters ping a slave, and how many of them a second it lets in over each link: what is beyond costs it
# next to nothing. Not behind a router, where they share a link, and one that comes just after another would be lost.
PINGS = "uuv_hil/*/ping"  # as in hil.transport.tokens, which is not loaded before the vehicle is ready
PINGS_HZ = 250.0
# That a large message may take on a slow network (one of n batches at most 2^n ms), before the rest is left out.
LARGE_WAIT_US = 1_000_000
# That what must not be left out, a recording that is played, waits for a network that takes nothing, before the link
# is closed; 5 s otherwise, in which nobody could end it.
STUCK_WAIT_US = 1_000_000

Role = Literal["slave", "master", "visitor", "router", "imaging"]


class Network(NamedTuple):
    """How slave and masters find each other, and lose each other.

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

    def problem(self) -> str | None:
        """A router that is missing, or would not be used."""
        if (self.mode == "routed") != bool(self.router):
            return 'mode = "routed" and router = "tcp/HOST:PORT" go together'
        return None


def split(endpoint: str) -> tuple[str, str, int]:
    """Scheme, host and port of "tcp/HOST:PORT" or "tls/HOST:PORT". Raises NetworkError when it is neither."""
    scheme, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if scheme not in ("tcp", "tls") or not host or not port.isdigit() or not 0 < int(port) < 65535:
        raise NetworkError(f"endpoint {endpoint!r} is not of the form tcp/HOST:PORT, for example tcp/127.0.0.1:7447")
    return scheme, host, int(port)


def endpoints(endpoint: str, secure: bool = False, one: bool = False) -> list[str]:
    """The two links of an endpoint "tcp/HOST:PORT": urgent traffic on PORT, the rest on PORT + 1; or `one` for all.

    With `secure` they are TLS, whatever the scheme says. Raises NetworkError when the endpoint is not of this form,
    or asks for TLS without certificates.
    """
    scheme, host, port = split(endpoint)
    if scheme == "tls" and not secure:
        raise NetworkError(f"endpoint {endpoint!r} asks for TLS, which needs certificates: a [security] section")
    scheme, buffer = "tls" if secure else "tcp", f"#so_sndbuf={SEND_BUFFER}"
    if one:
        return [f"{scheme}/{host}:{port}{buffer}"]
    return [f"{scheme}/{host}:{port}?prio=1-3{buffer}", f"{scheme}/{host}:{port + 1}?prio=4-7{buffer}"]


def settings(
    role: Role,
    listen: tuple[str, ...],
    dial: tuple[str, ...],
    network: Network,
    security: "Security | None",
    pictures: bool = False,
) -> str:
    """The configuration of a session, as text for the library. Raises NetworkError.

    `pictures`: a slave passes on those of its imaging process.
    """
    how = security is not None, role == "router" or network.mode == "routed"
    table: dict[str, Any] = {
        "mode": _mode(role, network),
        "listen": {"endpoints": [link for endpoint in listen for link in endpoints(endpoint, *how)]},
        "connect": {
            "endpoints": [link for endpoint in dial for link in endpoints(endpoint, *how)],
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
            "gossip": {"enabled": False},
        },
        "transport": {
            "unicast": {
                "max_links": 1 if how[1] else 2,
                "open_timeout": _milliseconds(network.open_timeout),
                "accept_timeout": _milliseconds(network.open_timeout),
            },
            "link": {
                "tx": {"lease": _milliseconds(network.lease), "keep_alive": KEEP_ALIVES, "batch_size": BATCH},
                "rx": {"max_message_size": LARGEST_PICTURE if pictures else LARGEST[role]},
            },
            "shared_memory": {"enabled": False},
        },
    }
    if role in ("slave", "imaging"):  # in a router what comes behind a large message would wait too
        drop, block = {"max_wait_before_drop_fragments": LARGE_WAIT_US}, {"wait_before_close": STUCK_WAIT_US}
        table["transport"]["link"]["tx"]["queue"] = {"congestion_control": {"drop": drop, "block": block}}
    if table["mode"] == "client":
        wait_ms = VISIT_WAIT_MS if role in ("visitor", "imaging") else ROUTER_WAIT_MS
        table["connect"] |= {"timeout_ms": wait_ms, "exit_on_failure": True}
    if role == "slave" and network.mode == "direct":
        rules = [{"key_expr": PINGS, "freq": PINGS_HZ}]
        table["downsampling"] = [{"messages": ["put", "delete"], "flows": ["ingress"], "rules": rules}]
    if security:
        from hil.transport.security import access, tls  # no session without certificates pays for it

        machine: Role = "slave" if role == "imaging" else role
        table["transport"]["link"] |= {"tls": tls(security.folder(machine)), "protocols": ["tls"]}
        if role == "imaging":  # it dials its own machine, whose name there need not be in the certificate
            table["transport"]["link"]["tls"]["verify_name_on_connect"] = False
        elif role in ("slave", "router"):
            table["access_control"] = access(security)
    return json5(table)


def _mode(role: Role, network: Network) -> str:
    """What the library calls it. A router forwards between peers and clients, not between peers; so does a slave.

    Sessions that are all routers forward too, but do not find each other again reliably after a black-out.
    """
    if role == "router":
        return "router"
    if role == "visitor" or (role == "imaging" and network.mode == "direct"):
        return "client"
    return "client" if network.mode == "routed" and role == "master" else "peer"


def save_threads(pictures: bool) -> None:
    """Let as few of the library's threads as a slave needs read; before the process's first session is opened.

    Little comes in: one thread reads it, and waits for it, where by default each message wakes one that wakes another.
    A second one where there are pictures to forward: a thread that does may wait a second for room on the way out, and
    those that accept connections and look what comes on them are then kept apart.
    """
    few = "(rx: (worker_threads: 2))" if pictures else "(rx: (worker_threads: 1), acc: (handover: rx))"
    os.environ.setdefault("ZENOH_RUNTIME", few)


def json5(value: Any) -> str:
    """Plain values as JSON5; the json module would cost 2 ms of every start."""
    if isinstance(value, dict):
        return "{" + ",".join([f"{key!r}:{json5(item)}" for key, item in value.items()]) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ",".join([json5(item) for item in value]) + "]"
    return {True: "true", False: "false"}[value] if isinstance(value, bool) else repr(value)


def _milliseconds(seconds: float) -> int:
    return round(seconds * 1000)
