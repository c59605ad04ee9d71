"""The sessions of all who are no vehicle: masters, visitors, routers. A slave's is in `hil.transport.session`."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hil.clock import now_ns, seconds_ns
from hil.errors import NetworkError
from hil.transport.session import Session, open_session
from hil.transport.settings import Network, settings

if TYPE_CHECKING:
    from hil.transport.security import Security


def dial(*endpoints: str, network: Network = Network(), security: "Security | None" = None) -> Session:
    """The session of a master: it connects to each slave as soon as it is there, and again after each loss.

    Raises NetworkError when an endpoint cannot be meant, or a router is not there.
    """
    text = settings("master", (), endpoints, network, security)
    try:
        return _open("dial", ", ".join(endpoints), text)
    except NetworkError as error:
        raise NetworkError(_refusal(endpoints, security) or str(error)) from None


def visit(
    endpoint: str,
    network: Network = Network(),
    security: "Security | None" = None,
    seconds: float = 0.0,
    pause: Callable[[], None] = lambda: None,
) -> Session:
    """The session of one who looks on: a slave shows it also what others say and declare, masters among them.

    Tries for so many `seconds`, with `pause` called in between, which may raise; later it connects again after each
    loss. Raises NetworkError when nobody is there.
    """
    text = settings("visitor", (), (endpoint,), network, security)
    deadline = now_ns() + seconds_ns(seconds)
    while True:
        try:
            return _open("dial", endpoint, text)
        except NetworkError:
            if now_ns() > deadline:
                break
        pause()
    raise NetworkError(
        _refusal((endpoint,), security)
        or f"nobody answered at {endpoint} within {seconds:g} s; is `uuv-hil slave` running there, with --listen on an "
        "address this machine reaches?"
    )


def meet(endpoint: str, *endpoints: str, network: Network = Network()) -> Session:
    """The session of one planner among several: others connect to it at `endpoint`, it connects to `endpoints`.

    Of two that are to hear each other only one may connect to the other. With a router in between all connect to
    that alone. Raises NetworkError, also when the port is taken.
    """
    if network.mode == "routed":
        return dial(network.router, network=network)
    return open_session("listen on", endpoint, settings("master", (endpoint,), endpoints, network, None))


def route(endpoint: str, network: Network = Network(), security: "Security | None" = None) -> Session:
    """The session of a router at `endpoint`, which forwards between all who dial it. Raises NetworkError."""
    return _open("listen on", endpoint, settings("router", (endpoint,), (), network, security))


def _open(action: str, name: str, text: str) -> Session:
    session = open_session(action, name, text)
    session.free_links()
    return session


def _refusal(endpoints: tuple[str, ...], security: "Security | None") -> str:
    """What stands in the way of the first that it does, if that does not pass by waiting; else empty."""
    from hil.transport.diagnosis import why_not

    faults = [(endpoint, why_not(endpoint, security.folder("master") if security else "")) for endpoint in endpoints]
    return next((f"{endpoint}: {fault.text}" for endpoint, fault in faults if fault and fault.lasting), "")
