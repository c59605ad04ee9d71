"""What makes the slave a node of ROS 2 beyond its sensors: static transforms, clock, services.

Loaded when the vehicle is ready.
"""

from collections.abc import Callable

from hil.config import Ros, Scenario
from hil.slave.loop import Loop
from hil.slave.services import offer_services
from hil.transport import ros
from hil.transport.ros_frames import Transform, encode_clock, encode_transforms, encode_wrench, mounted
from hil.transport.services import Server
from hil.transport.session import Session
from sim.sensors.samples import period_ns
from sim.sensors.suite import Suite

WITHOUT_PLACE = ("odometry", "ground_truth")  # they are of the body's origin
TURNED_UP = (0.0, 1.0, 0.0, 0.0)  # half a turn about x: from FLU to the z-down axes of a velocity log's message
NEVER = 1 << 63


class RosNode:
    """Speaks for a running loop, which waits on `fileno`, and calls `serve` and `tick`."""

    def __init__(self, session: Session, scenario: Scenario, loop: Loop, say: Callable[[str], None]) -> None:
        settings, node = scenario.ros, scenario.slave.node
        self._loop = loop
        self._prefix = settings.frame_prefix
        self._clock = _Due(settings.clock)
        self._wrench = _Due(settings.wrench)
        for fitted in scenario.sensors.values():
            ros.encoder(fitted.sensor.topic)  # loaded now, not at the first sample
        self.server = Server(session, loop.outbox.graph)
        if settings.services:
            offer_services(self.server, node, loop, scenario.start, say)
        if settings.transforms:
            frames = static_transforms(scenario.sensors, settings, loop.outbox.epoch_ns)
            loop.outbox.put("/tf_static", encode_transforms(frames))

    def fileno(self) -> int:
        """The descriptor to wait on."""
        return self.server.fileno()

    def serve(self) -> None:
        """Answer the services that were called."""
        self.server.serve()

    def tick(self, time_ns: int) -> None:
        """Say what is due at this simulation time."""
        outbox = self._loop.outbox
        if self._clock.passes(time_ns):
            outbox.put("/clock", encode_clock(time_ns + outbox.epoch_ns))
        if self._wrench.passes(time_ns):
            wrench = self._loop.simulation.forces().thrusters
            payload = encode_wrench(time_ns + outbox.epoch_ns, wrench, f"{self._prefix}base_link")
            outbox.put("thruster_wrench", payload)

    def close(self) -> None:
        """Give the descriptor back."""
        self.server.close()


class _Due:
    """When something of `rate` Hz is due; never at 0."""

    def __init__(self, rate: float) -> None:
        self._period_ns = period_ns(rate) if rate else 0
        self._due_ns = 0 if rate else NEVER

    def passes(self, time_ns: int) -> bool:
        """True once a period; what was missed is not made up for."""
        if time_ns < self._due_ns:
            return False
        self._due_ns = time_ns - time_ns % self._period_ns + self._period_ns
        return True


def static_transforms(suite: Suite, settings: Ros, time_ns: int) -> list[Transform]:
    """From map to odom, which are one as no drift of the navigation is known, and from base_link to each sensor."""
    prefix = settings.frame_prefix
    base = f"{prefix}base_link"
    frames = [mounted(time_ns, "map", f"{prefix}odom", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))]
    for name in [name for name in suite if name not in WITHOUT_PLACE]:
        mounting, link = suite[name].mounting, f"{prefix}{name}_link"
        frames.append(mounted(time_ns, base, link, mounting.position, mounting.quaternion))
        if name.startswith("dvl"):
            head = f"{prefix}{name}_transducer_link"
            frames.append(Transform(time_ns, link, head, (0.0, 0.0, 0.0), TURNED_UP))
    return frames
