"""The imaging process: read requests from standard input, publish pictures, write confirmations to standard output.

    python -m hil.slave.imaging.process      started by hil.slave.imaging.sensors

It loads the scenario's world and offloaded sensors. For each request it puts the vehicle at the requested state, makes
the sensor's sample, and publishes it under the slave's node name. Its own network session is a client of the slave's.
The first sample of each sensor is always made; later ones only if somebody subscribes to them. The process has the
lowest priority and leaves the first core to the loop. It ends when its standard input closes.
"""

import os
import pickle
import select
import sys
from collections.abc import Callable, Iterator, Sequence
from struct import Struct
from typing import Any

from hil.common.clock import NS_PER_S, now_ns
from hil.common.endpoint import split_endpoint
from hil.common.errors import HilError
from hil.common.lifeline import die_with_parent
from hil.common.stop import StopSignals
from hil.network.opening import open_session
from hil.network.session import Session
from hil.network.settings import settings
from hil.network.tokens import router_key
from hil.ros import dialect
from hil.ros import encoders as ros
from hil.ros.graph import Identity
from hil.ros.own import announce
from hil.ros.topics import FAN, first_of
from hil.scenario.config import Scenario, build_simulation
from hil.slave.imaging.neighbours import Neighbours
from hil.slave.imaging.sensors import DONE, REQUEST
from hil.slave.sample_publisher import MessageContent, SamplePublisher
from sim.environment.world import load_world
from sim.sensors.samples import Sample
from sim.sensors.sensor_set import Slot
from sim.vehicle.vehicle import load_vehicle

NICE = 10
# sched_setattr(2), which the C library does not wrap: size, policy, flags, nice, priority, runtime, deadline, period
SCHED_ATTR = Struct("<IIQiIQQQ")
SCHED_SETATTR = {"x86_64": 314, "aarch64": 274, "armv7l": 380}
SHARE_NS = 10_000_000
IN, OUT, ERRORS = 0, 1, 2
HERE = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}  # addresses to connect to if the slave listens on all interfaces

Message = tuple[str, bytes]


def main() -> int:
    """Serve requests until the input ends or a signal arrives; return the exit code."""
    die_with_parent()
    reply_fd = os.dup(OUT)
    os.dup2(ERRORS, OUT)  # so that a library that prints does not write into our answers
    _lower_priority()
    try:
        with StopSignals() as stop_fd:
            scenario, node = pickle.loads(_read_exactly(int.from_bytes(_read_exactly(4), "little")))
            dialect.select(scenario.ros.domain, scenario.ros.distro)
            _serve(scenario, node, reply_fd, stop_fd)
    except HilError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except EOFError:  # the slave ended meanwhile
        pass
    return 0


def _lower_priority() -> None:
    _interruptible()
    first, *others = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, others or [first])


def _interruptible() -> None:
    """Let every process that wakes up preempt this one at once, instead of at the end of its time slice.

    This matters for kernel threads too: the one that carries bytes through a pty waited up to 5 ms for this process,
    and the loop waited with it. Since Linux 6.12 a process with a shorter time slice may preempt; the default is 3 ms.
    The longest slice, 100 ms, delayed this process by seconds on a busy machine, and its first picture by over 25 s.
    """
    import ctypes

    attributes = SCHED_ATTR.pack(SCHED_ATTR.size, os.SCHED_BATCH, 0, NICE, 0, SHARE_NS, 0, 0)
    number = SCHED_SETATTR.get(os.uname().machine)
    if number is None or ctypes.CDLL(None).syscall(number, 0, attributes, 0):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        os.nice(NICE)


def _read_exactly(count: int) -> bytes:
    received = b""
    while len(received) < count:
        data = os.read(IN, count - len(received))
        if not data:
            raise EOFError
        received += data
    return received


def _serve(scenario: Scenario, node: Identity, reply_fd: int, stop_fd: int) -> None:
    studio = Studio(scenario)
    slave = scenario.slave
    with join(scenario) as session, studio.neighbours.subscribe():
        sample_publisher = SamplePublisher(
            session, slave.node, 0, MessageContent(scenario.ros.frame_prefix), waits=True, of=node
        )
        delayed: list[tuple[int, Message]] = []  # monotonic time (ns) to publish at, message
        outlets: dict[int, list[str]] = {}  # sensor number -> topics of its messages so far
        while True:
            wait_s = (delayed[0][0] - now_ns()) / NS_PER_S if delayed else None
            ready = select.select((stop_fd, IN), (), (), wait_s if wait_s is None else max(0.0, wait_s))[0]
            if stop_fd in ready:
                return
            requests = os.read(IN, REQUEST.size * 64) if IN in ready else None
            if requests == b"":
                return
            for number, time_ns, epoch_ns, instant_ns, *moving in REQUEST.iter_unpack(requests or b""):
                took_ns = 0
                if number not in outlets or sample_publisher.has_subscribers(outlets[number]):
                    began = now_ns()
                    studio.neighbours.place_hulls(began)
                    taken = studio.take_sample(number, time_ns, moving)
                    messages = list(studio.encode(taken, epoch_ns, sample_publisher.has_subscribers))
                    due_ns = instant_ns + studio.delay_ns(number)
                    delayed += [(due_ns, message) for message in messages]
                    if messages:  # there are none if the sample was dropped
                        outlets[number] = [*{*outlets.get(number, ()), *[name for name, _ in messages]}]
                    took_ns = now_ns() - began
                os.write(reply_fd, DONE.pack(number, took_ns))
            delayed.sort(key=lambda waiting: waiting[0])
            _publish(sample_publisher, delayed)


