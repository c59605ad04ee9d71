"""The thruster frame of `firmware_stub/frames/uuv_hil.toml`, in C where it was compiled: the same bytes and messages.

A command waits for both ends of its link, and Python's way through tables that serve any frame is most of what they
take.
"""

from hil.links.contract import Message, Protocol, ThrusterCommand, ThrusterTelemetry
from hil.links.frame.protocol import FrameProtocol


class NativeFrameProtocol(Protocol):
    """Stands for a `FrameProtocol` whose frame `is_ours`: what is usual in C; what is not goes on there."""

    def __init__(self, plain: FrameProtocol) -> None:
        from hil.slave.native._frame import pack, read

        self._plain, self._reader = plain, plain.reader
        self._pack, self._read = pack, read
        self.counters = plain.counters

    def encode(self, message: Message) -> bytes:
        """As the one it stands for."""
        return self._pack(message) or self._plain.encode(message)

    def feed(self, data: bytes) -> list[Message]:
        """As the one it stands for."""
        if not self._reader.unfinished:
            if not data:
                return []
            message = self._read(data)
            if message:
                return [message]
        return self._plain.feed(data)


def is_ours(protocol: FrameProtocol, channels: int) -> bool:
    """Whether its frame file, which anybody may write or change, says what was compiled.

    Found by messages of so many thrusters with every bit of every number set, as far as they can all differ.
    """
    from hil.slave.native._frame import pack

    if protocol.deadline_ns != Protocol.deadline_ns:  # it has more to say than that
        return False
    pulses = tuple([0xFFFF - channel for channel in range(channels)])
    probes = (
        ThrusterCommand(0xFEDC, True, pulses),
        ThrusterCommand(1, False, pulses),
        ThrusterTelemetry(0xFEDC, True, False, pulses, 0xFEDC_BA98, 0xFFEF, 0xFFDF, 0xFFCF),
        ThrusterTelemetry(1, False, True, pulses, 2, 3, 4, 5),
    )
    return all(protocol.encode(probe) == pack(probe) for probe in probes)
