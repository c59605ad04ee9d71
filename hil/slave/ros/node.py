"""Make the slave a ROS 2 node beyond its sensors: static transforms, clock, services.

Loaded after the vehicle is ready.
"""

from collections.abc import Callable
from math import nan, sqrt
from typing import TYPE_CHECKING

from hil.common.clock import NEVER_NS, now_ns
from hil.network.services import Server
from hil.network.session import Session
from hil.ros import encoders as ros
from hil.ros.diagnostics import Diagnostics
from hil.ros.frames import Transform, encode_clock, encode_transforms, encode_wrench, mounted
from hil.ros.topics import COMMANDS, TOPICS
from hil.scenario.config import Scenario
from hil.scenario.records import Ros
from hil.slave.loop import Loop
from hil.slave.ros.descriptions import Descriptions
from hil.slave.ros.parameters import EVENTS
from hil.slave.ros.services import offer_services
from sim.sensors.samples import period_ns
from sim.sensors.sensor_set import SensorSet

if TYPE_CHECKING:
    from sim.tether import Tether
    from sim.vehicle.accessories import Accessories

LOG, INFO, WARN = "/rosout", 20, 30  # levels of rcl_interfaces/msg/Log
_HALF_SQRT = sqrt(0.5)
WITHOUT_PLACE = ("odometry", "ground_truth")  # measured at the body's origin, so without a sensor frame
TURNED_UP = (0.0, 1.0, 0.0, 0.0)  # half a turn about x: from FLU to the axes of a DVL message, which have z down
# Kinds of sensors whose messages have their own axes: suffix of the frame's name, and the quaternion from these axes to
# the link's FLU.
HEADS = {
    "dvl": ("transducer_link", TURNED_UP),
    "dvl_water": ("transducer_link", TURNED_UP),
    "profiler": ("scan", (0.0, _HALF_SQRT, 0.0, -_HALF_SQRT)),  # x down, y to starboard, z astern
    "camera": ("optical_frame", (0.5, -0.5, 0.5, -0.5)),  # x to starboard, y down, z ahead
    "scanning_sonar": ("fan", (0.0, _HALF_SQRT, 0.0, _HALF_SQRT)),
    "forward_sonar": ("fan", (0.0, _HALF_SQRT, 0.0, _HALF_SQRT)),  # x up, y to starboard, z ahead
}


