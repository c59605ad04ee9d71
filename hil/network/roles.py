"""Open the sessions of masters, clients, peers and routers. `hil.network.opening` opens a slave's."""

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from hil.common.clock import now_ns, seconds_ns
from hil.common.endpoint import LAN
from hil.common.errors import NetworkError
from hil.network.opening import open_listening, open_session
from hil.network.session import Session
from hil.network.settings import Network, settings
from hil.network.tokens import Role, router_key

if TYPE_CHECKING:
    from hil.network.security import Security

RETRY_S = 0.2  # between two attempts to connect


def open_master_session(*endpoints: str, network: Network = Network(), security: "Security | None" = None) -> Session:
    """Open a master's session, which connects to each slave once it is present, and again after each loss.

    "lan" as an endpoint stands for all that answer by multicast, now or later. Raises NetworkError if an endpoint is
    invalid or a router is missing.
    """
    if LAN in endpoints:
        return _open_searching("master", endpoints, network, security)
    text = settings("master", (), endpoints, network, security)
    try:
        return _open("connect to", ", ".join(endpoints), text, network, network.mode == "direct", len(endpoints))
    except NetworkError as error:
        raise NetworkError(_refusal(endpoints, network, security) or str(error)) from None


def open_client_session(
    endpoint: str,
    network: Network = Network(),
    security: "Security | None" = None,
    seconds: float = 0.0,
    pause: Callable[[], None] = lambda: None,
) -> Session:
    """Open a client's session. The slave forwards to it also what others publish and declare, masters included.

    Try for `seconds`; `pause` is called between two attempts and may raise. The session reconnects after each loss.
    Raises NetworkError if nothing answers.
    """
    open_once = client_opener(endpoint, network, security)
    deadline = now_ns() + seconds_ns(seconds)
    while True:
        try:
            return open_once()
        except NetworkError:
            if now_ns() > deadline:
                break
        pause()
    raise NetworkError(
        _refusal((endpoint,), network, security)
        or f"nobody answered at {endpoint} within {seconds:g} s; is `uuv-hil slave` running there, with --listen on an "
        "address this machine reaches?"
    )


def client_opener(
    endpoint: str, network: Network = Network(), security: "Security | None" = None
) -> Callable[[], Session]:
    """Return a function that tries once to open a client's session, see `open_client_session`."""
    if endpoint == LAN:
        return lambda: _open_searching("client", (endpoint,), network, security)
    text = settings("client", (), (endpoint,), network, security)
    return lambda: _open("connect to", endpoint, text, network)


def open_when_present(open_once: Callable[[], Session], closing: threading.Event) -> Session | None:
    """Try `open_once` until it succeeds; return the session, or None once `closing` is set."""
    while not closing.is_set():
        with suppress(NetworkError):
            return open_once()
        closing.wait(RETRY_S)
    return None


def open_peer_session(
    endpoint: str, *endpoints: str, network: Network = Network(), security: "Security | None" = None
) -> Session:
    """Open the session of one planner among several: others connect to `endpoint`, it connects to `endpoints`.

    Of two peers only one may connect to the other. In routed mode all connect to the router instead. With `security`,
    `hil.network.security.planner_access` limits what the peers may do. Raises NetworkError, also if the port is in use.
    """
    if network.mode == "routed":
        return open_master_session(network.router, network=network, security=security)
    return _supervised(open_listening("planner", endpoint, endpoints, network, security, print), network, security)


def open_router_session(
    endpoint: str,
    network: Network = Network(),
    security: "Security | None" = None,
    other_endpoints: tuple[str, ...] = (),
    report: Callable[[str], None] = lambda _: None,
) -> Session:
    """Open the session of a router at `endpoint`, which forwards between all that connect. Raises NetworkError.

    `other_endpoints`: endpoints of further routers. It connects to them once they are present, and forwards to
    everything behind them. `report` gets a line for each link to a slave that stayed unknown and is cut.
    """
    from hil.network.workarounds.blocked_router import NewLinks
    from hil.network.workarounds.unknown_router import UnknownRouters

    session = open_listening("router", endpoint, other_endpoints, network, security, report)
    _supervised(session, network, security)
    session.declare_token(router_key(session.zid))
    if network.discovery:
        from hil.network.responder import answer_searches

        answer_searches(session, endpoint, network, bool(security), is_router=True)
    session.supervisor.checks += [NewLinks(session.links).check, UnknownRouters(session, report).check]
    return session


def _open_searching(role: Role, endpoints: tuple[str, ...], network: Network, security: "Security | None") -> Session:
    """Open the session of a master or client that searches at each opening, and while it has no link.

    Raises NetworkError for a client, or with a router, which have one endpoint: if nobody or several answer.
    """
    from hil.network.discovery import NOBODY, Search

    search, is_single = Search(*endpoints), role == "client" or network.mode == "routed"

    def text() -> str:
        search.look()
        if is_single and not search.addresses:
            raise NetworkError(NOBODY)
        if is_single and len(search.addresses) > 1:
            several = ", ".join(search.addresses)
            raise NetworkError(f"several answered by multicast: {several}; choose one with --connect")
        return settings(role, (), search.addresses, network, security)

    session = _open("connect to", ", ".join(endpoints), text, network, role == "master" and not is_single)
    session.supervisor.checks.append(search.watch(session))
    return session


def _open(
    action: str,
    name: str,
    text: str | Callable[[], str],
    network: Network,
    has_pairs: bool = False,
    peer_count: int = 1,
) -> Session:
    """Open a session that is supervised."""
    return _supervised(open_session(action, name, text, has_pairs, peer_count), network, None)


def _supervised(session: Session, network: Network, security: "Security | None") -> Session:
    """Return the session, supervised; `security`: that of its listener."""
    if security:
        from hil.network.workarounds.accept_queue import shorten_queues

        shorten_queues()
    session.supervise(network.lease)
    return session


def _refusal(endpoints: tuple[str, ...], network: Network, security: "Security | None") -> str:
    """Return the first fault at the endpoints that waiting does not remove; "" if there is none."""
    from hil.network.diagnosis import why_not

    folder = security.folder("master") if security else ""
    faults = [(endpoint, why_not(endpoint, folder, network.mode == "routed")) for endpoint in endpoints]
    return next((f"{endpoint}: {fault.text}" for endpoint, fault in faults if fault and fault.lasting), "")
