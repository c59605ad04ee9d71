"""Parameters, restart, statistics, speeds and extended status of our nodes, with the reference implementation."""

import random
import struct
from pathlib import Path
from typing import Any

import pytest

from hil.common.errors import ConfigError
from hil.links.contract import ThrusterCommand
from hil.links.dronecan import services
from hil.links.dronecan.parameters import Parameter, ParameterStore
from hil.links.dronecan.services import GetSet
from hil.links.dronecan.transfer import data_type
from hil.links.dronecan.types import (
    EscStatusExtended,
    pack_rpm_command,
    pack_status_extended,
    unpack_rpm_command,
    unpack_status_extended,
)
from tests.support.lazy import import_lazily
from tests.support.links.dronecan_bench import PULSES, Bench, arm, dronecan, listen
from tests.support.links.dronecan_ends import device, host

node_monitor = import_lazily("dronecan.app.node_monitor")
protocol, esc = import_lazily("dronecan", "uavcan.protocol"), import_lazily("dronecan", "uavcan.equipment.esc")
SAVE, ERASE = 0, 1


@pytest.fixture(name="bench")
def _bench() -> Any:
    with Bench() as made:
        yield made


def send_request(bench: Bench, node: Any, request: Any, number: int = 20) -> Any:
    responses: list[Any] = []
    node.request(request, number, responses.append)
    bench.run()
    assert responses[0] is not None, "no answer came"
    return responses[0].response


def get_parameter(bench: Bench, node: Any, name: str = "", index: int = 0, **value: Any) -> Any:
    request = protocol.param.GetSet.Request(index=index, name=name)
    for field, given in value.items():
        setattr(request.value, field, given)
    return send_request(bench, node, request)


def test_a_reference_node_lists_our_parameters(bench: Bench) -> None:
    bench.device()
    node = bench.node(99)
    parameters: list[tuple[str, Any]] = []
    while name := bytes((response := get_parameter(bench, node, index=len(parameters))).name).decode():
        parameters.append((name, response))
    assert [name for name, _ in parameters] == ["CAN_NODE", "ESC_INDEX", "FULL_RPM", "REQUIRE_ARMING"]
    number, first, rpm, arming = (response for _, response in parameters)
    assert (number.value.integer_value, number.min_value.integer_value, number.max_value.integer_value) == (20, 0, 127)
    assert (first.value.integer_value, first.max_value.integer_value) == (0, 14)
    assert (rpm.value.real_value, rpm.default_value.real_value, rpm.min_value.real_value) == (3500.0, 3500.0, 800.0)
    assert arming.value.boolean_value == 1
    assert dronecan.get_active_union_field(arming.min_value) == "empty"


def test_a_set_value_applies_at_once_within_its_limits(bench: Bench) -> None:
    end = bench.device()
    node = bench.node(99)
    status, extended = listen(node, esc.Status), listen(node, esc.StatusExtended)
    assert get_parameter(bench, node, "ESC_INDEX", integer_value=4).value.integer_value == 4
    assert get_parameter(bench, node, "ESC_INDEX", integer_value=15).value.integer_value == 4, "beyond its limit"
    assert get_parameter(bench, node, "ESC_INDEX", string_value="five").value.integer_value == 4
    assert get_parameter(bench, node, "FULL_RPM", real_value=float("nan")).value.real_value == 3500.0
    assert get_parameter(bench, node, "FULL_RPM", real_value=4000.0).value.real_value == 4000.0
    assert get_parameter(bench, node, "REQUIRE_ARMING", boolean_value=0).value.boolean_value == 0
    assert bytes(get_parameter(bench, node, "NOTHING").name) == b""
    status.clear()
    arm(node, 0)  # which nothing requires any more
    node.broadcast(esc.RawCommand(cmd=[8191] * 4 + [-8191, 0, 0, 0, 0, 8191]))
    bench.run()
    assert end.stm32.pwm_us == [1100, 1500, 1500, 1500, 1500, 1900]
    assert {event.message.esc_index: event.message.rpm for event in status}[9] == 4000
    bench.run(1.0)
    last = {event.message.esc_index: event.message for event in extended}
    assert set(last) >= {4, 9}
    assert {each.input_pct for each in last.values()} <= {0, 100}


