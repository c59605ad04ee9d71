"""Open the endpoints that a scenario or a command names."""

from collections.abc import Callable

from hil.common.errors import NetworkError
from hil.links.endpoints.patient import open_endpoint
from hil.links.endpoints.sockets import Link
from hil.scenario.mavlink_records import MavlinkEndpoint

MARKERS = b"\xfd\xfe"  # that a MAVLink packet begins with


def open_link(endpoint: MavlinkEndpoint, report: Callable[[str], None]) -> Link:
    """Return an endpoint that opens, now or as soon as it can. Raises NetworkError if it cannot by waiting."""
    try:
        return open_endpoint(endpoint.kind, endpoint.target, endpoint.port, report, MARKERS)
    except NetworkError as error:
        raise NetworkError(f"{error}: an ArduSub may listen there too") from None
