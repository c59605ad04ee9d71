"""The link contract on pseudo terminals, and a ground station's own software on one."""

import os
import select
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_stub.serve import serve
from firmware_stub.stub import Stm32, Stm32End
from hil.links.contract import Counters, Protocol, ThrusterCommand, ThrusterLink, ThrusterTelemetry, Wire
from hil.links.mavlink.stream import MavlinkStream
from hil.links.protocols import Role, open_protocol
from hil.links.wires.terminal import PtyHostWire, PtyWire
from tests.support.links.link_contract import PATIENCE_S, Ends, LinkContract, command, read_messages, wait_readable
from tests.support.links.mavlink_peer import KEY, MS

# The number that arrives is the packet's, and a report's age counts from the first that shows its command.
COMMANDS_CARRY = ("armed", "pwm_us")
REPORTS_CARRY = tuple(field for field in ThrusterTelemetry._fields if field != "age_us")


def pty_pair() -> tuple[Wire, Wire]:
    device = PtyWire()
    return device, PtyHostWire(device.path)


class TestServoOutputsOnPty(LinkContract):
    """Servo outputs on a pty: both ends have received that the device is armed; otherwise the first command is two."""

    open_wires = staticmethod(pty_pair)
    protocol = "mavlink"
    commands_carry = COMMANDS_CARRY
    reports_carry = REPORTS_CARRY

    def protocol_of(self, role: Role, channels: int) -> Protocol:
        end = open_protocol("mavlink", role, channels, **self.settings)
        peer = MavlinkStream(*((1, 1) if role == "host" else (255, 190)), Counters())
        if "signing_key" in self.settings:
            peer.sign(KEY, time.time_ns)
        armed = dialect.MAVLink_heartbeat_message(12, 0, dialect.MAV_MODE_FLAG_SAFETY_ARMED, 0, 4, 3)
        arming = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1.0, *[0.0] * 6)
        end.feed(peer.pack(armed if role == "host" else arming))
        end.replies()
        return end

    def test_an_stm32_is_commanded_over_the_link(self, ends: Ends) -> None:
        stm32 = Stm32(16, telemetry_period_ns=10**9)
        end = Stm32End(stm32, ends.device)
        end.service(1)
        (power_up,) = read_messages(ends.host, 1)
        while ends.host.counters.bytes_in < ends.device.counters.bytes_out and wait_readable(ends.host.wire):
            ends.host.receive()  # the heartbeat, if it was not there yet: disarmed
        assert isinstance(power_up, ThrusterTelemetry)
        assert (power_up.sequence, power_up.pwm_us) == (0, (1500,) * 16)
        order = command(99, 16)
        ends.host.send(order)
        taken = 0
        while taken < 2:  # to arm, and the pulses
            assert select.select([end.fileno()], [], [], PATIENCE_S)[0]
            taken += end.service(5_000)
        received = read_messages(ends.host, 2)
        wanted = ThrusterTelemetry(99, True, False, order.pwm_us, 0, 1, 0, 0)
        self.assert_same(received, [wanted._replace(sequence=0, pwm_us=(1500,) * 16), wanted])
        assert stm32.pwm_us == list(order.pwm_us)


class TestSignedServoOutputsOnPty(TestServoOutputsOnPty):
    settings: ClassVar[dict[str, Any]] = {"signing_key": KEY.hex()}


class TestRcOverrideOnPty(TestServoOutputsOnPty):
    settings: ClassVar[dict[str, Any]] = {"command": "rc_channels_override"}


Served = Callable[..., Stm32End]


@pytest.fixture
def serve_boards() -> Iterator[Served]:
    """Start STM32s that each serve a pty in a thread of their own; they end with the test."""
    stop_read, stop_write = os.pipe()
    threads: list[threading.Thread] = []

    def start(channels: int = 6, **settings: Any) -> Stm32End:
        link = ThrusterLink(PtyWire(), open_protocol("mavlink", "device", channels, **settings))
        end = Stm32End(Stm32(channels, watchdog_ns=1000 * MS), link)
        threads.append(threading.Thread(target=serve, args=(end, stop_read)))
        threads[-1].start()
        return end

    yield start
    os.write(stop_write, b"x")
    for thread in threads:
        thread.join(PATIENCE_S)
        assert not thread.is_alive()
    os.close(stop_read)
    os.close(stop_write)


