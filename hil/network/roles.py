"""Open the sessions of masters, clients, peers and routers. `hil.network.opening` opens a slave's."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hil.common.clock import now_ns, seconds_ns
from hil.common.errors import NetworkError
from hil.network.opening import open_session
from hil.network.session import Session
from hil.network.settings import Network, settings
from hil.network.stall import mend_links
from hil.network.tokens import router_key

if TYPE_CHECKING:
    from hil.network.security import Security


def open_master_session(*endpoints: str, network: Network = Network(), security: "Security | None" = None) -> Session:
    """Open a master's session, which connects to each slave once it is present, and again after each loss.

    Raises NetworkError when an endpoint cannot be meant, or a router is not there.
    """
    text = settings("master", (), endpoints, network, security)
    try:
        return _open("dial", ", ".join(endpoints), text, network, network.mode == "direct", len(endpoints))
    except NetworkError as error:
        raise NetworkError(_refusal(endpoints, network, security) or str(error)) from None


def open_client_session(
    endpoint: str,
    network: Network = Network(),
    security: "Security | None" = None,
    seconds: float = 0.0,
    pause: Callable[[], None] = lambda: None,
) -> Session:
    """Open a client's session: a slave passes on to it also what others publish and declare, masters included.

    Tries for so many `seconds`, with `pause` called in between, which may raise; later it connects again after each
    loss. Raises NetworkError when nobody is there.
    """
    text = settings("client", (), (endpoint,), network, security)
    deadline = now_ns() + seconds_ns(seconds)
    while True:
        try:
            return _open("dial", endpoint, text, network)
        except NetworkError:
            if now_ns() > deadline:
                break
        pause()
    raise NetworkError(
        _refusal((endpoint,), network, security)
        or f"nobody answered at {endpoint} within {seconds:g} s; is `uuv-hil slave` running there, with --listen on an "
        "address this machine reaches?"
    )


def open_peer_session(
    endpoint: str, *endpoints: str, network: Network = Network(), security: "Security | None" = None
) -> Session:
    """Open the session of one planner among several: others connect to `endpoint`, it connects to `endpoints`.

    Of two peers only one may connect to the other. With a router in between all connect to that alone. With `security`
    those that connect here may do what `hil.network.security.planner_access` says. Raises NetworkError, also when the
    port is taken.
    """
    if network.mode == "routed":
        return open_master_session(network.router, network=network, security=security)
    session = _open("listen on", endpoint, settings("planner", (endpoint,), endpoints, network, security), network)
    if security:
        _shorten_queues()
    return session


def open_router_session(
    endpoint: str, network: Network = Network(), security: "Security | None" = None, others: tuple[str, ...] = ()
) -> Session:
    """Open the session of a router at `endpoint`, which forwards between all that connect. Raises NetworkError.

    `others`: endpoints of further routers; it forwards to all that is behind them, and dials them until they are there.
    """
    session = open_session("listen on", endpoint, settings("router", (endpoint,), others, network, security))
    session.free_links()
    session.declare_token(router_key(session.zid))
    if security:
        _shorten_queues()
    return session


def _shorten_queues() -> None:
    """Let few connections wait where we listen with TLS."""
    from hil.network.sockets import shorten_queues

    shorten_queues()


def _open(action: str, name: str, text: str, network: Network, has_pairs: bool = False, dialled: int = 1) -> Session:
    session = open_session(action, name, text, has_pairs, dialled)
    session.free_links()
    mend_links(session, network.lease)
    return session


def _refusal(endpoints: tuple[str, ...], network: Network, security: "Security | None") -> str:
    """Return what stands in the way of the first that it does, if that does not pass by waiting; else empty."""
    from hil.network.diagnosis import why_not

    folder = security.folder("master") if security else ""
    faults = [(endpoint, why_not(endpoint, folder, network.mode == "routed")) for endpoint in endpoints]
    return next((f"{endpoint}: {fault.text}" for endpoint, fault in faults if fault and fault.lasting), "")
