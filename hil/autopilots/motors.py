"""Convert an autopilot's outputs to pulse widths of the thrusters; neutral if disarmed or without new outputs."""

from typing import TYPE_CHECKING, NamedTuple

from hil.autopilots.contract import Outputs, Report, is_output
from hil.autopilots.frames import MotorMap
from hil.common.clock import NS_PER_S
from hil.links.contract import PWM_NEUTRAL_US

if TYPE_CHECKING:
    from hil.autopilots.accessory_outputs import AccessoryOutputs
    from sim.simulation import Simulation

WRONG_FRAME_NS = 2 * NS_PER_S  # for which outputs must contradict the frame before it is reported


class Pulses(NamedTuple):
    """Pulse widths (us), one per channel of the vehicle, and whether the autopilot is armed."""

    pwm_us: tuple[int, ...]
    armed: bool


class MotorOutputs:
    """The newest outputs of one autopilot, as pulse widths of its vehicle.

    Without outputs for `silence_ns` all channels are neutral until the next outputs; each such timeout is reported.
    Outputs that contradict the frame, motors without output while others turn, are reported once. `accessories` are the
    outputs for lights, camera tilt and gripper, None if the vehicle has none.
    """

    def __init__(self, motor_map: MotorMap, silence_ns: int, name: str, report: Report) -> None:
        self.map = motor_map
        self.silences = 0
        self.outputs: tuple[int, ...] = ()  # all outputs as received, including lights, gripper and camera mount
        self.accessories: AccessoryOutputs | None = None
        self._silence_ns, self._name, self._report = silence_ns, name, report
        self._pulses = Pulses(motor_map.neutral, False)
        self._received_ns = 0
        self._silent = True  # until the first outputs
        self._contradicting_ns = 0
        self._frame_reported = False

    def update(self, outputs: Outputs) -> Pulses:
        """Store new outputs; return their pulse widths."""
        if outputs.pwm_us != self.outputs or outputs.armed != self._pulses.armed:
            self.outputs = outputs.pwm_us
            pulses = self.map.pulses(outputs.pwm_us)
            armed = any(map(is_output, outputs.pwm_us)) if outputs.armed is None else outputs.armed
            self._pulses = Pulses(pulses if armed else self.map.neutral, armed)
        if not self._frame_reported:
            self._check_frame(outputs)
        self._received_ns, self._silent = outputs.received_ns, False
        return self._pulses

    def move_accessories(self, simulation: "Simulation") -> None:
        """Command the accessories of the vehicle as the newest outputs say; those of a disarmed PX4 say nothing."""
        if self._pulses.armed and self.accessories and simulation.accessories:
            self.accessories.move(self.outputs, simulation.accessories, simulation.time_ns)

    def at(self, now: int) -> Pulses:
        """Return the pulse widths at `now` (monotonic ns): neutral after `silence_ns` without outputs."""
        if not self._silent and now - self._received_ns > self._silence_ns:
            self._silent = True
            self.silences += 1
            self._pulses = Pulses(self.map.neutral, False)
            self.outputs = ()
            self._report(f"{self._name}: no outputs for {self._silence_ns / NS_PER_S:g} s: thrusters neutral")
        return self._pulses

    @property
    def latest(self) -> Pulses:
        """The pulse widths of the last outputs, of any age."""
        return self._pulses

    def _check_frame(self, outputs: Outputs) -> None:
        problem = self._contradiction(outputs.pwm_us)
        if not problem:
            self._contradicting_ns = 0
        elif not self._contradicting_ns:
            self._contradicting_ns = outputs.received_ns
        elif outputs.received_ns - self._contradicting_ns > WRONG_FRAME_NS:
            self._frame_reported = True
            self._report(f"{self._name}: wrong frame? {problem}; this vehicle needs {self.map.frame!r}")

    def _contradiction(self, outputs: tuple[int, ...]) -> str:
        used = {motor.output for motor in self.map.motors}
        turning = [i + 1 for i in used if i < len(outputs) and is_output(outputs[i]) and outputs[i] != PWM_NEUTRAL_US]
        missing = self.map.missing(outputs)
        if turning and missing:
            return f"motors {', '.join(map(str, missing))} have no output while others turn"
        return ""
