"""Open the session of a slave, at once or in a thread, and any other session from its settings."""

import os
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import zenoh

from hil.common.errors import HilError, NetworkError
from hil.network.session import Session
from hil.network.settings import Network, settings
from hil.network.tokens import Role

if TYPE_CHECKING:
    from hil.network.security import Security


def listen(
    endpoint: str,
    network: Network = Network(),
    security: "Security | None" = None,
    pictures: bool = False,
    report: Callable[[str], None] = print,
) -> Session:
    """Return a slave's session. Masters connect to it at `endpoint`; it connects to the router in `network`, if any.

    `pictures`: it also forwards the samples of its imaging process. `report` gets a line if the address is not there
    yet. Raises NetworkError, also if the port is in use.
    """
    routers = (network.router,) if network.router else ()
    session = open_listening("slave", endpoint, routers, network, security, report, pictures)
    if network.router:
        from hil.network.tokens import router_key  # not loaded before the vehicle is ready, unless there is a router

        session.declare_token(router_key(session.zid))
    return session


class Listening:
    """A session that a thread opens while the caller does other work.

    `notes` are lines for the log. `is_stuck`: the library did not close the session in time; the process can then end
    only by `os._exit`.
    """

    is_stuck = False

    def __init__(
        self, endpoint: str, network: Network = Network(), security: "Security | None" = None, pictures: bool = False
    ) -> None:
        self.notes: list[str] = []
        self._arguments = endpoint, network, security, pictures, self.notes.append
        self._session: Session | None = None
        self._error: HilError | None = None
        self._thread = threading.Thread(target=self._run, name="open session")
        self._thread.start()

    def _run(self) -> None:
        # The library's threads inherit this scheduling. A peer's declarations can keep them busy for a second;
        # real-time threads would then block the kernel's threads, and with them the loop's serial line.
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        try:
            self._session = listen(*self._arguments)
        except HilError as error:
            self._error = error

    def session(self) -> Session:
        """Return the open session. Raises the errors of `listen`."""
        self._thread.join()
        if self._error:
            raise self._error
        assert self._session
        return self._session

    def close(self) -> None:
        """Close the session if it was opened; wait some seconds at most. May be called twice."""
        self._thread.join()
        if self._session and not self.is_stuck:
            self._session.close()
            self.is_stuck = self._session.is_stuck


LATE_CLOSE_WITHIN_S = 0.5  # the library does not end its attempts to listen, and waits for them for 10 s
# The library's texts for addresses that are not there yet.
LATE = {
    "Cannot assign requested address": "this machine does not have that address yet",
    "Temporary failure in name resolution": "no name server answers yet",
}


class _LateAddressError(NetworkError):
    """An address is not there yet, for the reason `why`."""

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"{what}: {why}")
        self.why = why


def open_listening(
    role: Role,
    endpoint: str,
    connect: tuple[str, ...],
    network: Network,
    security: "Security | None",
    report: Callable[[str], None],
    pictures: bool = False,
) -> Session:
    """Return a session that listens at `endpoint`, as soon as this machine has that address: `report` gets a line.

    Raises NetworkError for another reason not to listen there.
    """
    arguments = role, (endpoint,), connect, network, security, pictures
    try:
        return open_session("listen on", endpoint, settings(*arguments))
    except _LateAddressError as error:
        report(f"{endpoint}: waiting for it: {error.why}")
    session = open_session("listen on", endpoint, settings(*arguments, is_late=True))
    session.close_within_s = LATE_CLOSE_WITHIN_S
    return session


def open_session(
    action: str, name: str, text: str | Callable[[], str], has_pairs: bool = False, peer_count: int = 1
) -> Session:
    """Return a session with the zenoh settings `text`, or its value at each opening; the rest as in `Session`.

    Raises NetworkError; its text says that `action` on `name` is impossible, and why.
    """
    try:
        return Session(
            lambda: zenoh.open(zenoh.Config.from_json5(text if isinstance(text, str) else text())),
            name,
            has_pairs,
            peer_count,
        )
    except zenoh.ZError as error:
        what = f"cannot {action} {name}"
        if why := next((why for text, why in LATE.items() if text in str(error)), ""):
            raise _LateAddressError(what, why) from None
        raise NetworkError(f"{what}: {_reason(str(error))}") from None


def _reason(text: str) -> str:
    if "Address already in use" in text:
        return (
            f"{_taken_port(text)} is in use: by another slave or router, or by ROS 2's rmw_zenohd, whose port is 7447 "
            "too; end that, or choose another with --listen"
        )
    if "Permission denied" in text:
        return "no permission for that port: those below 1024 are root's alone; choose another with --listen"
    if "lookup address" in text:
        return "no machine is called that here; give its address"
    if "Unable to connect" in text:
        return "there is no router, or it refuses us; start it first, `uuv-hil router`"
    return text.partition(" at /")[0]  # without the position in the library's source


def _taken_port(text: str) -> str:
    """Return which port is in use, from the library's error text."""
    address = text.partition("bound to ")[2].partition(": ")[0].partition("?")[0].partition("#")[0]
    port = address.rpartition(":")[2]
    return f"port {port}" if port.isdigit() else "the port (or the next one)"
