"""Our DroneCAN against the reference implementation in Python, the package `dronecan`, on a bus in memory."""

from collections.abc import Iterator
from typing import Any

import pytest

from hil.common import __version__
from hil.links.contract import ThrusterCommand, ThrusterTelemetry
from hil.links.dronecan.settings import DeviceSettings
from hil.links.dronecan.types import UNIQUE_ID_SIZE
from hil.links.wires.can_frame import CanFrame
from tests.support.links.can_bench import records
from tests.support.links.dronecan_bench import PULSES, Bench, arm, dronecan, listen, uavcan

RAW = [-8191, -20, 0, 20, 5672, 8191]


@pytest.fixture
def bench() -> Iterator[Bench]:
    with Bench() as made:
        yield made


def test_a_node_commands_our_stm32(bench: Bench) -> None:
    end, node = bench.device(), bench.node(99)
    status, nodes = listen(node, uavcan.equipment.esc.Status), listen(node, uavcan.protocol.NodeStatus)
    bench.run()
    assert {event.message.esc_index for event in status} == set(range(6))
    node.broadcast(uavcan.equipment.esc.RawCommand(cmd=RAW))
    bench.run()
    assert end.stm32.pwm_us == [1500] * 6, "nothing armed it"
    arm(node)
    node.broadcast(uavcan.equipment.esc.RawCommand(cmd=RAW))
    status.clear()
    bench.run()
    assert end.stm32.pwm_us == list(PULSES)
    assert end.stm32.armed
    latest = {event.message.esc_index: event.message for event in status}
    assert [latest[i].rpm for i in range(6)] == [round((pulse - 1500) * 8.75) for pulse in PULSES]
    assert [latest[i].power_rating_pct for i in (0, 2, 5)] == [100, 0, 100]
    assert latest[5].current == 24.0
    assert latest[2].voltage == 16.0
    assert latest[2].temperature == 288.0
    assert {event.transfer.source_node_id for event in status} == {20}
    assert nodes[-1].message.vendor_specific_status_code == 1, "armed"
    arm(node, 0)
    bench.run()
    assert end.stm32.pwm_us == [1500] * 6
    assert nodes[-1].message.vendor_specific_status_code == 0
    assert end.link.counters.malformed == end.link.counters.checksum_errors == 0


def test_get_node_info_is_answered(bench: Bench) -> None:
    bench.device(unique_id="00112233445566778899aabbccddeeff")
    host, node = bench.host(), bench.node(99)
    responses: list[Any] = []
    bench.run(0.5)
    for number in (20, 10):
        node.request(uavcan.protocol.GetNodeInfo.Request(), number, responses.append)
    bench.run()
    host.tick(bench.now_ns)
    host.receive()
    bench.run()
    stm32, master = (event.response for event in responses)
    assert bytes(stm32.name).decode() == "org.uuv-hil.stm32"
    assert bytes(master.name).decode() == "org.uuv-hil.host"
    assert stm32.hardware_version.unique_id.to_bytes().hex() == "00112233445566778899aabbccddeeff"
    default, other = DeviceSettings().unique_bytes, DeviceSettings(esc_index=6).unique_bytes
    assert len(default) == len(other) == UNIQUE_ID_SIZE
    assert default != other
    assert stm32.status.mode == stm32.status.MODE_OPERATIONAL
    version = tuple(map(int, __version__.split(".")[:2]))
    assert (stm32.software_version.major, stm32.software_version.minor) == version


def test_our_host_commands_reference_controllers(bench: Bench) -> None:
    """Two nodes of three controllers each behave as DroneCAN motor controllers do."""
    host = bench.host(own_device=False)
    armings = []
    for number in range(2):
        node = bench.node(50 + number)
        armings.append(listen(node, uavcan.equipment.safety.ArmingStatus))

        def on_command(event: Any, first: int = 3 * number) -> None:
            for index in range(first, first + 3):
                rpm = round(event.message.cmd[index] * 3500 / 8191)
                event.node.broadcast(uavcan.equipment.esc.Status(esc_index=index, rpm=rpm, error_count=first))

        node.add_handler(uavcan.equipment.esc.RawCommand, on_command)
    for sequence in range(1, 21):
        pulses = tuple(pulse if pulse == 1500 else 1100 + (pulse + 31 * sequence) % 800 for pulse in PULSES)
        host.send(ThrusterCommand(sequence, True, pulses))
        bench.run()
        assert host.receive() == [ThrusterTelemetry(sequence, True, False, pulses, 0, sequence, 3, 0)]
    assert [[event.message.status for event in received] for received in armings] == [[255]] * 2
    host.send(ThrusterCommand(21, False, PULSES))
    bench.run()
    (answer_to_disarm,) = host.receive()
    assert answer_to_disarm.pwm_us == (1500,) * 6
    assert armings[0][-1].message.status == 0
    assert host.counters.malformed == host.counters.checksum_errors == 0


def test_our_allocator_gives_a_reference_node_a_number(bench: Bench) -> None:
    """The frames of the request are the package's, which has no requesting node."""
    host, unique_id = bench.host(allocate=True), list(range(1, 17))
    wire, received = bench.bus.wire(), listen(bench.node(99), uavcan.protocol.dynamic_node_id.Allocation)
    host.receive()
    for stage, part in enumerate((unique_id[:6], unique_id[6:12], unique_id[12:])):
        requested = uavcan.protocol.dynamic_node_id.Allocation(first_part_of_unique_id=stage == 0, unique_id=part)
        transfer = dronecan.transport.Transfer(payload=requested, transfer_id=stage, discriminator=77)
        cut = [CanFrame(frame.message_id, bytes(frame.bytes)) for frame in transfer.to_frames()]
        wire.write(records(cut))
        host.receive()
        bench.run()
    granted = [event.message for event in received if event.transfer.source_node_id == 10]
    assert [len(message.unique_id) for message in granted] == [6, 12, 16]
    assert granted[-1].node_id == 125
    assert list(granted[-1].unique_id) == unique_id
