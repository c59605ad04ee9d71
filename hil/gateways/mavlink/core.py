"""The MAVLink vehicle without its packets: modes, mission, parameters, home and origin, and when it may be armed."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autonomy.control.controller import wrap
from hil.common.clock import NS_PER_S
from hil.gateways.mavlink.accessories import CHANNELS, OUTPUTS, PANEL, Accessories
from hil.gateways.mavlink.flight.guidance import Point
from hil.gateways.mavlink.flight.mission_flight import MissionFlight
from hil.gateways.mavlink.flight.mission_items import Item
from hil.gateways.mavlink.flight.modes import MODES, Mode, mode_name, mode_of
from hil.gateways.mavlink.flight.pilot import Pilot
from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.gateways.mavlink.protocols.missions import MissionProtocol
from hil.gateways.mavlink.snapshot import Context, Origin, Snapshot, ThrusterTest
from hil.gateways.mavlink.telemetry import place_e7
from hil.gateways.mavlink.vehicle_port import NetworkVehicle
from hil.scenario.mavlink_records import Mavlink
from sim.geodesy import TangentPlane

LOST_NS = 3 * NS_PER_S  # a vehicle that is away for longer is disarmed
DRIVE_NS = NS_PER_S // 20  # between two commands to the vehicle
URGENT_NS = NS_PER_S // 100  # the same, where a stick has moved
NEVER = 1 << 63
ARMING_NS = 9 * NS_PER_S // 5  # that the slave may take to report that it is armed
OBSTACLE_NS = 30 * NS_PER_S  # between two reports of why the vehicle cannot be armed
SAME_PLACE = 1e-6  # degrees and m between two origins that are one
COMPLAINT_NS, MAX_COMPLAINTS = 10 * NS_PER_S, 100
MINUTE_NS = 60 * NS_PER_S
WARNING, NOTICE, ERROR, CRITICAL = 4, 5, 3, 2
Settled = Callable[[int], None]  # gets the MAV_RESULT of arming


class Core:
    """One vehicle. `tick` is called with the time (ns), 50 times a second; nothing else looks at a clock.

    `texts` are messages for ground stations: severity and text. `motors` are thruster, from 0, and direction (1, -1) of
    each motor of the vehicle's frame; without them the motors are the thrusters.
    """

    def __init__(
        self,
        port: NetworkVehicle,
        settings: Mavlink,
        table: ParameterTable,
        origin: Origin | None,
        start_ns: int,
        motors: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.port, self.table, self.start_ns = port, table, start_ns
        self.is_ardupilot = settings.autopilot == "ardupilot"
        self.system = settings.system
        self.texts: deque[tuple[int, str]] = deque(maxlen=50)
        self.messages: deque[Any] = deque(maxlen=50)  # for all ground stations
        self._motors = motors
        self.snapshot: Snapshot | None = None
        self.home: Point = (0.0, 0.0, 0.0)
        self.origin: Origin | None = None
        self.plane: TangentPlane | None = None
        self._has_home = False
        if origin:
            self.set_origin(origin)
        self.flight = MissionFlight(table, lambda: self.origin, lambda: self.home, int(self.is_ardupilot))
        self.pilot = Pilot(table, self.flight)
        home = self._home_item if self.is_ardupilot else None
        self.missions = MissionProtocol(self._on_new_mission, lambda: self.origin, home)
        self.accessories = Accessories(port.set_accessory)
        self._turns = self._heading = 0.0  # turns of the tether, and the heading (rad) at which they were counted
        self._complaints: dict[str, int] = {}  # text -> when it was sent
        self._arming: list[tuple[int, Settled]] = []  # deadline, and the callback that gets the result
        self._sent_ns = self._seen_ns = 0
        self._urgent = False
        self._gcs_ns: int | None = None  # last heartbeat of a ground station
        self._gcs_lost = self._leaks = False
        self._low_ns: dict[str, int] = {}  # since when the battery is low or critical, NEVER once that is acted on
        self._refusal = ""
        self._obstacle: tuple[str, int] = "", 0  # why the vehicle cannot be armed, and when that was reported (ns)

    def set_origin(self, origin: Origin | None) -> str:
        """Set the origin of the NED frame on the earth, once; return why it is not taken, "" if it is the one set."""
        if origin is None:
            return "origin: no such place"
        if self.origin is None:
            self.origin = origin
            self.plane = TangentPlane(origin.latitude, origin.longitude, origin.altitude)
        is_same = max(abs(a - b) for a, b in zip(origin, self.origin, strict=True)) < SAME_PLACE
        return "" if is_same else "origin: not taken, as the world or an earlier message has set one"

    def set_home(self, position: Point) -> None:
        """Set home (m, NED)."""
        self.home, self._has_home = position, True

    def on_ground_station_heartbeat(self, now: int) -> None:
        """Record the time of a ground station's heartbeat."""
        self._gcs_ns = now
        if self._gcs_lost:
            self._gcs_lost = False
            self.texts.append((NOTICE, "ground station is back"))

    def is_ready(self) -> bool:
        """Return whether arming would be accepted."""
        return self.snapshot is not None and (self.snapshot.disarmed or not self._refusal)

    def restart(self) -> None:
        """Begin again, disarmed: with mode Manual, centred accessories, no target, the mission at its first item."""
        self.pilot = Pilot(self.table, self.flight)
        self.flight.restart()
        self.accessories.reset()
        self.texts.append((NOTICE, "restarted: mode Manual; parameters, mission and origin are kept"))

    def arm(self, now: int, settled: Settled) -> None:
        """Arm, or begin to: `settled` gets the MAV_RESULT, at once or within ARMING_NS."""
        if self.pilot.armed:
            settled(dialect.MAV_RESULT_ACCEPTED)
        elif self.snapshot is None:
            self.texts.append((CRITICAL, "Arm: the vehicle is not there"))
            settled(dialect.MAV_RESULT_TEMPORARILY_REJECTED)
        elif not self.port.refusal():
            self._finish_arming(settled)
        else:
            self.port.arm()
            self._arming.append((now + ARMING_NS, settled))

    def disarm(self) -> None:
        """Stop the thrusters."""
        if self.pilot.armed:
            self.texts.append((6, "Disarmed"))
        self.pilot.disarm()
        self._urgent = True

    def set_mode(self, number: float) -> int:
        """Set the mode with that number; return the MAV_RESULT."""
        mode = mode_of(number)
        if mode is None:
            self.texts.append((WARNING, f"{mode_name(number)} is not a mode of this vehicle"))
            return int(dialect.MAV_RESULT_DENIED)
        reason = self.pilot.set_mode(mode, self.snapshot)
        if reason:
            self.texts.append((WARNING, reason))
            return int(dialect.MAV_RESULT_TEMPORARILY_REJECTED)
        self._urgent = True
        return int(dialect.MAV_RESULT_ACCEPTED)

    def test_motor(self, number: float, share: float, now: int) -> bool:
        """Turn one motor, counted from 0, by a share (-1 to 1) of HIL_THRUST; return whether there is such a motor."""
        motors = self._motors or [(n, 1) for n in range(len(self.snapshot.pulses) if self.snapshot else 0)]
        if number not in range(len(motors)):
            return False
        thruster, direction = motors[int(number)]
        self.pilot.test(ThrusterTest(thruster, direction * share * self.table["HIL_THRUST"]), now)
        return True

    def expedite(self) -> None:
        """Send the next command soon: somebody has moved a stick, or set a target."""
        self._urgent = True

    def context(self, now: int, wall_ns: int) -> Context:
        """Return what the messages of the state need."""
        pilot = self.pilot
        return Context(
            now - self.start_ns, wall_ns, self.home, self.origin, self.plane, self.is_ready(),
            pilot.target_position, self._channels(now), self._panel(), self.accessories.pulses, self.accessories.tilt,
        )  # fmt: skip

    def complain(self, text: str, now: int, every_ns: int = COMPLAINT_NS) -> None:
        """Send a text about what somebody asked for, once in `every_ns`: requests of this kind come in streams."""
        if now - self._complaints.get(text, -every_ns) >= every_ns:
            if len(self._complaints) >= MAX_COMPLAINTS:
                self._complaints.clear()
            self._complaints[text] = now
            self.texts.append((WARNING, text))

    def _channels(self, now: int) -> tuple[int, ...]:
        others = [self.accessories.pulses[OUTPUTS[name].number] for name in CHANNELS.values()]
        return (*self.pilot.joystick.channels(now), *others)

    def _panel(self) -> dict[str, float]:
        joystick = self.pilot.joystick
        return {name: self.accessories.share(name) for name in PANEL} | {
            "TetherTrn": math.trunc(4.0 * self._turns) / 4.0, "PilotGain": joystick.gain,
            "InputHold": float(any(joystick.holds)), "RollPitch": float(joystick.turns_hull),
        }  # fmt: skip

    def tick(self, now: int) -> None:
        """Read the vehicle's state, check its failsafes, and send a command when one is due."""
        snapshot = self.port.snapshot()
        if snapshot and not self.table["BATT_MONITOR"]:
            snapshot = snapshot._replace(battery=None)
        self.snapshot = snapshot
        if snapshot:
            self._seen_ns = now
            self._find_places(snapshot)
            self._turns += wrap(snapshot.state.heading - self._heading) / math.tau
            self._heading = snapshot.state.heading
        elif self.pilot.armed and now - self._seen_ns > LOST_NS:
            self.texts.append((CRITICAL, "the vehicle is lost"))
            self.disarm()
        self._refusal = self.port.refusal() if snapshot else ""
        self._finish_armings(now)
        if self.pilot.armed:
            self._watch(now)
        else:
            self._report_obstacle(now)
        if now - self._sent_ns >= (URGENT_NS if self._urgent else DRIVE_NS):
            command = self.pilot.step(snapshot, now)
            self._urgent, self._sent_ns = False, now
            if command is not None:
                self.port.send(command)
        for texts in (self.pilot.texts, self.flight.texts):
            self.texts.extend(texts)
            texts.clear()

    def _finish_armings(self, now: int) -> None:
        for deadline, settled in list(self._arming):
            if self._refusal == "" and self.snapshot:
                self._finish_arming(settled)
            elif now >= deadline:
                self.texts.append((CRITICAL, f"Arm: {self._refusal or 'the vehicle is not there'}"))
                settled(dialect.MAV_RESULT_FAILED)
            else:
                continue
            self._arming.remove((deadline, settled))

    def _finish_arming(self, settled: Settled) -> None:
        if not self.pilot.armed:
            self.texts.append((6, f"Armed, mode {MODES[self.pilot.mode].name}"))
        self.pilot.arm()
        settled(dialect.MAV_RESULT_ACCEPTED)

    def _watch(self, now: int) -> None:
        """Disarm if another master commands the vehicle; act on silent ground stations, leaks and an empty battery."""
        if self._refusal:
            self.texts.append((CRITICAL, f"Disarmed: {self._refusal}"))
            self.disarm()
            return
        silence_ns = now - (now if self._gcs_ns is None else self._gcs_ns)
        if silence_ns > self.table["FS_GCS_TIMEOUT"] * NS_PER_S and not self._gcs_lost:
            self._gcs_lost = True
            self._act_on_silence()
        leaks = self.snapshot is not None and self.snapshot.leak and self.table["LEAK1_PIN"] >= 0.0
        if leaks and not self._leaks and self.table["FS_LEAK_ENABLE"]:
            self.texts.append((CRITICAL, "Leak detected"))
            if self.table["FS_LEAK_ENABLE"] == 2:
                self.set_mode(Mode.SURFACE)
        self._leaks = leaks
        self._watch_battery(now)

    def _watch_battery(self, now: int) -> None:
        """Act once if the voltage has been below BATT_LOW_VOLT or BATT_CRT_VOLT for BATT_LOW_TIMER."""
        battery = self.snapshot.battery if self.snapshot else None
        for level in ("LOW", "CRT"):
            if battery is None or battery.voltage >= self.table[f"BATT_{level}_VOLT"]:
                self._low_ns.pop(level, None)
            elif now - self._low_ns.setdefault(level, now) > self.table["BATT_LOW_TIMER"] * NS_PER_S:
                self._low_ns[level] = NEVER
                self.texts.append(
                    (CRITICAL, f"Battery {'low' if level == 'LOW' else 'critical'}: {battery.voltage:.1f} V")
                )
                action = self.table[f"BATT_FS_{level}_ACT"]
                if action == 2:
                    self.disarm()
                elif action == 3:
                    self.set_mode(Mode.SURFACE)

    def forget_obstacle(self) -> None:
        """Report again why the vehicle cannot be armed, if it cannot."""
        self._obstacle = "", 0

    def _report_obstacle(self, now: int) -> None:
        """Report why the vehicle cannot be armed when that changes, and every OBSTACLE_NS, as ArduSub does."""
        reason = "" if self.is_ready() or self.snapshot is None else self._refusal
        before, when = self._obstacle
        if reason and (reason != before or now - when > OBSTACLE_NS):
            self.texts.append((CRITICAL, f"PreArm: {reason}"))
        elif reason:
            return
        self._obstacle = reason, now

    def _act_on_silence(self) -> None:
        action = int(self.table["FS_GCS_ENABLE"])
        if action:
            self.texts.append((CRITICAL, "no ground station any more"))
        if action == 2:
            self.disarm()
        elif action == 3:
            self.set_mode(Mode.ALT_HOLD)
        elif action == 4:
            self.set_mode(Mode.SURFACE)

    def _find_places(self, snapshot: Snapshot) -> None:
        """Find home and origin: home is where the vehicle was first seen, at the surface; a fix gives the origin."""
        north, east, depth = snapshot.state.position
        if not self._has_home:
            self.set_home((north, east, 0.0))
        fix = snapshot.fix
        if fix and fix.fix and self.origin is None:
            # The tangent plane at the fix, seen from the vehicle: its north and east differ by less than a mm a km.
            latitude, longitude, _ = TangentPlane(fix.latitude, fix.longitude).geodetic((-north, -east, 0.0))
            self.set_origin(Origin(latitude, longitude, fix.altitude + depth))
            self.texts.append((6, "origin set by the first fix"))

    def _on_new_mission(self, items: Sequence[Item]) -> None:
        self.flight.replace(items)
        self.texts.append((6, f"mission: {max(0, len(items) - self.is_ardupilot)} items"))

    def _home_item(self) -> Item:
        latitude, longitude = place_e7(self.context(0, 0), self.home)
        altitude = (self.origin.altitude if self.origin else 0.0) - self.home[2]
        return Item(
            dialect.MAV_FRAME_GLOBAL, dialect.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 0.0), latitude, longitude, altitude
        )


def mission_current(core: Core) -> Any:
    """Return MISSION_CURRENT."""
    flight = core.flight
    last = max(0, flight.total - 1)
    return dialect.MAVLink_mission_current_message(min(flight.current, last), last, flight.status, 0)
