"""From packets to the vehicle and back: what each message does, who may send it, and what is sent by itself."""

from collections.abc import Callable, Iterable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common import __version__
from hil.gateways.mavlink import camera
from hil.gateways.mavlink.commands import ACCEPTED, DENIED, GO_TO, UNSUPPORTED, Commands, origin_of, read_command
from hil.gateways.mavlink.core import Core, mission_current
from hil.gateways.mavlink.endpoints.peer import COMPONENT, Peer
from hil.gateways.mavlink.flight import modes
from hil.gateways.mavlink.flight.targets import TargetError, global_target, local_target
from hil.gateways.mavlink.newer_messages import AvailableModes, AvailableModesMonitor
from hil.gateways.mavlink.protocols.ftp import FtpServer, ftp_message
from hil.gateways.mavlink.protocols.signing import SigningKey
from hil.gateways.mavlink.protocols.streams import CURRENT_MODE, HEARTBEAT, MISSION_CURRENT, MODES_MONITOR
from hil.gateways.mavlink.snapshot import Context
from hil.gateways.mavlink.telemetry import BUILDERS
from hil.links.mavlink.reports import MAVLINK_VERSION

CAMERA_MESSAGES = (
    dialect.MAVLINK_MSG_ID_CAMERA_INFORMATION, dialect.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION,
    dialect.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS, dialect.MAVLINK_MSG_ID_CAMERA_SETTINGS,
)  # fmt: skip
# Commands that change nothing: partners without the right to command may send them.
ASKING = {
    dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_GET_MESSAGE_INTERVAL,
    dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, dialect.MAV_CMD_GET_HOME_POSITION,
    dialect.MAV_CMD_REQUEST_CAMERA_INFORMATION, dialect.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION,
    dialect.MAV_CMD_REQUEST_VIDEO_STREAM_STATUS, dialect.MAV_CMD_REQUEST_CAMERA_SETTINGS,
}  # fmt: skip
OLD_REQUESTS = {  # command -> the message that it asks for
    dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
    dialect.MAV_CMD_GET_HOME_POSITION: dialect.MAVLINK_MSG_ID_HOME_POSITION,
    dialect.MAV_CMD_REQUEST_CAMERA_INFORMATION: dialect.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    dialect.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION: dialect.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION,
    dialect.MAV_CMD_REQUEST_VIDEO_STREAM_STATUS: dialect.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS,
    dialect.MAV_CMD_REQUEST_CAMERA_SETTINGS: dialect.MAVLINK_MSG_ID_CAMERA_SETTINGS,
}
ARDUSUB = 4, 6, 0  # the version whose parameters and behaviour this vehicle follows
TEXT_SIZE = 50  # bytes of one STATUSTEXT
Handler = Callable[[Peer, Any, int], None]


