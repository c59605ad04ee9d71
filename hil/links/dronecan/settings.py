"""Settings of a DroneCAN thruster link."""

from typing import Annotated, NamedTuple

from hil.common import __version__
from hil.common.clock import NS_PER_S
from hil.common.schema import Range
from hil.links.dronecan.transfer import MAX_NODE_ID
from hil.links.dronecan.types import UNIQUE_ID_SIZE

HOST_ID, DEVICE_ID = 10, 20  # 10 is also ArduPilot's
MAX_ESCS = 20  # in one RawCommand
FULL_RPM = 3500.0  # a T200 on 16 V at full output (Blue Robotics, T200 public performance data, 2019)
ARMING_PERIOD_NS = NS_PER_S // 2
ARMED, TIMED_OUT, TRIPS_SHIFT = 1, 2, 2  # in the vendor-specific status code
SOFTWARE = (int(__version__.split(".")[0]), int(__version__.split(".")[1]))

# At the lower limit 1 us is 2 rev/min; at the upper limit 2200 us still fits into an int18.
FullRpm = Annotated[float, Range(800.0, 74_000.0)]
EscIndex = Annotated[int, Range(0, MAX_ESCS - 1)]
NodeId = Annotated[int, Range(1, MAX_NODE_ID)]


class HostSettings(NamedTuple):
    """Settings of the host end. `own_device` false: the device is not ours, and its NodeStatus carries no arming."""

    node_id: NodeId = HOST_ID
    full_rpm: FullRpm = FULL_RPM
    own_device: bool = True
    esc_index: EscIndex = 0  # of the first thruster
    allocate: bool = False  # allocate node numbers to nodes that request one
    unique_id: str = "7575762d68696c20686f737400000000"

    def validate(self) -> str | None:
        """Return what is wrong with the unique id; None if it is valid."""
        return _validate_unique_id(self.unique_id)


class DeviceSettings(NamedTuple):
    """Settings of the device end.

    Two devices on a bus need two unique ids. By default they differ by `node_id` and `esc_index`.
    """

    node_id: NodeId = DEVICE_ID
    full_rpm: FullRpm = FULL_RPM
    require_arming: bool = True
    esc_index: EscIndex = 0  # of the first thruster
    unique_id: str = ""

    def validate(self) -> str | None:
        """Return what is wrong with the unique id; None if it is valid."""
        return _validate_unique_id(self.unique_id) if self.unique_id else None

    @property
    def unique_bytes(self) -> bytes:
        """The unique id."""
        return bytes.fromhex(self.unique_id) or b"uuv-hil stm32\0" + bytes((self.node_id, self.esc_index))


def _validate_unique_id(unique_id: str) -> str | None:
    try:
        value = bytes.fromhex(unique_id)
    except ValueError:
        value = b""
    return None if len(value) == UNIQUE_ID_SIZE and any(value) else "unique_id: 32 hex digits, not all 0, are needed"
