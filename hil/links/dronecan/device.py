"""Device end (STM32) of thrusters on DroneCAN; `hil.links.dronecan.link` describes the messages."""

from collections.abc import Callable

from hil.common.clock import NS_PER_S
from hil.links.can_thrusters import SPAN_US, WRAP, MotorHook, deflection, propeller_load
from hil.links.contract import PWM_NEUTRAL_US, Message, ThrusterCommand, ThrusterTelemetry
from hil.links.dronecan import types
from hil.links.dronecan.allocation import Allocatee
from hil.links.dronecan.node import PRIORITY_LOW, PRIORITY_MEDIUM, DroneCanNode
from hil.links.dronecan.parameters import Parameter, ParameterStore
from hil.links.dronecan.settings import (
    ARMED,
    FULL_RPM_RANGE,
    MAX_ESCS,
    SOFTWARE,
    TIMED_OUT,
    TRIPS_SHIFT,
    DeviceSettings,
)
from hil.links.dronecan.transfer import MAX_NODE_ID, Transfer, pack_anonymous

EXTENDED_PERIOD_NS = NS_PER_S
ZERO_C_K = 273.15


class DroneCanDevice(DroneCanNode):
    """Device end. `motor_values` returns the values that motor controllers measure, `battery_values` the battery's."""

    def __init__(
        self,
        channels: int,
        settings: DeviceSettings,
        motor_values: MotorHook = propeller_load,
        battery_values: Callable[[], types.BatteryInfo | None] | None = None,
    ) -> None:
        unique_id = settings.unique_bytes
        super().__init__(0, types.NodeInfo("org.uuv-hil.stm32", unique_id, SOFTWARE, (1, 0)))
        self._channels = channels
        self._neutral = (PWM_NEUTRAL_US,) * channels
        self.parameters = ParameterStore(
            (
                Parameter("CAN_NODE", settings.node_id, (0, MAX_NODE_ID)),
                Parameter("ESC_INDEX", settings.esc_index, (0, MAX_ESCS - channels)),
                Parameter("FULL_RPM", settings.full_rpm, FULL_RPM_RANGE),
                Parameter("REQUIRE_ARMING", settings.require_arming),
            ),
            settings.stored,
        )
        self._unique_id = unique_id
        self._preferred = settings.preferred_node_id
        self._allocatee: Allocatee | None = None
        self._is_restarting = False
        self._pulses = self._neutral
        self._start()
        self._motor_values = motor_values
        self._listen(types.RAW_COMMAND, types.unpack_raw_command, self._on_command)
        self._listen(types.RPM_COMMAND, types.unpack_rpm_command, self._on_rpm_command)
        self._listen(types.ARMING_STATUS, types.unpack_arming_status, self._on_arming)
        self._battery_values = battery_values or (lambda: settings.battery)
        if battery_values or settings.battery:
            self._repeat("battery", round(settings.battery_period * NS_PER_S), self._battery)
        self._repeat("extended", EXTENDED_PERIOD_NS, self._extended)
        self._listen(types.ALLOCATION, types.unpack_allocation, self._on_allocation)

    def encode(self, message: Message) -> bytes:
        """Return a report as one esc.Status a thruster, after NodeStatus if that changes; encodes reports only."""
        assert isinstance(message, ThrusterTelemetry)
        code = message.watchdog_trips << TRIPS_SHIFT & WRAP | message.timed_out * TIMED_OUT | message.armed * ARMED
        output = []
        if code != self.vendor_code:
            self.vendor_code = code
            self.health = types.HEALTH_WARNING if message.timed_out else types.HEALTH_OK
            output.append(self._status())
        self._pulses = message.pwm_us
        for index, pulse in enumerate(message.pwm_us):
            status = types.pack_esc_status(self._esc_status(index, pulse, message.errors))
            output.append(self._broadcast(types.ESC_STATUS, PRIORITY_MEDIUM, status))
        return b"".join(output)

    def tick(self, now_ns: int) -> bytes:
        """Return NodeStatus and BatteryInfo if due; while the node has no number, requests for one."""
        if self._is_restarting:
            self._start()
        output = super().tick(now_ns)
        if self._allocatee:
            output += self._request_node_id(self._allocatee, now_ns)
            self.deadline_ns = min(self.deadline_ns, self._allocatee.due_ns)
        return output

    def _start(self) -> None:
        """Start as after power-up, with the stored parameters."""
        self._is_restarting = False
        self._started_ns = -1
        self.vendor_code, self.health = 0, types.HEALTH_OK
        self.parameters.restart()
        self._on_parameters()
        self._armed = not self._require_arming
        node_id = int(self.parameters["CAN_NODE"])
        self._allocatee = None if node_id else Allocatee(self._unique_id, self._preferred)
        self._enter(node_id)

    def _on_parameters(self) -> None:
        """Apply parameters that may have changed; a node number takes effect at the next start."""
        self._rpm_per_us = self.parameters["FULL_RPM"] / SPAN_US
        self._require_arming = bool(self.parameters["REQUIRE_ARMING"])
        self._first = int(self.parameters["ESC_INDEX"])

    def _restart(self) -> ThrusterCommand:
        """Stop the thrusters now; restart at the next tick, after the request was answered."""
        self._is_restarting = True
        self.deadline_ns = 0
        return ThrusterCommand(0, False, self._neutral)

    def _request_node_id(self, allocatee: Allocatee, now_ns: int) -> bytes:
        request = allocatee.request(now_ns)
        if request is None:
            return b""
        return pack_anonymous(
            types.ALLOCATION, PRIORITY_LOW, types.pack_allocation(request), self._next_transfer_id(types.ALLOCATION)
        )

    def _esc_status(self, index: int, pulse: int, errors: int) -> types.EscStatus:
        microseconds = deflection(pulse)
        values = self._motor_values(index, pulse)
        percent = round(100 * abs(microseconds / SPAN_US) ** 3)  # power goes with the cube of speed
        return types.EscStatus(errors, *values, round(microseconds * self._rpm_per_us), percent, index + self._first)

    def _extended(self) -> bytes:
        """Return a StatusExtended for each thruster; the propeller angle is unknown and sent as 0."""
        output = []
        for index, pulse in enumerate(self._pulses):
            percent = round(100 * abs(deflection(pulse)) / SPAN_US)
            celsius = round(self._motor_values(index, pulse).temperature_k - ZERO_C_K)
            status = types.EscStatusExtended(percent, percent, celsius, 0, 0, index + self._first)
            output.append(self._broadcast(types.STATUS_EXTENDED, PRIORITY_LOW, types.pack_status_extended(status)))
        return b"".join(output)

    def _battery(self) -> bytes:
        battery = self._battery_values()
        return self._broadcast(types.BATTERY_INFO, PRIORITY_LOW, types.pack_battery_info(battery)) if battery else b""

    def _on_command(self, _: Transfer, raw: list[int]) -> ThrusterCommand:
        ours = raw[self._first : self._first + self._channels]
        return self._command([PWM_NEUTRAL_US + round(value * SPAN_US / types.FULL_RAW) for value in ours])

    def _on_rpm_command(self, _: Transfer, rpm: list[int]) -> ThrusterCommand:
        ours = rpm[self._first : self._first + self._channels]
        deflections = [round(value / self._rpm_per_us) for value in ours]
        return self._command([PWM_NEUTRAL_US + min(max(value, -SPAN_US), SPAN_US) for value in deflections])

    def _command(self, pulses: list[int]) -> ThrusterCommand:
        """Return the command with these pulse widths (us); thrusters beyond their number stop."""
        return ThrusterCommand(0, self._armed, (*pulses, *self._neutral[len(pulses) :]))

    def _on_arming(self, _: Transfer, status: int) -> ThrusterCommand | None:
        was_armed = self._armed
        self._armed = status == types.FULLY_ARMED or not self._require_arming
        return ThrusterCommand(0, False, self._neutral) if was_armed and not self._armed else None

    def _on_allocation(self, transfer: Transfer, received: types.Allocation) -> None:
        if self._allocatee:
            self._allocatee.on_allocation(transfer.source, received)
            self.deadline_ns = 0
            if self._allocatee.node_id:
                self._enter(self._allocatee.node_id)
                self._allocatee = None
