"""From packets to the vehicle and back: what each message does, who may send it, and what is sent by itself."""

from collections.abc import Callable, Iterable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autonomy.control.controller import down_in_body
from hil.common import __version__
from hil.common.clock import seconds_ns
from hil.gateways.mavlink import commands
from hil.gateways.mavlink.accessories import CHANNELS, STICK_CHANNELS
from hil.gateways.mavlink.buttons import Buttons
from hil.gateways.mavlink.commands import Commands
from hil.gateways.mavlink.core import MINUTE_NS, Core, mission_current
from hil.gateways.mavlink.flight import modes, targets
from hil.gateways.mavlink.flight.sticks import CENTRED
from hil.gateways.mavlink.messages import GIVEN, GROUND, OWN_SENSORS, REFUSED, TAKEN, UNANSWERED
from hil.gateways.mavlink.newer_messages import ProtocolVersion
from hil.gateways.mavlink.parameter_table import GATEWAY
from hil.gateways.mavlink.peer import COMPONENT, Peer
from hil.gateways.mavlink.protocols.ftp import FtpServer, ftp_message
from hil.gateways.mavlink.protocols.streams import HEARTBEAT, MISSION_CURRENT, number_of
from hil.gateways.mavlink.snapshot import Context
from hil.gateways.mavlink.telemetry import BUILDERS, status_text
from hil.links.mavlink.reports import MAVLINK_VERSION

OLD_REQUESTS = {  # command -> the message that it asks for
    dialect.MAV_CMD_REQUEST_PROTOCOL_VERSION: ProtocolVersion.id,
    dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
    dialect.MAV_CMD_GET_HOME_POSITION: dialect.MAVLINK_MSG_ID_HOME_POSITION,
}
# Commands that change nothing: partners without the right to command may send them.
ASKING = {
    dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_GET_MESSAGE_INTERVAL,
    *OLD_REQUESTS,
}  # fmt: skip
ARDUSUB = 4, 6, 0  # the version whose parameters and behaviour this vehicle follows
HOME_POSITION, GPS_GLOBAL_ORIGIN = number_of("HOME_POSITION"), number_of("GPS_GLOBAL_ORIGIN")
LEVEL = 0.02  # rad: roll and pitch below it count as level
Handler = Callable[[Peer, Any, int], None]