def test_saved_values_survive_a_restart_and_others_do_not(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "parameters.json"
    end = bench.device(stored=str(path))
    node = bench.node(99)
    nodes = listen(node, protocol.NodeStatus)
    bench.run(3.0)
    get_parameter(bench, node, "ESC_INDEX", integer_value=2)
    get_parameter(bench, node, "CAN_NODE", integer_value=21)
    stored = send_request(bench, node, protocol.param.ExecuteOpcode.Request(opcode=SAVE))
    assert (stored.ok, stored.argument) == (True, 0)
    assert not send_request(bench, node, protocol.param.ExecuteOpcode.Request(opcode=7)).ok
    get_parameter(bench, node, "FULL_RPM", real_value=5000.0)  # and not stored
    arm(node)
    node.broadcast(esc.RawCommand(cmd=[0, 0, 8191]))
    bench.run()
    assert end.stm32.pwm_us[0] == 1900
    assert not send_request(bench, node, protocol.RestartNode.Request(magic_number=1)).ok
    assert end.stm32.pwm_us[0] == 1900
    nodes.clear()
    assert send_request(bench, node, protocol.RestartNode.Request(magic_number=0xACCE551B1E)).ok
    assert end.stm32.pwm_us == [1500] * 6, "it stops before it restarts"
    bench.run(0.1)
    assert nodes[-1].transfer.source_node_id == 21
    assert nodes[-1].message.uptime_sec == 0
    node.broadcast(esc.RawCommand(cmd=[0, 0, 8191]))
    bench.run()
    assert end.stm32.pwm_us == [1500] * 6, "nothing has armed it again"
    request = protocol.param.GetSet.Request(name="FULL_RPM")
    assert send_request(bench, node, request, 21).value.real_value == 3500.0
    assert ParameterStore((Parameter("ESC_INDEX", 0, (0, 14)), Parameter("CAN_NODE", 20, (0, 127)),
                           Parameter("FULL_RPM", 3500.0, (800.0, 74e3)), Parameter("REQUIRE_ARMING", True)),
                          str(path))["ESC_INDEX"] == 2  # fmt: skip
    assert send_request(bench, node, protocol.param.ExecuteOpcode.Request(opcode=ERASE), 21).ok
    assert send_request(bench, node, protocol.RestartNode.Request(magic_number=0xACCE551B1E), 21).ok
    bench.run(0.1)
    assert nodes[-1].transfer.source_node_id == 20


def test_a_device_without_a_set_number_requests_one_after_a_restart(bench: Bench) -> None:
    end = bench.device(node_id=0)
    protocol_end: Any = end.link.protocol
    assert protocol_end.node_id == 0
    protocol_end._enter(33)
    node = bench.node(99)
    assert send_request(bench, node, protocol.RestartNode.Request(magic_number=0xACCE551B1E), 33).ok
    bench.run(0.1)
    assert protocol_end.node_id == 0
    responses: list[Any] = []
    node.request(protocol.GetNodeInfo.Request(), 33, responses.append, timeout=0.0)
    bench.run()
    assert responses in ([], [None]), "the old node number no longer answers"


def test_transport_statistics_are_counted(bench: Bench) -> None:
    bench.device()
    node = bench.node(99)
    bench.run(0.1)
    first = send_request(bench, node, protocol.GetTransportStats.Request())
    bench.run(0.1)
    second = send_request(bench, node, protocol.GetTransportStats.Request())
    assert second.transfers_tx > first.transfers_tx > 0
    assert second.transfers_rx == first.transfers_rx + 1
    assert second.transfer_errors == 0
    before, after = first.can_iface_stats[0], second.can_iface_stats[0]
    assert after.frames_tx - before.frames_tx >= second.transfers_tx - first.transfers_tx
    assert after.frames_rx > before.frames_rx


def test_the_host_node_answers_services_and_does_not_restart(bench: Bench) -> None:
    link, node = bench.host(), bench.node(99)
    responses: list[Any] = []
    link.tick(bench.now_ns)
    for request in (
        protocol.GetTransportStats.Request(), protocol.param.GetSet.Request(),
        protocol.RestartNode.Request(magic_number=0xACCE551B1E), protocol.param.ExecuteOpcode.Request(opcode=SAVE),
    ):  # fmt: skip
        node.request(request, 10, responses.append)
        bench.run()
        link.receive()
        bench.run()
    stats, parameter, restart, opcode = (event.response for event in responses)
    assert stats.transfers_tx > 0
    assert bytes(parameter.name) == b""
    assert (restart.ok, opcode.ok) == (False, True)


def test_an_rpm_command_drives_our_stm32(bench: Bench) -> None:
    end, node = bench.device(), bench.node(99)
    arm(node)
    node.broadcast(esc.RPMCommand(rpm=[round((pulse - 1500) * 8.75) for pulse in PULSES]))
    bench.run()
    assert end.stm32.pwm_us == list(PULSES)
    node.broadcast(esc.RPMCommand(rpm=[131071, -131072]))
    bench.run()
    assert end.stm32.pwm_us == [1900, 1100, 1500, 1500, 1500, 1500]


def test_our_host_sends_rpm_commands_to_controllers_with_higher_indices(bench: Bench) -> None:
    link, node = bench.host(own_device=False, command="rpm", esc_index=8), bench.node(50)
    received = listen(node, esc.RPMCommand)

    def on_command(event: Any) -> None:
        for index, rpm in enumerate(event.message.rpm):
            event.node.broadcast(esc.Status(esc_index=index, rpm=rpm))

    node.add_handler(esc.RPMCommand, on_command)
    node.broadcast(esc.StatusExtended(esc_index=9, motor_temperature_degC=-7, status_flags=0x7FFFF))
    link.send(ThrusterCommand(3, True, PULSES))
    bench.run()
    (telemetry,) = link.receive()
    assert (telemetry.sequence, telemetry.pwm_us) == (3, PULSES)
    assert list(received[0].message.rpm)[:8] == [0] * 8
    extended = link.protocol.extended[9]  # type: ignore[attr-defined]
    assert (extended.motor_temperature_c, extended.status_flags) == (-7, 0x7FFFF)


def payload_of(message: Any) -> bytes:
    return bytes(dronecan.transport.Transfer(payload=message, source_node_id=1).payload)


def test_payloads_equal_those_of_the_reference_implementation() -> None:
    source = random.Random(5)
    for count in range(21):
        rpm = [source.randrange(-(1 << 17), 1 << 17) for _ in range(count)]
        assert pack_rpm_command(rpm) == payload_of(esc.RPMCommand(rpm=rpm))
        assert unpack_rpm_command(pack_rpm_command(rpm)) == rpm
        status = EscStatusExtended(
            source.randrange(128), source.randrange(128), source.randrange(-256, 256), source.randrange(512),
            source.randrange(1 << 19), source.randrange(32),
        )  # fmt: skip
        names = ("input_pct", "output_pct", "motor_temperature_degC", "motor_angle", "status_flags", "esc_index")
        assert pack_status_extended(status) == payload_of(esc.StatusExtended(**dict(zip(names, status, strict=True))))
        assert unpack_status_extended(pack_status_extended(status)) == status


def test_signatures_and_sizes_equal_those_of_the_reference_implementation() -> None:
    kinds = {
        "GET_SET": protocol.param.GetSet, "EXECUTE_OPCODE": protocol.param.ExecuteOpcode,
        "RESTART_NODE": protocol.RestartNode, "GET_TRANSPORT_STATS": protocol.GetTransportStats,
    }  # fmt: skip
    for name, kind in kinds.items():
        function = getattr(services, name)
        theirs = data_type(kind.default_dtid, kind.get_data_type_signature(), function.max_size)
        assert function == theirs
        assert function.max_size == (kind.get_max_bitlen_request() + 7) // 8


def test_any_bytes_are_decoded_as_a_request_or_refused() -> None:
    source = random.Random(3)
    protocols: list[Any] = [host(), device()]
    for _ in range(3000):
        data = source.randbytes(source.randrange(30))
        unpacked = services.unpack_get_set(data)
        assert unpacked is None or isinstance(unpacked, GetSet)
        assert services.unpack_opcode(data) in (None, *range(256))
        for end in protocols:
            if unpacked:
                services.pack_description(end.parameters.answer(unpacked))
    assert services.unpack_get_set(b"\x00\x01" + struct.pack("<q", -2) + b"AB") == GetSet(0, -2, "AB")


@pytest.mark.parametrize("text", ["{", '{"ESC_INDEX": 99}', '{"ESC_INDEX": "x"}', '{"FLY": 1}', "[" * 10_000])
def test_an_invalid_parameter_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "parameters.json"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"stored: .*parameters\.json"):
        device(stored=str(path))
    assert not ParameterStore((), "/proc/none/file").execute(SAVE), "its folder cannot be made"


def test_indices_beyond_a_command_are_refused() -> None:
    for end in (host, device):
        end(6, esc_index=14)
        with pytest.raises(ConfigError, match="esc_index: 6 thrusters from 15 on"):
            end(6, esc_index=15)