def join(scenario: Scenario) -> Session:
    """Return a session that is a client of the slave's session, which forwards its messages.

    Like any client it has one link. With a router it connects to that instead, as the slave does, and starts even if
    the router is missing, as the slave does. Links that the library does not read are closed; otherwise new subscribers
    to pictures would stay unknown here. Raises NetworkError.
    """
    network = scenario.network
    scheme, host, port = split_endpoint(scenario.slave.listen)
    where = network.router or f"{scheme}/{HERE.get(host, host)}:{port}"
    text = settings("imaging", (), (where,), network, scenario.security)
    session = open_session("join", where, text)
    if network.router:
        session.declare_token(router_key(session.zid))
    session.supervise(network.lease)
    return session


def _publish(sample_publisher: SamplePublisher, delayed: list[tuple[int, Message]]) -> None:
    """Publish the messages that are due, and remove them from the list."""
    while delayed and delayed[0][0] <= now_ns():
        sample_publisher.publish(*delayed.pop(0)[1])


class Studio:
    """A scenario's world with its imaging sensors, addressed by number. Raises HilError.

    The simulation is never stepped; it is set to the vehicle's state. `neighbours` are the other vehicles of the fleet.
    """

    def __init__(self, scenario: Scenario) -> None:
        announce(scenario.sensors, f"{scenario.path}: sensors")
        vehicle, _ = load_vehicle(scenario.vehicle)
        self._simulation = build_simulation(scenario._replace(sensors={}), vehicle, load_world(scenario.world))
        step_ns = 1  # not used: nothing is stepped here
        self._slots = [
            Slot(name, fitted, self._simulation, scenario.seed, step_ns) for name, fitted in scenario.sensors.items()
        ]
        self._settings = scenario.ros
        self.neighbours = Neighbours(scenario, vehicle)
        for slot in self._slots:
            self.neighbours.stand_before(slot.sensor)

    def take_sample(self, number: int, time_ns: int, moving: list[float]) -> tuple[str, Sample] | None:
        """Return topic and sample of a sensor; None if there is no sample or the sensor drops it.

        `moving` is position (NED), quaternion (body to NED), nu (FRD) and its rate of change: 3 + 4 + 6 + 6 numbers;
        then the share of the lights and the tilt of cameras (rad).
        """
        simulation, slot = self._simulation, self._slots[number]
        state = simulation.state
        state.position, state.quaternion = moving[:3], moving[3:7]
        state.nu, state.nu_dot = moving[7:13], moving[13:19]
        if simulation.accessories:
            simulation.accessories.place(*moving[19:])
        simulation.time_ns = time_ns
        sample = slot.sensor.sample(time_ns, state)
        return None if sample is None or slot.drops(time_ns) else (slot.topic, sample)

    def delay_ns(self, number: int) -> int:
        """Return the delay (ns) between the time of a sensor's last sample and its publication."""
        return self._slots[number].delay_ns

    def encode(
        self, taken_sample: tuple[str, Any] | None, epoch_ns: int, has_subscribers: Callable[[Sequence[str]], bool]
    ) -> Iterator[Message]:
        """Yield the messages of a sample, each with its topic; costly ones only if their topic `has_subscribers`."""
        if taken_sample is None:
            return
        topic, sample = taken_sample
        stamped = sample._replace(time_ns=sample.time_ns + epoch_ns)
        prefix, settings = self._settings.frame_prefix, self._settings
        if first_of(topic) == "camera":
            yield from ros.encoder(topic)(stamped, prefix, settings.images, settings.jpeg_quality)
        else:
            yield from ros.encoder(topic)(stamped, prefix)
        if first_of(topic) == "forward_sonar" and has_subscribers((f"{topic}/{FAN}",)):
            from hil.ros.images import encode_fan

            yield f"{topic}/{FAN}", encode_fan(stamped, f"{prefix}{topic}_link")


if __name__ == "__main__":
    sys.exit(main())
