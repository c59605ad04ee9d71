"""Report why a slave cannot reach its router. Loaded after the vehicle is ready, if a router is configured."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hil.common.endpoint import split_endpoint
from hil.network.diagnosis import has_connected, why_not
from hil.network.session import Session

if TYPE_CHECKING:
    from hil.network.security import Security

PERIOD_S = 2.0


def watch_router(session: Session, router: str, security: "Security | None", report: Callable[[str], None]) -> None:
    """Report, from a thread, why the `router` is not reached, whenever the reason changes."""
    port, folder = split_endpoint(router)[2], security.folder("slave") if security else ""
    reported = ""

    def check() -> None:
        nonlocal reported
        fault = None if has_connected(session, port) else why_not(router, folder, routed=True)
        if fault and fault.text != reported:
            report(f"the router {router} is not reached: {fault.text}")
        reported = fault.text if fault else ""

    session.every(PERIOD_S, check, "router")