class Dispatcher:
    """Handles the packets of all peers for one vehicle. `picture` is the camera with its streams, None without one."""

    def __init__(
        self,
        core: Core,
        ftp: FtpServer,
        picture: camera.CameraInfo | None = None,
        signing: SigningKey | None = None,
    ) -> None:
        self.core, self.picture = core, picture
        self.signing = signing or SigningKey()
        self.peers: dict[int, Peer] = {}
        self.stale = False  # whether what is being read has waited too long to be executed
        self._ftp = ftp
        self._commands = Commands(core)
        self._text_number = 0
        name = "MAVLINK_MSG_ID_"
        table: dict[str, Handler] = {
            "HEARTBEAT": self._heartbeat, "PING": self._ping, "TIMESYNC": self._timesync,
            "COMMAND_LONG": self._command, "COMMAND_INT": self._command,
            "REQUEST_DATA_STREAM": self._data_stream, "PARAM_REQUEST_LIST": self._parameter_list,
            "PARAM_REQUEST_READ": self._parameter_read, "MISSION_REQUEST_LIST": self._mission_list,
            "MISSION_REQUEST_INT": self._mission_item, "MISSION_REQUEST": self._mission_item,
            "FILE_TRANSFER_PROTOCOL": self._file, "LOG_REQUEST_LIST": self._log_list,
        }  # fmt: skip
        changing: dict[str, Handler] = {
            "SET_MODE": self._set_mode, "PARAM_SET": self._parameter_set, "MANUAL_CONTROL": self._manual_control,
            "SET_POSITION_TARGET_LOCAL_NED": self._local_target,
            "SET_POSITION_TARGET_GLOBAL_INT": self._global_target, "MISSION_COUNT": self._mission_count,
            "MISSION_ITEM_INT": self._mission_receive, "MISSION_ITEM": self._mission_receive,
            "MISSION_CLEAR_ALL": self._mission_clear, "MISSION_SET_CURRENT": self._mission_select,
            "SET_GPS_GLOBAL_ORIGIN": self._set_origin, "SETUP_SIGNING": self._setup_signing,
        }  # fmt: skip
        self._handlers = {getattr(dialect, name + word): handle for word, handle in (table | changing).items()}
        self._changing = {getattr(dialect, name + word) for word in changing}

    def handle(self, peer: Peer, packet: Any, now: int) -> None:
        """Execute a packet, if it is addressed to us and its sender has the right."""
        number = packet.get_msgId()
        handle = self._handlers.get(number)
        if handle is None or (packet.get_srcSystem() == self.core.system and packet.get_srcComponent() == COMPONENT):
            return
        target = getattr(packet, "target_system", getattr(packet, "target", 0))
        if target not in (0, self.core.system):
            return
        component = getattr(packet, "target_component", 0)
        if component not in (0, COMPONENT) and not (self.picture and component == camera.COMPONENT):
            return
        if number in self._changing and not peer.may_command:
            self._deny(peer, packet)
            return
        handle(peer, packet, now)

    def tick(self, now: int, wall_ns: int) -> None:
        """Send each peer the messages that are due, and new ones to all. To be called behind `Core.tick`."""
        core = self.core
        for name, reason in core.port.pop_settled():
            self._broadcast(core.parameters.value_of(name))
            if reason:
                core.texts.append((4, reason))
        while core.texts:
            self._broadcast(self._status_text(*core.texts.popleft()))
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
        if number == CURRENT_MODE:
            return modes.current_mode(core.pilot.mode, core.pilot.intended)
        if number == MODES_MONITOR:
            return AvailableModesMonitor(1)
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
                    if number == HEARTBEAT and self.picture:
                        peer.send_as_camera(camera.heartbeat())
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

    def _status_text(self, severity: int, text: str) -> list[Any]:
        """Return STATUSTEXT, several of one number where the text is long."""
        data = text.encode("ascii", "replace")
        if len(data) <= TEXT_SIZE:
            return [dialect.MAVLink_statustext_message(severity, data)]
        self._text_number = self._text_number % 0xFFFF + 1
        chunks = [data[start : start + TEXT_SIZE] for start in range(0, len(data), TEXT_SIZE)]
        if len(chunks[-1]) == TEXT_SIZE:
            chunks.append(b"")  # a chunk that is full is not the last one
        return [
            dialect.MAVLink_statustext_message(severity, chunk, self._text_number, index)
            for index, chunk in enumerate(chunks)
        ]

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
            peer.send(*self.core.parameters.value_of(str(packet.param_id)))

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
        request, partner = read_command(packet), _partner(peer, packet)

        def settled(result: int) -> None:
            message = dialect.MAVLink_command_ack_message(request.command, result, 0, 0, *partner[1:])
            (peer.send_as_camera if packet.target_component == camera.COMPONENT else peer.send)(message)

        if request.command in ASKING:
            messages, result = self._answer(peer, request.command, request.params, now)
            settled(result)
            peer.send(*[message for message in messages if message.get_msgId() not in CAMERA_MESSAGES])
            peer.send_as_camera(*[message for message in messages if message.get_msgId() in CAMERA_MESSAGES])
        elif not peer.may_command:
            self._deny(peer, packet)
            settled(DENIED)
        else:
            self._commands.execute(request, now, settled)

    def _answer(self, peer: Peer, command: int, params: tuple[float, ...], now: int) -> tuple[list[Any], int]:
        """Return what a question asks for, and its MAV_RESULT."""
        first = params[0] if params[0] == params[0] and abs(params[0]) < 2**24 else -1.0
        if command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            return [], ACCEPTED if peer.rates.set_interval(int(first), params[1]) else DENIED
        if command == dialect.MAV_CMD_GET_MESSAGE_INTERVAL:
            interval = peer.rates.interval_us(int(first))
            return [dialect.MAVLink_message_interval_message(max(0, int(first)) & 0xFFFF, interval)], ACCEPTED
        number = OLD_REQUESTS.get(command, int(first))
        messages = self._requested(number, params[1], now)
        return messages, ACCEPTED if messages else UNSUPPORTED

    def _requested(self, number: int, index: float, now: int) -> list[Any]:
        """Return the message with that id, asked for once; nothing if there is none."""
        if number == dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return [self._version()]
        if number == AvailableModes.id:
            return modes.available_modes(int(index) if index == index and 0 <= index < 1000 else 0)
        if self.picture and number in CAMERA_MESSAGES:
            return self._camera_messages(number, now)
        return self.messages(number, self.core.context(now, now))

    def _camera_messages(self, number: int, now: int) -> list[Any]:
        assert self.picture
        if number == dialect.MAVLINK_MSG_ID_CAMERA_INFORMATION:
            return [camera.information(self.picture, now)]
        if number == dialect.MAVLINK_MSG_ID_CAMERA_SETTINGS:
            return [camera.settings(now)]
        if number == dialect.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS:
            return camera.stream_status(self.picture)
        return camera.stream_information(self.picture)

    def _version(self) -> Any:
        kind = "MAV_PROTOCOL_CAPABILITY_"
        texts = (
            "MISSION_INT", "COMMAND_INT", "PARAM_FLOAT", "FTP", "MAVLINK2", "SET_POSITION_TARGET_LOCAL_NED",
            "SET_POSITION_TARGET_GLOBAL_INT", "FLIGHT_TERMINATION", "PARAM_ENCODE_C_CAST",
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

    def _data_stream(self, peer: Peer, packet: Any, _: int) -> None:
        peer.rates.set_group(packet.req_stream_id, packet.req_message_rate, packet.start_stop == 1)

    def _parameter_list(self, peer: Peer, _packet: Any, _now: int) -> None:
        peer.send_later(self.core.parameters.request_list())

    def _parameter_read(self, peer: Peer, packet: Any, _: int) -> None:
        messages, _reason = self.core.parameters.request_read(packet)
        peer.send(*messages)

    def _parameter_set(self, _: Peer, packet: Any, _now: int) -> None:
        messages, texts = self.core.parameters.request_set(packet)
        self._broadcast(messages)
        self.core.texts.extend(texts)

    def _mission_list(self, peer: Peer, packet: Any, _: int) -> None:
        peer.send(*self.core.missions.request_list(packet, _partner(peer, packet)))

    def _mission_item(self, peer: Peer, packet: Any, _: int) -> None:
        peer.send(*self.core.missions.request_item(packet, _partner(peer, packet), self.core.flight.current))

    def _mission_count(self, peer: Peer, packet: Any, now: int) -> None:
        peer.send(*self.core.missions.begin_upload(packet, _partner(peer, packet), now))

    def _mission_receive(self, peer: Peer, packet: Any, now: int) -> None:
        if packet.current in GO_TO:
            result, partner = self._commands.go_to(packet, now), _partner(peer, packet)
            peer.send(dialect.MAVLink_mission_ack_message(*partner[1:], result, packet.mission_type))
            return
        peer.send(*self.core.missions.receive_item(packet, _partner(peer, packet), now))

    def _mission_clear(self, peer: Peer, packet: Any, _: int) -> None:
        peer.send(*self.core.missions.clear(packet, _partner(peer, packet)))

    def _mission_select(self, peer: Peer, packet: Any, _: int) -> None:
        if self.core.flight.select(packet.seq):
            self._broadcast([mission_current(self.core)])
        else:
            self.core.texts.append((4, f"mission: no item {packet.seq}"))

    def _file(self, peer: Peer, packet: Any, now: int) -> None:
        _, system, component = _partner(peer, packet)
        answers = self._ftp.handle(bytes(packet.payload), _partner(peer, packet), now)
        peer.send_later([ftp_message(answer, system, component) for answer in answers])

    def _log_list(self, peer: Peer, packet: Any, _: int) -> None:
        """Answer that there are none: this protocol sends files without names, and its clients take them for .bin."""
        peer.send(dialect.MAVLink_log_entry_message(0, 0, 0, 0, 0))
        self.core.texts.append((6, "recordings: by MAVFTP, in /logs, with their names"))

    def _set_mode(self, peer: Peer, packet: Any, now: int) -> None:
        result = self.core.set_mode(packet.custom_mode)
        command = dialect.MAVLINK_MSG_ID_SET_MODE  # ArduPilot acknowledges the message by its number
        peer.send(dialect.MAVLink_command_ack_message(command, result, 0, 0, *_partner(peer, packet)[1:]))

    def _manual_control(self, peer: Peer, packet: Any, now: int) -> None:
        pilot = self.core.pilot
        if pilot.joystick.receive(packet, _partner(peer, packet), now, pilot.timeout_ns, self.stale):
            self.core.expedite()

    def _local_target(self, _: Peer, packet: Any, now: int) -> None:
        if self.core.snapshot and not self.stale:
            self._set_target(lambda state: local_target(packet, state), now)

    def _global_target(self, _: Peer, packet: Any, now: int) -> None:
        core = self.core
        if core.snapshot and not self.stale:
            self._set_target(lambda state: global_target(packet, state, core.origin, core.home[2]), now)

    def _set_target(self, read: Callable[[Any], Any], now: int) -> None:
        core = self.core
        assert core.snapshot
        try:
            if core.pilot.set_target(read(core.snapshot.state), now):
                core.expedite()
        except TargetError as error:
            core.texts.append((4, f"target: {error}"))

    def _set_origin(self, _: Peer, packet: Any, _now: int) -> None:
        origin = origin_of(packet)
        if origin is None or not self.core.set_origin(origin):
            self.core.texts.append((4, "the origin is given already, or none"))

    def _setup_signing(self, peer: Peer, packet: Any, _now: int) -> None:
        reason = self.signing.refusal(peer.is_local, self.core.pilot.armed)
        if reason:
            self.core.texts.append((4, reason))
            return
        reason = self.signing.set(bytes(packet.secret_key))
        self.core.texts.append((4, reason) if reason else (6, f"signing {'on' if self.signing.secret else 'off'}"))
        for each in self.peers.values():
            each.sign(self.signing)


def _partner(peer: Peer, packet: Any) -> tuple[int, int, int]:
    return peer.number, packet.get_srcSystem(), packet.get_srcComponent()
