"""The public package `dronecan`, with its own SocketCAN driver, and the emulated STM32 on one bus of the kernel."""

import time
from collections.abc import Iterator
from importlib import import_module
from typing import Any, NamedTuple

import pytest

from firmware_stub.stub import Stm32, Stm32End
from hil.common.clock import now_ns
from hil.links.contract import ThrusterLink
from hil.links.dronecan.link import open_dronecan
from hil.links.wires.can_bus import open_socketcan
from tests.system.uml.network import interface

pytestmark = pytest.mark.usefixtures("guest")

dronecan: Any = import_module("dronecan")
uavcan = dronecan.uavcan

PATIENCE_S = 60.0
RAW = [-8191, -20, 0, 20, 5672, 8191]
PULSES = [1100, 1499, 1500, 1501, 1777, 1900]


class Bench(NamedTuple):
    """A node of `dronecan`, the emulated STM32, and the esc.Status received since it was cleared, by index."""

    node: Any
    end: Stm32End
    status: dict[int, Any]

    def spin(self) -> None:
        self.end.service(now_ns())
        self.node.spin(0)

    def command(self, raw: list[int]) -> float:
        """Send a RawCommand and wait for the Status of all thrusters; return the seconds that it took."""
        self.status.clear()
        began = time.perf_counter()
        self.node.broadcast(uavcan.equipment.esc.RawCommand(cmd=raw))
        while len(self.status) < len(raw):
            self.spin()
            assert time.perf_counter() - began < PATIENCE_S, self.status
        return time.perf_counter() - began


@pytest.fixture
def bench() -> Iterator[Bench]:
    with interface("vcan0", "vcan"):
        driver = dronecan.driver.SocketCAN("vcan0")
        operational = uavcan.protocol.NodeStatus().MODE_OPERATIONAL
        node = dronecan.node.Node(driver, node_id=99, mode=operational, catch_handler_exceptions=False)
        link = ThrusterLink(open_socketcan("vcan0"), open_dronecan("device", len(RAW)))
        # Reports answer commands alone, so that each report belongs to a command.
        made = Bench(node, Stm32End(Stm32(len(RAW), telemetry_period_ns=10**10), link), {})
        node.add_handler(
            uavcan.equipment.esc.Status, lambda event: made.status.update({event.message.esc_index: event.message})
        )
        yield made
        node.close()
        link.close()


def test_raw_commands_are_answered(bench: Bench) -> None:
    """The round-trip time is printed with -rP."""
    bench.spin()
    bench.node.broadcast(uavcan.equipment.safety.ArmingStatus(status=255))
    bench.command([0] * 6)
    bench.command(RAW)
    assert bench.end.stm32.armed
    assert bench.end.stm32.pwm_us == PULSES
    assert [bench.status[i].rpm for i in range(6)] == [round((pulse - 1500) * 8.75) for pulse in PULSES]
    durations = sorted(bench.command([80 * count + i for i in range(6)]) for count in range(100))
    assert bench.end.stm32.frames == 102
    assert bench.end.stm32.watchdog_trips == 0 or durations[-1] > 0.1, "but for a guest that had to wait"
    assert bench.end.link.counters.malformed == bench.end.link.counters.checksum_errors == 0
    print(f"RawCommand to six Status: p50 {durations[50] * 1e3:.2f} ms, p99 {durations[98] * 1e3:.2f} ms")


def test_the_stm32_answers_with_its_node_information(bench: Bench) -> None:
    answers: list[Any] = []
    bench.node.request(uavcan.protocol.GetNodeInfo.Request(), 20, answers.append)
    end = time.monotonic() + PATIENCE_S
    while not answers and time.monotonic() < end:
        bench.spin()
    assert bytes(answers[0].response.name).decode() == "org.uuv-hil.stm32"
