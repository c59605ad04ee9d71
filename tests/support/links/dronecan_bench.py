"""A bus in memory with nodes of the package `dronecan`, the reference implementation, and link ends of this project."""

from functools import cache
from importlib import import_module
from typing import Any

from firmware_stub.stub import Stm32, Stm32End
from hil.links.contract import ThrusterLink
from hil.links.dronecan.link import open_dronecan
from hil.links.wires.can_frame import CanFrame
from tests.support.lazy import import_lazily
from tests.support.links.can_bench import MemoryBus, MemoryWire, frames, records

dronecan = import_lazily("dronecan")
uavcan = import_lazily("dronecan", "uavcan")

PULSES = (1100, 1499, 1500, 1501, 1777, 1900)
MS = 1_000_000


@cache
def driver_class() -> Any:
    """Return a driver class of the package for a wire of this project; made on first use, which imports the package."""

    package: Any = import_module("dronecan")

    class Driver(package.driver.common.AbstractDriver):  # type: ignore[misc]  # the package has no types
        """A wire of ours as the package wants it. It never waits."""

        def __init__(self, wire: MemoryWire) -> None:
            super().__init__()
            self._wire = wire
            self._received: list[CanFrame] = []

        def receive(self, _timeout: float | None = None) -> Any:
            self._received += frames(self._wire.read())
            if not self._received:
                return None
            frame = self._received.pop(0)
            return package.driver.common.CANFrame(frame.id, frame.data, frame.extended)

        def send_frame(self, frame: Any) -> None:
            self._wire.write(records([CanFrame(frame.id, bytes(frame.data), frame.extended)]))

        def close(self) -> None:
            pass

    return Driver


class Bench:
    """A bus with nodes of the package and link ends of this project, which use a clock that the test advances."""

    def __init__(self) -> None:
        self.bus = MemoryBus()
        self.nodes: list[Any] = []
        self.link_ends: list[Any] = []
        self.now_ns = 0

    def __enter__(self) -> "Bench":
        return self

    def __exit__(self, *_: object) -> None:
        for node in self.nodes:
            node.close()

    def node(self, node_id: int) -> Any:
        operational = uavcan.protocol.NodeStatus().MODE_OPERATIONAL
        node = dronecan.node.Node(
            driver_class()(self.bus.wire()), node_id=node_id, mode=operational, catch_handler_exceptions=False
        )
        self.nodes.append(node)
        return node

    def device(self, channels: int = 6, **settings: Any) -> Stm32End:
        link = ThrusterLink(self.bus.wire(), open_dronecan("device", channels, **settings))
        end = Stm32End(Stm32(channels), link)
        self.link_ends.append(end)
        return end

    def host(self, channels: int = 6, **settings: Any) -> ThrusterLink:
        return ThrusterLink(self.bus.wire(), open_dronecan("host", channels, **settings))

    def run(self, seconds: float = 0.005) -> None:
        for _ in range(round(seconds * 200)):
            self.now_ns += 5 * MS
            for _ in range(2):  # there and back
                for end in self.link_ends:
                    end.service(self.now_ns)
                for node in self.nodes:
                    node.spin(0)


def listen(node: Any, kind: Any) -> list[Any]:
    received: list[Any] = []
    node.add_handler(kind, received.append)
    return received


def arm(node: Any, status: int = 255) -> None:
    node.broadcast(uavcan.equipment.safety.ArmingStatus(status=status))
