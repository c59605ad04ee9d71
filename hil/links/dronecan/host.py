"""Host end (vehicle's computer) of thrusters on DroneCAN; `hil.links.dronecan.link` describes the messages."""

from hil.links.can_thrusters import SPAN_US, WRAP, Answers, Rounds, pulse_at
from hil.links.contract import PWM_NEUTRAL_US, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.dronecan import types
from hil.links.dronecan.allocation import Allocator
from hil.links.dronecan.node import PRIORITY_HIGH, PRIORITY_LOW, DroneCanNode
from hil.links.dronecan.settings import ARMED, ARMING_PERIOD_NS, SOFTWARE, TIMED_OUT, TRIPS_SHIFT, HostSettings
from hil.links.dronecan.transfer import Transfer


class DroneCanHost(DroneCanNode):
    """Host end."""

    echoes_sequence = False

    def __init__(self, channels: int, settings: HostSettings) -> None:
        info = types.NodeInfo("org.uuv-hil.host", bytes.fromhex(settings.unique_id), SOFTWARE, (0, 0))
        super().__init__(settings.node_id, info)
        self._us_per_rpm = SPAN_US / settings.full_rpm
        self._own_device = settings.own_device
        self._first = settings.esc_index
        self._answers = Answers(channels)
        self._rounds = Rounds(channels)
        self._statuses: dict[int, types.EscStatus] = {}  # thruster -> last status
        self._errors = [0] * channels  # error count of each controller
        self._codes: dict[int, int] = {}  # node number -> vendor-specific status code
        self._armed = False
        self._repeat("arming", ARMING_PERIOD_NS, self._arming)
        self._listen(types.ESC_STATUS, types.unpack_esc_status, self._on_esc)
        self._listen(types.NODE_STATUS, types.unpack_node_status, self._on_node)
        self._allocator = Allocator() if settings.allocate else None
        if self._allocator:
            self._allocator.see(self.node_id)
            self._listen(types.ALLOCATION, types.unpack_allocation, self._on_allocation)

    def encode(self, message: Message) -> bytes:
        """Return a command as RawCommand, after ArmingStatus if that changes; encodes commands only."""
        assert isinstance(message, ThrusterCommand)
        pulses = self._answers.record_command(message)
        output = b""
        if message.armed != self._armed:
            self._armed = message.armed
            output = self._arming()
        before = [0] * self._first  # zero output for controllers that are not ours
        raw = [round((pulse - PWM_NEUTRAL_US) * types.FULL_RAW / SPAN_US) for pulse in pulses]
        return output + self._broadcast(types.RAW_COMMAND, PRIORITY_HIGH, types.pack_raw_command(before + raw))

    def tick(self, now_ns: int) -> bytes:
        """Return NodeStatus and ArmingStatus if they are due."""
        output = super().tick(now_ns)
        if self._allocator:
            self._allocator.expire(now_ns)
            self.deadline_ns = min(self.deadline_ns, self._allocator.due_ns)
        return output

    def motor_values(self, thruster: int) -> dict[str, float]:
        """Return speed, current and voltage of a thruster's last status."""
        status = self._statuses.get(thruster)
        return {"rpm": status.rpm, "A": status.current_a, "V": status.voltage_v} if status else {}

    def _arming(self) -> bytes:
        status = types.FULLY_ARMED if self._armed else types.DISARMED
        return self._broadcast(types.ARMING_STATUS, PRIORITY_HIGH, bytes((status,)))

    def _on_esc(self, transfer: Transfer, status: types.EscStatus) -> ThrusterTelemetry | None:
        thruster = status.esc_index - self._first
        if not 0 <= thruster < len(self._errors):
            return None  # not one of our thrusters
        self._statuses[thruster] = status
        self._errors[thruster] = status.error_count
        pulses = self._rounds.add_report(thruster, pulse_at(status.rpm * self._us_per_rpm))
        return None if pulses is None else self._telemetry(pulses, transfer.source)

    def _telemetry(self, pulses: tuple[int, ...], source: int) -> ThrusterTelemetry:
        command = self._answers.find_command(pulses)
        if self._own_device:
            code = self._codes.get(source, 0)
            armed, timed_out, trips = bool(code & ARMED), bool(code & TIMED_OUT), code >> TRIPS_SHIFT
        else:
            armed, timed_out, trips = command.armed, False, 0
        errors = max(self._errors) & WRAP
        return ThrusterTelemetry(command.sequence, armed, timed_out, pulses, 0, self._answers.frames, errors, trips)

    def _on_node(self, transfer: Transfer, status: types.NodeStatus) -> None:
        self._codes[transfer.source] = status.vendor_code
        if self._allocator:
            self._allocator.see(transfer.source)

    def _on_allocation(self, transfer: Transfer, request: types.Allocation) -> None:
        if self._allocator and not transfer.source:
            answer = self._allocator.answer(request)
            self.deadline_ns = 0
            if answer:
                self._replies.append(self._broadcast(types.ALLOCATION, PRIORITY_LOW, types.pack_allocation(answer)))
