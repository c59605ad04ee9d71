"""Common part of both ends of thrusters on VESC controllers; `hil.links.vesc.link` describes the protocol."""

from abc import abstractmethod
from struct import Struct
from typing import Annotated, Literal, NamedTuple

from hil.common.schema import Range
from hil.links.contract import Counters, Message, Protocol
from hil.links.wires.can_frame import RECORD_SIZE, CanFrame, pack_frame, unpack_frames

SET_DUTY, SET_CURRENT, SET_RPM, SET_CURRENT_REL = 0, 1, 3, 10
STATUS, STATUS_4, STATUS_5, PING, PONG = 9, 16, 27, 17, 18
EVERY_ID = 255  # addresses all controllers
HW_TYPE_VESC = 0
FULL_FRACTION = 100_000  # of SET_DUTY and SET_CURRENT_REL
FULL_STATUS_DUTY = 1000
FULL_ERPM = 24_500.0  # a T200 on 16 V at full output: 3500 rev/min, 7 pole pairs
TIMEOUT_NS = 500_000_000
COMMANDS = {"duty": SET_DUTY, "rpm": SET_RPM, "current_rel": SET_CURRENT_REL}

ARGUMENT = Struct(">i")
STATUS_DATA = Struct(">ihh")
STATUS_4_DATA = Struct(">hhhh")
STATUS_5_DATA = Struct(">ihh")


class VescSettings(NamedTuple):
    """Settings of both ends. `full_erpm` is the electrical speed at 1900 us, in field revolutions a minute."""

    command: Literal["duty", "rpm", "current_rel"] = "duty"
    first_id: Annotated[int, Range(0, EVERY_ID - 1)] = 1
    full_erpm: Annotated[float, Range(800.0, 1e6)] = FULL_ERPM
    status_period: Annotated[float, Range(0.01, 10.0, "s")] = 0.1


class VescProtocol(Protocol):
    """Common part of both ends."""

    def __init__(self, channels: int, settings: VescSettings) -> None:
        self.counters = Counters()
        self._channels = channels
        self._settings = settings
        self._full = {SET_DUTY: FULL_FRACTION, SET_CURRENT_REL: FULL_FRACTION, SET_RPM: settings.full_erpm}

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages completed by whole records of CAN frames. Never raises."""
        frames = unpack_frames(data)
        self.counters.dropped_bytes += len(data) - len(frames) * RECORD_SIZE
        messages: list[Message] = []
        for frame in frames:
            if frame.extended:
                messages += self._on_frame(frame.id >> 8, frame.id & 0xFF, frame.data)
        return messages

    @abstractmethod
    def _on_frame(self, command: int, controller: int, data: bytes) -> list[Message]:
        """Return the messages completed by a frame to or from a controller."""

    def _frame(self, command: int, thruster: int, data: bytes) -> bytes:
        return pack_frame(CanFrame(command << 8 | self._settings.first_id + thruster, data))
