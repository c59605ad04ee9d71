"""Modes of the vehicle as one machine: from mode, sticks, targets and mission to the command that it is sent.

It has neither clock nor sockets: `step` is called with the time, some 20 times a second, and returns the command to
send, or None to send nothing, upon which the vehicle's own deadman stops the thrusters.
"""

from hil.autonomy.control.controller import VelocityCommand
from hil.client.samples import State
from hil.common.clock import NS_PER_S, seconds_ns
from hil.gateways.mavlink.flight import guidance
from hil.gateways.mavlink.flight.mission_flight import MissionFlight
from hil.gateways.mavlink.flight.modes import MODES, PILOTED, Mode
from hil.gateways.mavlink.flight.sticks import CENTRED, Joystick
from hil.gateways.mavlink.flight.targets import Target
from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.gateways.mavlink.snapshot import NEUTRAL, Command, Snapshot, ThrusterTest
from hil.ros.commands import PoseCommand

TEST_NS = NS_PER_S // 2  # after which a motor test ends and disarms, as in ArduSub
TARGETED = (Mode.STABILIZE, Mode.ALT_HOLD, Mode.POSHOLD)  # modes beside Guided that take a depth or a heading
NEUTRALS = 3  # commands of no thrust that follow disarming


class Pilot:
    """The modes of one vehicle. `texts` collects messages for a person: severity (MAV_SEVERITY) and text."""

    def __init__(self, parameters: ParameterTable, mission: MissionFlight) -> None:
        self._parameters, self._mission = parameters, mission
        self.joystick = Joystick(parameters)
        self.mode = Mode.MANUAL
        self.armed = False
        self.texts: list[tuple[int, str]] = []
        self.target: Target | None = None
        self._target_ns = 0
        self._test: tuple[ThrusterTest, int] | None = None  # and its time (ns)
        self._holds = guidance.Holds()
        self._neutrals = 0
        self._stick_warned = True

    @property
    def timeout_ns(self) -> int:
        """Time (ns) for which a stick position stays valid."""
        return seconds_ns(self._parameters["FS_PILOT_TIMEOUT"])

    @property
    def target_position(self) -> guidance.Point | None:
        """Place (m, NED) that it steers to; None without one."""
        return self.target.position if self.target and self.mode in (Mode.GUIDED, Mode.AUTO) else None

    def arm(self) -> None:
        """Let the modes drive the vehicle. The caller has checked that it accepts commands."""
        if not self.armed:
            self.armed = True
            self._holds.release()
            self.joystick.release()
            self._stick_warned = True

    def disarm(self) -> None:
        """Stop the thrusters, and send nothing after that."""
        if self.armed:
            self.armed = False
            self._neutrals = NEUTRALS
            self._test = None
            self.target = None

    def set_mode(self, mode: Mode, snapshot: Snapshot | None) -> str:
        """Change the mode; return why that cannot be, "" if it could."""
        if mode not in (Mode.MANUAL, Mode.STABILIZE) and snapshot is None:
            return f"{MODES[mode].name}: the vehicle is not there"
        if mode == Mode.AUTO:
            reason = self._mission.begin()
            if reason:
                return f"{MODES[mode].name}: {reason}"
        if mode != self.mode:
            self.texts.append((6, f"mode {MODES[mode].name}"))
        self.mode = mode
        self.target = None
        self._holds.release()
        if snapshot and mode not in (Mode.MANUAL, Mode.STABILIZE):
            self._holds.hold(snapshot.state)
        return ""

    def set_target(self, target: Target, now: int) -> str:
        """Take a target of companion software; return why the mode does not take it, "" if it does.

        The modes that hold depth or heading take those alone, as ArduSub's do.
        """
        name = MODES[self.mode].name
        if not self.armed:
            return "target: arm first"
        if self.mode == Mode.GUIDED:
            self.target, self._target_ns = target, now
            return ""
        if self.mode not in TARGETED:
            return f"target: mode {name} follows none: choose Guided"
        if not target.is_hold:
            return f"target: mode {name} takes a depth or an attitude alone: choose Guided"
        if target.position:
            if self.mode == Mode.STABILIZE:
                return f"target: mode {name} holds no depth: choose Depth hold"
            self._holds.depth = target.position[2]
        if target.heading is not None:
            self._holds.heading = target.heading
        return ""

    def test(self, test: ThrusterTest, now: int) -> None:
        """Turn one thruster instead of what the mode does, until TEST_NS without a further test."""
        self._test = test, now

    def hold_here(self, state: State) -> None:
        """Stay where the vehicle is, in the modes that steer by themselves."""
        self.target = None
        self._holds.hold(state)

    def step(self, snapshot: Snapshot | None, now: int) -> Command | None:
        """Return the command to send now; None: none."""
        if not self.armed or snapshot is None:
            self._neutrals -= self._neutrals > 0 and snapshot is not None
            return NEUTRAL if self._neutrals and snapshot else None
        if self._test:
            test, when = self._test
            if now - when <= TEST_NS:
                return test
            self.texts.append((4, "Motor test timed out!"))
            self.disarm()
            return NEUTRAL
        state = snapshot.state
        if self.mode in PILOTED:
            return self._piloted(state, now)
        if self.mode == Mode.SURFACE:
            return VelocityCommand(depth=-self._parameters["SURFACE_DEPTH"], heading=self._held_heading(state))
        if self.mode == Mode.AUTO:
            self.target = self._mission.step(state, now)
        return self._steered(state, now)

    def _piloted(self, state: State, now: int) -> Command:
        parameters = self._parameters
        self._warn_of_silence(now)
        sticks = self.joystick.sticks(now)
        if self.mode == Mode.MANUAL:
            return guidance.push(sticks, parameters)
        self._holds.drive(sticks, state, self.mode != Mode.STABILIZE, self.mode == Mode.POSHOLD)
        return guidance.piloted(sticks, state, self._holds, parameters)

    def _steered(self, state: State, now: int) -> Command:
        """Return the command of a target, or hold where the vehicle is."""
        target = self.target
        is_old = now - self._target_ns > self._parameters["HIL_GUIDED_TIME"] * NS_PER_S
        if target and target.velocity and is_old and self.mode == Mode.GUIDED:
            self.texts.append((4, "velocity target timed out: holding"))
            self.hold_here(state)
            target = None
        if target and target.position:
            self._holds.release()
            if guidance.is_reached(target.position, state, 0.3) and not self._parameters["HIL_STEER"]:
                heading = self._held_heading(state) if target.heading is None else target.heading
                depth = min(target.position[2], self._parameters["HIL_DEPTH_MAX"])
                return PoseCommand((target.position[0], target.position[1], depth), heading)
            return guidance.go_to(target.position, target.heading, state, self._parameters, target.speed)
        if target and target.velocity:
            return self._at_velocity(target, target.velocity, state)
        self._holds.drive(CENTRED, state, True, True)
        return guidance.piloted(CENTRED, state, self._holds, self._parameters)

    def _at_velocity(self, target: Target, velocity: guidance.Point, state: State) -> VelocityCommand:
        """Return the command of a velocity target; what it does not move is held."""
        surge, sway, heave = velocity
        if target.yaw_rate:
            self._holds.heading = None
        turns = target.heading is None and target.yaw_rate != 0.0
        heading = None if turns else self._held_heading(state) if target.heading is None else target.heading
        most = self._parameters["HIL_DEPTH_MAX"]
        if heave > 0.0 and state.depth >= most:
            return VelocityCommand(surge, sway, 0.0, target.yaw_rate, most, heading)
        if heave:
            self._holds.depth = None
        elif self._holds.depth is None:
            self._holds.depth = state.depth
        return VelocityCommand(surge, sway, heave, target.yaw_rate, self._holds.depth, heading)

    def _held_heading(self, state: State) -> float:
        if self._holds.heading is None:
            self._holds.heading = state.heading
        return self._holds.heading

    def _warn_of_silence(self, now: int) -> None:
        """Act once by FS_PILOT_INPUT if the joystick sends nothing any more."""
        alive = self.joystick.is_alive(now)
        if alive:
            self._stick_warned = False
        elif not self._stick_warned:
            self._stick_warned = True
            action = self._parameters["FS_PILOT_INPUT"]
            if action:
                self.texts.append((4, f"joystick silent: {'disarmed' if action == 2 else 'sticks centred'}"))
            if action == 2:
                self.disarm()
