"""Find slaves and routers in the local network by multicast, those with `discovery = true` in [network].

Many access points do not forward multicast; an explicit endpoint always works.
"""

import time

import zenoh

from hil.network.settings import json5

POLL_S = 0.005
URGENT = "?prio=1-3"  # as in hil.network.settings


def find(seconds: float) -> list[str]:
    """Return the endpoints that answer within `seconds`; return earlier, soon after the first answer."""
    endpoints: dict[str, None] = {}
    config = zenoh.Config.from_json5(json5({"scouting": {"multicast": {"enabled": True}}}))
    scout = zenoh.scout(zenoh.handlers.FifoChannel(64), what="peer|router", config=config)
    deadline = time.monotonic() + seconds
    try:
        while time.monotonic() < deadline:
            hello = scout.try_recv()
            if hello is None:
                time.sleep(POLL_S)
                continue
            urgent = [locator for locator in hello.locators if locator.endswith(URGENT)]  # first of a slave's two
            ours = [locator.removesuffix(URGENT) for locator in urgent or hello.locators]
            if ours and not endpoints:
                deadline = min(deadline, time.monotonic() + 0.1)  # for other answers to the same request
            endpoints |= dict.fromkeys(ours)
    finally:
        scout.stop()  # type: ignore[no-untyped-call]
    return sorted(endpoints)