@pytest.fixture
def connect(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Stm32End], Any]]:
    """Open pymavlink's mavutil, which ground stations in Python use, on an STM32's port."""
    monkeypatch.setenv("MAVLINK20", "1")
    from pymavlink import mavutil  # reads the environment as it is imported

    mavutil.set_dialect("ardupilotmega")
    opened: list[Any] = []

    def connect(end: Stm32End) -> Any:
        wire = end.link.wire
        assert isinstance(wire, PtyWire)
        opened.append(mavutil.mavlink_connection(wire.path, baud=115_200, source_system=255, source_component=190))
        return opened[-1]

    yield connect
    for connection in opened:
        connection.close()


def send_command(ground: Any, number: int, *params: float) -> Any:
    """Send COMMAND_LONG as a ground station does; return its acknowledgement."""
    seven = [*params, *[0] * (7 - len(params))]
    ground.mav.command_long_send(ground.target_system, ground.target_component, number, 0, *seven)
    return ground.recv_match(
        type="COMMAND_ACK", blocking=True, timeout=PATIENCE_S, condition=f"COMMAND_ACK.command=={number}"
    )


def await_message(ground: Any, condition: str) -> Any:
    return ground.recv_match(type="SERVO_OUTPUT_RAW", blocking=True, timeout=PATIENCE_S, condition=condition)


def test_a_ground_station_arms_and_commands_the_outputs(
    serve_boards: Served, connect: Callable[[Stm32End], Any]
) -> None:
    end = serve_boards()
    ground = connect(end)
    beat = ground.wait_heartbeat(timeout=PATIENCE_S)
    assert beat is not None
    assert (beat.type, beat.get_srcComponent(), ground.target_system, ground.mavlink20()) == (12, 1, 1, True)
    assert not ground.motors_armed()
    assert await_message(ground, "SERVO_OUTPUT_RAW.servo1_raw==1500")
    assert send_command(ground, dialect.MAV_CMD_DO_SET_SERVO, 3, 1700).result == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    ground.arducopter_arm()
    assert ground.recv_match(type="HEARTBEAT", blocking=True, timeout=PATIENCE_S)
    assert ground.motors_armed()
    assert send_command(ground, dialect.MAV_CMD_DO_SET_SERVO, 3, 1700).result == dialect.MAV_RESULT_ACCEPTED
    shown = await_message(ground, "SERVO_OUTPUT_RAW.servo3_raw==1700")
    assert [shown.servo1_raw, shown.servo3_raw, shown.servo6_raw, shown.servo7_raw] == [1500, 1700, 1500, 0]
    ground.mav.rc_channels_override_send(1, 1, *range(1601, 1607), 0, 0)
    assert await_message(ground, "SERVO_OUTPUT_RAW.servo6_raw==1606")
    ground.arducopter_disarm()
    assert await_message(ground, "SERVO_OUTPUT_RAW.servo6_raw==1500")
    counters = end.link.counters
    assert (counters.malformed, counters.checksum_errors, counters.dropped_bytes) == (0, 0, 0)


def test_only_a_ground_station_with_the_key_commands(serve_boards: Served, connect: Callable[[Stm32End], Any]) -> None:
    end = serve_boards(signing_key=KEY.hex())
    ground = connect(end)
    assert ground.wait_heartbeat(timeout=PATIENCE_S)
    ground.mav.command_long_send(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
    ground.setup_signing(KEY)
    ack = send_command(ground, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert ack.result == dialect.MAV_RESULT_ACCEPTED
    assert ack.get_signed()
    assert end.link.counters.malformed == 1


def test_a_ground_station_may_watch_on_the_hosts_port(serve_boards: Served, connect: Callable[[Stm32End], Any]) -> None:
    """The vehicle's computer commands; a ground station on the same wire watches and disturbs nothing."""
    end = serve_boards(channels=4)
    ground = connect(end)
    assert ground.wait_heartbeat(timeout=PATIENCE_S)
    host = open_protocol("mavlink", "host", 4)
    for i in range(20):
        ground.write(host.encode(ThrusterCommand(i, True, (1600 + i,) * 4)))
        ground.mav.heartbeat_send(6, 8, 0, 0, 4)
        ground.mav.param_request_list_send(1, 1)
        shown = await_message(ground, f"SERVO_OUTPUT_RAW.servo1_raw=={1600 + i}")
        assert shown.servo4_raw == 1600 + i
    assert end.stm32.refused == end.link.counters.malformed == end.link.counters.dropped_bytes == 0
