"""Both ends of a DroneCAN link, for tests."""

from typing import Any, cast

from firmware_stub.stub import Stm32, Stm32End
from hil.links.contract import PWM_NEUTRAL_US, ThrusterLink, ThrusterTelemetry
from hil.links.dronecan.device import DroneCanDevice
from hil.links.dronecan.host import DroneCanHost
from hil.links.dronecan.link import open_dronecan
from hil.links.dronecan.transfer import DataType, Receiver, Transfer, message_key
from tests.support.links.can_bench import MemoryBus, frames

PULSES = (1100, 1499, 1500, 1501, 1777, 1900)


NEUTRAL = (PWM_NEUTRAL_US,) * 6


MS = 1_000_000


def host(channels: int = 6, **settings: Any) -> DroneCanHost:
    return cast("DroneCanHost", open_dronecan("host", channels, **settings))


def device(channels: int = 6, **settings: Any) -> DroneCanDevice:
    return cast("DroneCanDevice", open_dronecan("device", channels, **settings))


def report(pulses: tuple[int, ...] = PULSES, **changes: Any) -> ThrusterTelemetry:
    return ThrusterTelemetry(0, True, False, pulses, 0, 0, 0, 0)._replace(**changes)


def transfers(output: bytes, kind: DataType) -> list[Transfer]:
    """Return the messages of a kind in some records."""
    receiver = Receiver(device().counters)
    receiver.kinds = {message_key(kind): kind}
    taken = [receiver.feed_frame(frame, 0) for frame in frames(output)]
    return [whole for whole in taken if whole is not None]


class Board:
    """A host and an STM32 on a bus in memory, with one clock."""

    def __init__(self, channels: int = 6, host_settings: Any = None, **settings: Any) -> None:
        self.bus = MemoryBus()
        self.host = ThrusterLink(self.bus.wire(), host(channels, **(host_settings or {})))
        self.stm32 = Stm32(channels)
        self.end = Stm32End(self.stm32, ThrusterLink(self.bus.wire(), device(channels, **settings)))
        self.now_ns = 0
        self.received: list[ThrusterTelemetry] = []

    def run(self, seconds: float, step_ns: int = 5 * MS) -> None:
        for _ in range(max(1, round(seconds * 1e9 / step_ns))):
            self.now_ns += step_ns
            self.host.tick(self.now_ns)
            self.end.service(self.now_ns)
            self.received += cast("list[ThrusterTelemetry]", self.host.receive())
