"""A MAVLink vehicle of the gateway without a network: a point as vehicle, and ground stations as partners."""

from collections.abc import Callable, Mapping, Sequence
from math import cos, sin
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autonomy.control.controller import VelocityCommand, wrap
from hil.client.samples import State
from hil.common.clock import NS_PER_S
from hil.gateways.mavlink.core import Core
from hil.gateways.mavlink.dispatch import Dispatcher
from hil.gateways.mavlink.flight.modes import Mode
from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.gateways.mavlink.peer import Peer
from hil.gateways.mavlink.protocols.ftp import FtpServer
from hil.gateways.mavlink.snapshot import Command, Echo, Origin, Snapshot, ThrusterTest, Wrench
from hil.gateways.mavlink.vehicle_port import NetworkVehicle
from hil.links.contract import Counters
from hil.links.mavlink.servos import ServoOutputRaw
from hil.links.mavlink.stream import MavlinkStream
from hil.ros.commands import PoseCommand
from hil.ros.joints import MotorState
from hil.scenario.mavlink_records import Mavlink
from sim.sensors.extra_samples import BatterySample
from sim.sensors.samples import ImuSample

TICK_NS = NS_PER_S // 50
ORIGIN = Origin(45.0, 10.0, 0.0)


class PointVehicle(NetworkVehicle):
    """A vehicle that has the commanded velocity at once, 2 m deep at first, without a network."""

    def __init__(self) -> None:
        self.north, self.east, self.depth, self.heading = 0.0, 0.0, 2.0, 0.0
        self.nu = [0.0] * 6
        self.commands: list[Command] = []
        self.refused = ""
        self.is_present = True
        self.is_disarmed = False
        self.armed_calls: list[bool] = []
        self.values: dict[str, float] = {"HIL_G_SURGE_P": 4.0}
        self.settled: list[tuple[str, str]] = []
        self.accessories: dict[str, float] = {}
        self.leak = False
        self.battery: BatterySample | None = None
        self.echo: Echo | None = None
        self.motors: tuple[MotorState, ...] = ()

    def move(self, seconds: float) -> None:
        """Move by the last command for this time."""
        command = self.commands[-1] if self.commands else None
        surge = sway = heave = yaw_rate = 0.0
        if isinstance(command, VelocityCommand):
            surge, sway, heave, yaw_rate = command[:4]
            if command.depth is not None:
                heave = max(-0.5, min(0.5, command.depth - self.depth))
            if command.heading is not None:
                yaw_rate = max(-1.0, min(1.0, 3.0 * wrap(command.heading - self.heading)))
        elif isinstance(command, PoseCommand):
            self.north, self.east, self.depth = command.position
            self.heading = command.heading
        self.nu = [surge, sway, heave, 0.0, 0.0, yaw_rate]
        self.north += seconds * (surge * cos(self.heading) - sway * sin(self.heading))
        self.east += seconds * (surge * sin(self.heading) + sway * cos(self.heading))
        self.depth = max(0.0, self.depth + seconds * heave)
        self.heading = wrap(self.heading + seconds * yaw_rate)

    def pushed(self) -> Wrench:
        """Return the last command, which is a wrench."""
        command = self.commands[-1]
        assert not isinstance(command, (VelocityCommand, PoseCommand, ThrusterTest))
        return command

    @property
    def state(self) -> State:
        half = 0.5 * self.heading
        nu = tuple(self.nu)
        return State(0, (self.north, self.east, self.depth), (cos(half), 0.0, 0.0, sin(half)), nu)  # type: ignore[arg-type]

    def snapshot(self) -> Snapshot | None:
        if not self.is_present:
            return None
        sensors = frozenset(("imu", "odom", "pressure"))
        return Snapshot(
            self.state, self.battery, 121_325.0, self.echo, pulses=(1500,) * 6, motors=self.motors, leak=self.leak,
            sensors=sensors, imu=ImuSample(0, (1.0, 0.0, 0.0, 0.0), (0.1, 0.0, -0.2), (0.0, 0.0, -9.80665)),
            field=(20e-6, 0.0, 40e-6), disarmed=self.is_disarmed,
        )  # fmt: skip

    def send(self, command: Command) -> None:
        self.commands.append(command)

    def refusal(self) -> str:
        return self.refused

    def arm(self) -> None:
        self.armed_calls.append(True)

    def set_accessory(self, name: str, share: float) -> None:
        self.accessories[name] = share

    def parameters(self) -> Mapping[str, float]:
        return self.values

    def set_parameter(self, name: str, value: float) -> None:
        self.values[name] = value
        self.settled.append((name, ""))

    def pop_settled(self) -> list[tuple[str, str]]:
        settled, self.settled = self.settled, []
        return settled


