"""The process of the instruments: the vehicle's samples in, the bytes of their wires in and out."""

import select
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from hil.client.client import Stamped, VehicleClient
from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S, now_ns
from hil.common.errors import ConfigError
from hil.common.stop import Wakeup
from hil.instruments.contract import Facts
from hil.instruments.station import Sent, Station
from hil.instruments.table import load_instrument
from hil.instruments.web import Job
from hil.instruments.world import LiveScene, LiveWorld
from hil.network.session import Session
from hil.scenario.config import Scenario
from sim.environment.seawater.water_column import SOUND_SPEED, WaterColumn
from sim.environment.world import World, load_world

TURN_NS = 20 * NS_PER_MS  # within which new connections, lost devices and unsent bytes are looked after
WAITING = 1000  # samples, and requests


class Instruments:
    """The instruments of a scenario on a session to its slave. Raises ConfigError without any, NetworkError.

    `report` gets lines for a person; `sent` is told of each measurement that was written (`station.Sent`).
    """

    def __init__(
        self,
        scenario: Scenario,
        session: Session,
        node: str,
        report: Callable[[str], None],
        sent: Sent | None = None,
    ) -> None:
        fitted = {name: spec for name, spec in scenario.sensors.items() if spec.instrument}
        if not fitted:
            raise ConfigError(
                f'{scenario.path}: no sensor is an instrument: add instrument = "waterlinked_a50" to [sensors.dvl]'
            )
        self._event = Wakeup()
        self._samples: deque[tuple[str, Stamped]] = deque(maxlen=WAITING)
        self._jobs: deque[tuple[Station, Job]] = deque(maxlen=WAITING)
        self._stack = ExitStack()
        with ExitStack() as stack:
            self._client = stack.enter_context(
                VehicleClient(
                    session, node, role="observer", network=scenario.network, security=scenario.security,
                    report=report, on_sample=self._take_sample, topics=(),
                )
            )  # fmt: skip
            self._world = LiveWorld(scenario, self._client.watch)
            began_ns, world = now_ns(), load_world(scenario.world)
            self.stations: list[Station] = []
            for name, spec in fitted.items():
                kind = load_instrument(spec.instrument.name, f"{scenario.path}: sensors: {name}: instrument")
                facts = Facts(
                    name, spec.topic, spec.model, spec.mounting, world.origin, world.origin_altitude,
                    _sound_speed(world), scenario.seed, {},
                )  # fmt: skip
                scene = LiveScene(self._world, spec, scenario.seed)
                station = Station(spec.instrument, kind, facts, scene, began_ns, report, self._take_job, sent)
                stack.callback(station.close)
                self.stations.append(station)
            self._client.watch(*{topic for station in self.stations for topic in station.topics})
            self._stack = stack.pop_all()

    def __enter__(self) -> "Instruments":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(self, stop_fd: int) -> None:
        """Serve until `stop_fd` becomes readable."""
        due_ns = 0
        while True:
            wait_s = max(0, min(due_ns - now_ns(), TURN_NS)) / NS_PER_S
            descriptors = [fd for station in self.stations for fd in station.descriptors()]
            if stop_fd in select.select([stop_fd, self._event.fileno(), *descriptors], (), (), wait_s)[0]:
                return
            due_ns = self.poll()

    def poll(self) -> int:
        """Do what is due; return when (monotonic ns) something is due next."""
        self._event.clear()  # before the queues are read: what comes later sets it again
        while self._samples:
            topic, stamped = self._samples.popleft()
            if topic == self._world.truth:
                self._world.on_truth(stamped)
            for station in self.stations:
                if topic in station.topics:
                    station.on_sample(topic, stamped, now_ns())
        while self._jobs:
            station, job = self._jobs.popleft()
            station.on_request(job, now_ns())
        return min([station.poll(now_ns()) for station in self.stations], default=NEVER_NS)

    def _take_sample(self, topic: str, stamped: Stamped) -> None:
        """Queue a sample with the instant of its measurement; called in threads of the network."""
        value: Any = stamped.value
        if isinstance(value, tuple) and value and isinstance(value[0], int):
            measured_ns = self._client.contact.sent_ns(value[0], stamped.received_ns)
            stamped = stamped._replace(sent_ns=measured_ns)
        self._samples.append((topic, stamped))
        self._event.set()

    def _take_job(self, station: Station, job: Job) -> None:
        self._jobs.append((station, job))
        self._event.set()


def _sound_speed(world: World) -> Callable[[float], float]:
    if world.ocean and world.ocean.profile:
        return WaterColumn(world.ocean.profile, world.gravity).sound_speed
    return lambda _: SOUND_SPEED
