"""Saying why a slave does not reach its router. Loaded when the vehicle is ready, and only where there is a router."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hil.transport.diagnosis import why_not
from hil.transport.session import Session
from hil.transport.settings import split

if TYPE_CHECKING:
    from hil.transport.security import Security

PERIOD_S = 2.0


def watch_router(session: Session, router: str, security: "Security | None", report: Callable[[str], None]) -> None:
    """In a thread, `report` what stands between us and the `router`, whenever that changes."""
    port, folder = split(router)[2], security.folder("slave") if security else ""
    said = ""

    def look() -> None:
        nonlocal said
        fault = None if session.has_dialled(port) else why_not(router, folder, routed=True)
        if fault and fault.text != said:
            report(f"the router {router} is not reached: {fault.text}")
        said = fault.text if fault else ""

    session.every(PERIOD_S, look, "router")