class RosNode:
    """ROS 2 node of a running loop. The loop waits on `fileno`, then calls `serve`; it calls `tick` at `due_ns`."""

    def __init__(self, session: Session, scenario: Scenario, loop: Loop, report: Callable[[str], None]) -> None:
        settings, node = scenario.ros, scenario.slave.node
        self._loop, self._node = loop, node
        self.due_ns = 0  # simulation time
        self._prefix = settings.frame_prefix
        self._clock = _Due(settings.clock)
        self._wrench = _Due(settings.wrench)
        self._joints = _Due(settings.joints)
        for fitted in [fitted for fitted in scenario.sensors.values() if not fitted.offloaded]:
            ros.encoder(fitted.topic)  # loaded now, not at the first sample
        if loop.source.pilot:
            others = {*COMMANDS} - {"cmd_vel"}  # which was declared at the start
            for name in others if loop.simulation.accessories else others - {"cmd_accessories"}:
                loop.sample_publisher.graph.subscribes(TOPICS[name], node)
        self.server = Server(session, loop.sample_publisher.graph)
        if settings.services:
            loop.sample_publisher.declare((EVENTS,))
            offer_services(self.server, node, loop, scenario.start, report)
        loop.sample_publisher.declare((LOG,))
        Descriptions(session, loop.sample_publisher.graph, scenario, report)
        self._sensors, self._settings, self._tilt = scenario.sensors, settings, 0.0
        if settings.transforms:
            self._publish_frames(loop.sample_publisher.stamps.epoch_ns)

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self.server.fileno()

    def serve(self) -> None:
        """Answer one service call."""
        self.server.serve()

    def tick(self, time_ns: int) -> None:
        """Publish what is due at this simulation time."""
        sample_publisher = self._loop.sample_publisher
        if self._clock.passes(time_ns):
            sample_publisher.publish("/clock", encode_clock(sample_publisher.stamps.stamp(time_ns)))
        if self._wrench.passes(time_ns):
            wrench = self._loop.simulation.forces().thrusters
            payload = encode_wrench(sample_publisher.stamps.stamp(time_ns), wrench, f"{self._prefix}base_link")
            sample_publisher.publish("thruster_wrench", payload)
        if self._joints.passes(time_ns):
            accessories = self._loop.simulation.accessories
            if self._settings.transforms and accessories and accessories.tilt(time_ns) != self._tilt:
                self._tilt = accessories.tilt(time_ns)
                self._publish_frames(sample_publisher.stamps.stamp(time_ns))
            if sample_publisher.has_subscribers(("joint_states",)):
                self._publish_joints(time_ns)
            if sample_publisher.has_subscribers(("motors",)):
                self._publish_motors()
            if accessories and sample_publisher.has_subscribers(("accessories",)):
                self._publish_accessories(accessories, time_ns)
            if self._loop.simulation.tether and sample_publisher.has_subscribers(("tether",)):
                self._publish_tether(self._loop.simulation.tether, time_ns)
        self.due_ns = min(self._clock.due_ns, self._wrench.due_ns, self._joints.due_ns)

    def _publish_frames(self, stamp_ns: int) -> None:
        """Publish the frames of the sensors, with tilting cameras as they are turned now."""
        sensors = {
            name: each._replace(mounting=each.mounting.tilted(self._tilt)) if getattr(each.model, "tilts", 0) else each
            for name, each in self._sensors.items()
        }
        frames = static_transforms(sensors, self._settings, stamp_ns)
        self._loop.sample_publisher.publish("/tf_static", encode_transforms(frames))

    def _publish_joints(self, time_ns: int) -> None:
        from hil.ros.joints import encode_joints, joint_states  # loaded at the first subscriber

        simulation = self._loop.simulation
        stamp_ns = self._loop.sample_publisher.stamps.stamp(time_ns)
        angles = simulation.equipment.angles if simulation.equipment else ()
        states = joint_states(stamp_ns, simulation.vehicle, simulation.thrusts, angles)
        self._loop.sample_publisher.publish("joint_states", encode_joints(states))

    def _publish_motors(self) -> None:
        from hil.ros.joints import MotorState, encode_motors

        loop = self._loop
        found = loop.simulation.motors(loop.pwm_us)
        blank = [(nan, nan)] * (len(loop.pwm_us) - len(found))
        rows = zip(loop.pwm_us, [*found, *blank], strict=True)
        loop.sample_publisher.publish("motors", encode_motors([MotorState(pulse, *motor) for pulse, motor in rows]))

    def _publish_accessories(self, accessories: "Accessories", time_ns: int) -> None:
        from hil.ros.joints import encode_accessories

        stamp_ns = self._loop.sample_publisher.stamps.stamp(time_ns)
        payload = encode_accessories(stamp_ns, accessories.positions(time_ns))
        self._loop.sample_publisher.publish("accessories", payload)

    def _publish_tether(self, tether: "Tether", time_ns: int) -> None:
        from hil.ros.plan import encode_plan

        stamp_ns = self._loop.sample_publisher.stamps.stamp(time_ns)
        self._loop.sample_publisher.publish("tether", encode_plan(stamp_ns, tether.nodes, 0.0))

    def publish_line(self, line: str) -> None:
        """Publish a line of the log on /rosout; from another thread than the loop's."""
        publisher, level = self._loop.sample_publisher, WARN if line.startswith("WARNING") else INFO
        if publisher.has_subscribers((LOG,)):
            from hil.ros.message import encode, header  # loaded at the first subscriber

            stamp = header(publisher.stamps.wall_ns(now_ns()))["stamp"]
            publisher.publish(
                LOG, encode(TOPICS[LOG].type, {"stamp": stamp, "level": level, "name": self._node, "msg": line})
            )

    def add_figures(self, figures: Diagnostics) -> None:
        """Add the counters of the services."""
        figures.services_answered = self.server.calls
        figures.services_malformed = self.server.malformed
        figures.services_oversized = self.server.oversized
        figures.services_dropped = self.server.dropped

    def close(self) -> None:
        """Close the descriptor."""
        self.server.close()


class _Due:
    """Timer with `rate` Hz of simulation time; with 0 it never runs out."""

    def __init__(self, rate: float) -> None:
        self._period_ns = period_ns(rate) if rate else 0
        self.due_ns = 0 if rate else NEVER_NS

    def passes(self, time_ns: int) -> bool:
        """Return True once a period; periods that were missed are not made up for."""
        if time_ns < self.due_ns:
            return False
        self.due_ns = time_ns - time_ns % self._period_ns + self._period_ns
        return True


def static_transforms(sensors: SensorSet, settings: Ros, time_ns: int) -> list[Transform]:
    """Return the transforms from map to odom (identity: no drift is modelled) and from base_link to each sensor."""
    prefix = settings.frame_prefix
    base = f"{prefix}base_link"
    frames = [mounted(time_ns, "map", f"{prefix}odom", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))]
    for name in [name for name in sensors if name not in WITHOUT_PLACE]:
        mounting, link = sensors[name].mounting, f"{prefix}{name}_link"
        frames.append(mounted(time_ns, base, link, mounting.position, mounting.quaternion))
        if (kind := sensors[name].sensor.topic) in HEADS:
            head, turn = HEADS[kind]
            frames.append(Transform(time_ns, link, f"{prefix}{name}_{head}", (0.0, 0.0, 0.0), turn))
    return frames