class Dispatcher:
    """Handles the packets of all peers for one vehicle."""

    def __init__(self, core: Core, ftp: FtpServer) -> None:
        self.core = core
        self.peers: dict[int, Peer] = {}
        self.stale = False  # whether what is being read has waited too long to be executed
        self._ftp = ftp
        self._commands = Commands(core)
        self._buttons = Buttons(core)
        self._text_number = 0
        self._handlers: dict[int, Handler] = {
            getattr(dialect, f"MAVLINK_MSG_ID_{name}"): getattr(self, f"_{row.handler}") for name, row in TAKEN.items()
        }
        self._changing = {getattr(dialect, f"MAVLINK_MSG_ID_{name}") for name, row in TAKEN.items() if row.changes}

    def handle(self, peer: Peer, packet: Any, now: int) -> None:
        """Execute a packet, if it is addressed to us and its sender has the right."""
        number = packet.get_msgId()
        handle = self._handlers.get(number)
        if packet.get_srcSystem() == self.core.system and packet.get_srcComponent() == COMPONENT:
            return
        target = getattr(packet, "target_system", getattr(packet, "target", 0))
        if target not in (0, self.core.system):
            return
        component = getattr(packet, "target_component", 0)
        if component not in (0, COMPONENT):
            return
        if number in self._changing and not peer.may_command:
            self._deny(peer, packet)
            return
        if handle:
            handle(peer, packet, now)
        else:
            self._refuse(packet, now)

    def _refuse(self, packet: Any, now: int) -> None:
        """Report a message that asks for something which this vehicle does not do."""
        name = packet.get_type()
        reason = REFUSED.get(name) or (OWN_SENSORS if name in GIVEN and packet.get_srcSystem() >= GROUND else "")
        if reason or (getattr(packet, "target_system", 0) == self.core.system and name not in UNANSWERED):
            self.core.complain(f"{name} is not taken: {reason or 'this vehicle has no use for it'}", now)

    def tick(self, now: int, wall_ns: int) -> None:
        """Send each peer the messages that are due, and new ones to all. To be called behind `Core.tick`."""
        core = self.core
        for name, reason in core.port.pop_settled():
            self._broadcast(core.table.messages(name))
            if reason:
                core.texts.append((4, reason))
        while core.texts:
            self._text_number = self._text_number % 0xFFFF + 1
            self._broadcast(status_text(*core.texts.popleft(), self._text_number))
        while core.messages:
            self._broadcast([core.messages.popleft()])
        reached, core.flight.reached[:] = list(core.flight.reached), []
        self._broadcast([dialect.MAVLink_mission_item_reached_message(index) for index in reached])
        due = core.missions.tick(now)
        if due and due[0][0] in self.peers:
            self.peers[due[0][0]].send(*due[1])
        self._send_streams(now, core.context(now, wall_ns))

    def messages(self, number: int, context: Context) -> list[Any]:
        """Return the message with that id as it is now, nothing if there is none; several of ESCs and named values."""
        message = self._message(number, context)
        return message if isinstance(message, list) else [] if message is None else [message]

    def _message(self, number: int, context: Context) -> Any:
        core = self.core
        if number == HEARTBEAT:
            return self._own_heartbeat() if core.snapshot else None  # without a vehicle there is none
        if number == MISSION_CURRENT:
            return mission_current(core)
        build = BUILDERS.get(number)
        return build(core.snapshot, context) if build and core.snapshot else None

    def _send_streams(self, now: int, context: Context) -> None:
        messages: dict[int, list[Any]] = {}  # a message is made once for all peers
        for peer in self.peers.values():
            for number in peer.rates.due(now):
                if number not in messages:
                    messages[number] = self.messages(number, context)
                if messages[number]:
                    peer.send(*messages[number])
            peer.flush()

    def _own_heartbeat(self) -> Any:
        core = self.core
        status = dialect.MAV_STATE_ACTIVE if core.pilot.armed else dialect.MAV_STATE_STANDBY
        return dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_SUBMARINE,
            dialect.MAV_AUTOPILOT_ARDUPILOTMEGA if core.is_ardupilot else dialect.MAV_AUTOPILOT_GENERIC,
            modes.base_mode(core.pilot.mode, core.pilot.armed), core.pilot.mode,
            status, MAVLINK_VERSION,
        )  # fmt: skip

    def _broadcast(self, messages: Iterable[Any]) -> None:
        for message in messages:
            for peer in self.peers.values():
                peer.send(message)

    def _deny(self, peer: Peer, packet: Any) -> None:
        """Answer a sender without the right to command that nothing was changed."""
        if not peer.denied:
            self.core.texts.append((4, f'{peer.name} may only look: commands_from = "localhost"'))
        peer.denied += 1
        if packet.get_msgId() in (
            dialect.MAVLINK_MSG_ID_MISSION_COUNT, dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT,
            dialect.MAVLINK_MSG_ID_MISSION_ITEM, dialect.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
        ):  # fmt: skip
            peer.send(*self.core.missions.refuse(packet, _partner(peer, packet)))
        elif packet.get_msgId() == dialect.MAVLINK_MSG_ID_PARAM_SET:
            peer.send(*self.core.table.messages(packet.param_id))

    def _heartbeat(self, _: Peer, packet: Any, now: int) -> None:
        if packet.type == dialect.MAV_TYPE_GCS:
            self.core.on_ground_station_heartbeat(now)

    def _ping(self, peer: Peer, packet: Any, _: int) -> None:
        if not packet.target_system:
            target = packet.get_srcSystem(), packet.get_srcComponent()
            peer.send(dialect.MAVLink_ping_message(packet.time_usec, packet.seq, *target))

    def _timesync(self, peer: Peer, packet: Any, now: int) -> None:
        if packet.tc1 == 0:
            peer.send(dialect.MAVLink_timesync_message(now, packet.ts1))

    def _command(self, peer: Peer, packet: Any, now: int) -> None:
        request, partner = commands.read_command(packet), _partner(peer, packet)

        def settled(result: int) -> None:
            message = dialect.MAVLink_command_ack_message(request.command, result, 0, 0, *partner[1:])
            peer.send(message)

        if request.command in ASKING:
            messages, result = self._answer(peer, request.command, request.params, now)
            settled(result)
            peer.send(*messages)
        elif not peer.may_command:
            self._deny(peer, packet)
            settled(commands.DENIED)
        else:
            self._commands.execute(request, now, settled)

    def _answer(self, peer: Peer, command: int, params: tuple[float, ...], now: int) -> tuple[list[Any], int]:
        """Return what a question asks for, and its MAV_RESULT."""
        first = params[0] if params[0] == params[0] and abs(params[0]) < 2**24 else -1.0
        if command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            return [], commands.ACCEPTED if peer.rates.set_interval(int(first), params[1]) else commands.DENIED
        if command == dialect.MAV_CMD_GET_MESSAGE_INTERVAL:
            interval = peer.rates.interval_us(int(first))
            return [dialect.MAVLink_message_interval_message(max(0, int(first)) & 0xFFFF, interval)], commands.ACCEPTED
        number = OLD_REQUESTS.get(command, int(first))
        messages = self._requested(number, now)
        if not messages and number in (HOME_POSITION, GPS_GLOBAL_ORIGIN):
            self.core.complain("no origin yet: send SET_GPS_GLOBAL_ORIGIN, or give the world one", now)
            return [], commands.REJECTED
        return messages, commands.ACCEPTED if messages else commands.UNSUPPORTED

    def _requested(self, number: int, now: int) -> list[Any]:
        """Return the message with that id, asked for once; nothing if there is none."""
        if number == dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return [self._version()]
        if number == ProtocolVersion.id:
            return [ProtocolVersion()]
        return self.messages(number, self.core.context(now, now))

    def _version(self) -> Any:
        kind = "MAV_PROTOCOL_CAPABILITY_"
        texts = (
            "MISSION_INT", "COMMAND_INT", "PARAM_FLOAT", "FTP", "MAVLINK2", "SET_POSITION_TARGET_LOCAL_NED",
            "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET", "PARAM_ENCODE_C_CAST",
        )  # fmt: skip
        capabilities = 0
        for word in texts:
            capabilities |= getattr(dialect, kind + word)
        own = [int(part) for part in __version__.split(".") if part.isdigit()] + [0, 0, 0]
        major, minor, patch, *_ = ARDUSUB if self.core.is_ardupilot else own
        version = major << 24 | minor << 16 | patch << 8 | dialect.FIRMWARE_VERSION_TYPE_DEV
        custom = list(__version__.encode().ljust(8, b"\0")[:8])
        return dialect.MAVLink_autopilot_version_message(
            capabilities, version, 0, 0, 0, custom, [0] * 8, [0] * 8, 0, 0, self.core.system
        )

    def _data_stream(self, peer: Peer, packet: Any, now: int) -> None:
        group = packet.req_stream_id
        if not peer.rates.set_group(group, packet.req_message_rate, packet.start_stop == 1):
            self.core.complain(f"REQUEST_DATA_STREAM {group}: no such group, see MAV_DATA_STREAM", now, MINUTE_NS)

    def _parameter_list(self, peer: Peer, _packet: Any, _now: int) -> None:
        peer.send_later(self.core.table.messages())

    def _parameter_read(self, peer: Peer, packet: Any, _: int) -> None:
        index, names = packet.param_index, self.core.table.names()
        if index < len(names):
            peer.send(*self.core.table.messages(packet.param_id if index < 0 else names[index]))

    def _parameter_set(self, _: Peer, packet: Any, _now: int) -> None:
        """Set one; of one that the slave is to set the value follows when that is done."""
        table, name = self.core.table, packet.param_id.partition("\0")[0]
        reason = table.set(name, packet.param_value)
        if reason:
            self.core.texts.append((4, reason))
        elif table.is_of_slave(name):
            return
        elif GATEWAY[name].group == "stored":
            self.core.texts.append((6, f"{name} is stored, and changes nothing in this vehicle"))
        self._broadcast(table.messages(name))

    def _mission_list(self, peer: Peer, packet: Any, _: int) -> None:
        peer.send(*self.core.missions.request_list(packet, _partner(peer, packet)))

    def _mission_item(self, peer: Peer, packet: Any, _: int) -> None:
        peer.send(*self.core.missions.request_item(packet, _partner(peer, packet), self.core.flight.current))

    def _mission_count(self, peer: Peer, packet: Any, now: int) -> None:
        peer.send(*self.core.missions.begin_upload(packet, _partner(peer, packet), now))

    def _mission_receive(self, peer: Peer, packet: Any, now: int) -> None:
        if packet.current in commands.GO_TO:
            result, partner = self._commands.go_to(packet, now), _partner(peer, packet)
            peer.send(dialect.MAVLink_mission_ack_message(*partner[1:], result, packet.mission_type))
            return
        answers = self.core.missions.receive_item(packet, _partner(peer, packet), now)
        results = [answer.type for answer in answers if answer.get_type() == "MISSION_ACK" and answer.type]
        for result in results:
            name = dialect.enums["MAV_MISSION_RESULT"][result].name.removeprefix("MAV_MISSION_")
            self.core.complain(f"mission: item {packet.seq} is refused: {name}", now)
        peer.send(*answers)

    def _mission_clear(self, peer: Peer, packet: Any, _: int) -> None:
        peer.send(*self.core.missions.clear(packet, _partner(peer, packet)))

    def _mission_select(self, peer: Peer, packet: Any, _: int) -> None:
        if self.core.flight.select(packet.seq):
            self._broadcast([mission_current(self.core)])
        else:
            self.core.texts.append((4, f"mission: no item {packet.seq}"))

    def _file(self, peer: Peer, packet: Any, _: int) -> None:
        _, system, component = _partner(peer, packet)
        answers = self._ftp.handle(bytes(packet.payload), _partner(peer, packet))
        peer.send_later([ftp_message(answer, system, component) for answer in answers])

    def _log_list(self, peer: Peer, packet: Any, _: int) -> None:
        """Answer that there are none: this protocol sends files without names, and its clients take them for .bin."""
        peer.send(dialect.MAVLink_log_entry_message(0, 0, 0, 0, 0))
        self.core.texts.append((6, "recordings: by MAVFTP, in /logs, with their names"))

    def _ignore(self, *_: Any) -> None:
        """Do nothing: the message only confirms what was sent."""

    def _set_mode(self, peer: Peer, packet: Any, now: int) -> None:
        result = self.core.set_mode(packet.custom_mode)
        # ArduPilot acknowledges the message by its number; scripts wait for the command that does the same.
        for number in (dialect.MAVLINK_MSG_ID_SET_MODE, dialect.MAV_CMD_DO_SET_MODE):
            peer.send(dialect.MAVLink_command_ack_message(number, result, 0, 0, *_partner(peer, packet)[1:]))

    def _manual_control(self, peer: Peer, packet: Any, now: int) -> None:
        pilot = self.core.pilot
        if pilot.joystick.receive(packet, _partner(peer, packet), now, pilot.timeout_ns, self.stale):
            if not pilot.armed and pilot.joystick.sticks(now) != CENTRED:
                self.core.complain("sticks move nothing: arm first", now, MINUTE_NS)
            self._buttons.receive(packet.buttons | packet.buttons2 << 16, now)
            self.core.expedite()
        elif not self.stale:
            self.core.complain("another sender holds the sticks", now)

    def _rc_override(self, peer: Peer, packet: Any, now: int) -> None:
        core = self.core
        lasts_ns = seconds_ns(core.table["RC_OVERRIDE_TIME"])
        changed = core.pilot.joystick.override(packet, _partner(peer, packet), now, lasts_ns, self.stale)
        if changed is None:
            if not self.stale:
                core.complain("another sender holds the sticks", now)
            return
        for channel, pulse in changed.items():
            if channel in CHANNELS and pulse:
                core.accessories.set_named(CHANNELS[channel], pulse)
            elif channel > STICK_CHANNELS and pulse:
                core.complain(f"RC channel {channel} moves nothing", now)
            elif pulse and not core.pilot.armed:
                core.complain("RC channels 1 to 6 move nothing: arm first", now)
        core.expedite()

    def _local_target(self, _: Peer, packet: Any, now: int) -> None:
        self._set_target(lambda state: targets.local_target(packet, state), now)

    def _global_target(self, _: Peer, packet: Any, now: int) -> None:
        core = self.core
        self._set_target(lambda state: targets.global_target(packet, state, core.origin, core.home[2]), now)

    def _attitude_target(self, _: Peer, packet: Any, now: int) -> None:
        core = self.core
        self._set_target(lambda _: targets.attitude_target(packet, core.table["PILOT_SPEED_UP"]), now)
        down = down_in_body(packet.q)
        if not packet.type_mask & targets.NO_ATTITUDE and max(abs(down[0]), abs(down[1])) > LEVEL:
            core.complain("target: roll and pitch stay level, the heading is followed", now)

    def _set_target(self, read: Callable[[Any], targets.Target], now: int) -> None:
        core = self.core
        if core.snapshot is None or self.stale:
            return
        try:
            reason = core.pilot.set_target(read(core.snapshot.state), now)
        except targets.TargetError as error:
            reason = f"target: {error}"
        if reason:
            core.complain(reason, now)
        else:
            core.expedite()

    def _set_origin(self, _: Peer, packet: Any, now: int) -> None:
        reason = self.core.set_origin(commands.origin_of(packet))
        if reason:
            self.core.texts.append((4, reason))
            return
        context = self.core.context(now, now)
        for number in (GPS_GLOBAL_ORIGIN, HOME_POSITION):
            self._broadcast(self.messages(number, context))


def _partner(peer: Peer, packet: Any) -> tuple[int, int, int]:
    return peer.number, packet.get_srcSystem(), packet.get_srcComponent()