class Bench:
    """A vehicle, its dispatcher and its partners; the test advances the time."""

    def __init__(
        self,
        settings: Mavlink = Mavlink(),
        origin: Origin | None = ORIGIN,
        folder: str = "",
        motors: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.now = NS_PER_S
        self.vehicle = PointVehicle()
        self.table = ParameterTable("", self.vehicle.parameters, self.vehicle.set_parameter)
        self.core = Core(self.vehicle, settings, self.table, origin, self.now, motors)
        self.dispatcher = Dispatcher(self.core, FtpServer(folder, self.table))
        self.partners: list[Partner] = []
        self.partner = self.add_partner()
        self.run(0.1)
        self.partner.received.clear()

    def add_partner(self, system: int = 255, may_command: bool = True) -> "Partner":
        """Return a new partner."""
        partner = Partner(self, len(self.partners) + 1, system, may_command)
        self.partners.append(partner)
        self.dispatcher.peers[partner.peer.number] = partner.peer
        return partner

    def run(self, seconds: float, before_tick: Callable[[], None] | None = None) -> None:
        """Let time pass, tick by tick; `before_tick` is called before every one."""
        for _ in range(round(seconds * NS_PER_S / TICK_NS)):
            if before_tick:
                before_tick()
            self.now += TICK_NS
            self.vehicle.move(TICK_NS / NS_PER_S)
            self.core.tick(self.now)
            self.dispatcher.tick(self.now, self.now)

    def arm(self, mode: Mode = Mode.MANUAL) -> None:
        """Arm in a mode."""
        assert self.partner.command(dialect.MAV_CMD_DO_SET_MODE, 1, mode) == dialect.MAV_RESULT_ACCEPTED
        assert self.partner.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) == dialect.MAV_RESULT_ACCEPTED


class Partner:
    """A ground station; `received` are its messages."""

    def __init__(self, bench: Bench, number: int, system: int, may_command: bool) -> None:
        self.received: list[Any] = []
        self.packets: list[bytes] = []
        self._bench, self._system = bench, system
        self._in = MavlinkStream(system, 190, Counters())
        self._out = MavlinkStream(system, 190, Counters())
        self.peer = Peer(number, f"partner {number}", 1, self._on_message, may_command)

    def send(self, message: Any) -> None:
        """Send a message to the vehicle."""
        for packet in self.peer.unpack(self._out.pack(message)):
            self._bench.dispatcher.handle(self.peer, packet, self._bench.now)

    def feed(self, data: bytes) -> None:
        """Send bytes to the vehicle."""
        for packet in self.peer.unpack(data):
            self._bench.dispatcher.handle(self.peer, packet, self._bench.now)

    def take_messages(self, kind: str) -> list[Any]:
        """Return and remove the received messages of a kind."""
        found = [message for message in self.received if _kind(message) == kind]
        self.received = [message for message in self.received if _kind(message) != kind]
        return found

    def command(self, command: int, *params: float) -> int | None:
        """Send a COMMAND_LONG; return its result, None if there is none yet."""
        values = [*params, *[0.0] * (7 - len(params))]
        self.take_messages("COMMAND_ACK")
        self.send(dialect.MAVLink_command_long_message(1, 1, command, 0, *values))
        acks = [ack.result for ack in self.take_messages("COMMAND_ACK") if ack.command == command]
        assert len(acks) <= 1
        return acks[0] if acks else None

    def set_parameter(self, name: str, value: float) -> float:
        """Send PARAM_SET; return the value that is reported."""
        self.take_messages("PARAM_VALUE")
        self.send(dialect.MAVLink_param_set_message(1, 1, name.encode(), value, dialect.MAV_PARAM_TYPE_REAL32))
        self._bench.run(0.1)
        (reported,) = self.take_messages("PARAM_VALUE")
        assert reported.param_id == name
        return float(reported.param_value)

    def sticks(self, x: int = 0, y: int = 0, z: int = 500, r: int = 0) -> None:
        """Send MANUAL_CONTROL."""
        self.send(dialect.MAVLink_manual_control_message(1, x, y, z, r, 0))

    def heartbeat(self) -> None:
        """Send the heartbeat of a ground station."""
        self.send(dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 0, 3))

    def texts(self) -> str:
        """Return the texts that it received."""
        return " | ".join([text.text for text in self.take_messages("STATUSTEXT")])

    def _on_message(self, packet: bytes, message: Any) -> None:
        self.packets.append(packet)
        if getattr(message, "target_system", 0) > 1:  # 0: for everybody, 1: for a test that speaks as the vehicle
            assert (message.target_system, message.target_component) == (self._system, 190)
        decoded = self._in.unpack(packet)
        self.received += decoded or [message]  # what pymavlink does not know yet is taken as it was


def _kind(message: Any) -> str:
    return "SERVO_OUTPUT_RAW" if isinstance(message, ServoOutputRaw) else str(message.get_type())
