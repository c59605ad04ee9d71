"""The bridge: every byte between a single-board computer, a planner and the simulator."""

from hil.common import __version__ as __version__

TYPE_CHECKING = False  # as typing has it, which a lean process does not load for this
if TYPE_CHECKING:
    from hil.client.fleet import Fleet


def connect(
    *endpoints: str,
    take_over: bool = False,
    observe: bool = False,
    routed: bool = False,
    keys: str = "",
    wait: float = 5.0,
) -> "Fleet":
    """Return the vehicles at `endpoints`, as objects that give samples and take commands; see docs/how-to/python.md.

    An endpoint is that of a slave, "tcp/192.168.3.116:7447" or "tls/...", or "lan": the one that answers by multicast.
    With `routed` it is that of a router, and all vehicles behind it are reached. With `take_over` a vehicle is
    commanded even if another master commands it; with `observe` it is never commanded. `keys` is this machine's folder
    of certificates (`uuv-hil keys add`). The first use of a vehicle waits for it, up to `wait` s. Raises NetworkError.
    """
    from hil.client.fleet import connect as connect_fleet

    return connect_fleet(*endpoints, take_over=take_over, observe=observe, routed=routed, keys=keys, wait=wait)
