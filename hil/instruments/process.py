"""The process of the instruments: the vehicle's samples in, the bytes of their wires in and out."""

import select
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, TextIO

from hil.client.client import Stamped, VehicleClient
from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S, now_ns
from hil.common.errors import ConfigError
from hil.common.stop import Wakeup
from hil.instruments.contract import Facts, Instrument, Response
from hil.instruments.station import Station
from hil.instruments.table import load_instrument
from hil.instruments.world import LiveWorld, Scene
from hil.network.session import Session
from hil.scenario.config import Scenario
from sim.environment.seawater.water_column import SOUND_SPEED, WaterColumn
from sim.environment.world import World, load_world, water_pressure

TURN_NS = 20 * NS_PER_MS  # within which new connections, lost devices and unsent bytes are looked after


class Instruments:
    """The instruments `names` of a scenario on a session to its slave. Raises NetworkError.

    `report` gets lines for a person; the file `sent` a line for each measurement that was written.
    """

    def __init__(
        self,
        scenario: Scenario,
        session: Session,
        node: str,
        names: Collection[str],
        report: Callable[[str], None],
        sent: TextIO | None = None,
    ) -> None:
        self._event = Wakeup()
        self._lock = threading.RLock()  # an instrument is called by one thread at a time
        self._fault: BaseException | None = None  # of an instrument, in another thread
        self._planned_ns = NEVER_NS  # when the main loop looks again, if nothing comes
        self._stack = ExitStack()
        self.stations: list[Station] = []
        with self._lock, ExitStack() as stack:
            self._client = stack.enter_context(
                VehicleClient(
                    session, node, role="observer", network=scenario.network, security=scenario.security,
                    report=report, on_sample=self._take_sample, topics=(),
                )
            )  # fmt: skip
            self._world = LiveWorld(scenario, self._client.watch)
            began_ns, world = now_ns(), load_world(scenario.world)
            for name in names:
                spec = scenario.sensors[name]
                kind = kind_of(scenario, name)
                places = spec.mounting, world.origin, world.origin_altitude
                speeds = [at.port for at in spec.instrument.at if at.kind in ("serial", "pty")]
                facts = Facts(
                    name, spec.topic, spec.model, (*speeds, kind.baud)[0], *places, _sound_speed(world), scenario.seed,
                    {}, water_pressure(world),
                )  # fmt: skip
                scene = Scene(self._world, spec, scenario.seed)
                station = Station(spec.instrument, kind, facts, scene, began_ns, report, self._answer, sent)
                stack.callback(station.close)
                self.stations.append(station)
            self._client.watch(*{topic for station in self.stations for topic in station.topics})
            self._stack = stack.pop_all()

    def __enter__(self) -> "Instruments":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(self, stop_fds: Sequence[int]) -> None:
        """Serve until one of `stop_fds` becomes readable. Raises what an instrument raised."""
        while True:
            wait_s = max(0, min(self._planned_ns - now_ns(), TURN_NS)) / NS_PER_S
            descriptors = [fd for station in self.stations for fd in station.descriptors()]
            ready = select.select([*stop_fds, self._event.fileno(), *descriptors], (), (), wait_s)[0]
            if not {*stop_fds}.isdisjoint(ready):
                return
            self._event.clear()
            with self._lock:
                if self._fault:
                    raise self._fault
                for station in self.stations:
                    station.poll(now_ns())
                self._planned_ns = self._next_ns()

    def _next_ns(self) -> int:
        return min([station.due_ns for station in self.stations], default=NEVER_NS)

    def _take_sample(self, topic: str, stamped: Stamped) -> None:
        """Give a sample, with the instant of its measurement, to those that need it.

        A thread of the network calls this, and so each message is on its wire without another change of threads.
        """
        value: Any = stamped.value
        with self._guarded():
            if isinstance(value, tuple) and value and isinstance(value[0], int):
                measured_ns = self._client.contact.sent_ns(value[0], stamped.received_ns)
                stamped = stamped._replace(sent_ns=measured_ns)
            if topic == self._world.truth:
                self._world.on_truth(stamped)
            for station in self.stations:
                if topic in station.topics:
                    station.on_sample(topic, stamped, now_ns())

    def _answer(self, station: Station, method: str, path: str, query: dict[str, str], body: bytes) -> Response | None:
        """Return a station's answer to a request of HTTP, in the thread of that; None if it is silent."""
        with self._guarded():
            return station.on_request(method, path, query, body, now_ns())
        return None

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Let one thread in, and the main loop know that something may be due, and of an error."""
        with self._lock:
            try:
                yield
            except Exception as error:  # noqa: BLE001 - the main loop ends with it
                self._fault = error
            is_sooner = self._next_ns() < self._planned_ns
        if is_sooner or self._fault:
            self._event.set()


def fitted_names(scenario: Scenario) -> tuple[list[str], list[str]]:
    """Return the sensors that are instruments: those that share a process, and those that need one of their own.

    Raises ConfigError if there are none.
    """
    fitted = [name for name, spec in scenario.sensors.items() if spec.instrument]
    if not fitted:
        raise ConfigError(
            f'{scenario.path}: no sensor is an instrument: add instrument = "waterlinked_a50" to [sensors.dvl]'
        )
    interactive = [name for name in fitted if kind_of(scenario, name).is_interactive]
    return [name for name in fitted if name not in interactive], interactive


def kind_of(scenario: Scenario, name: str) -> type[Instrument]:
    """Return the class of a sensor's instrument."""
    return load_instrument(scenario.sensors[name].instrument.name, f"{scenario.path}: sensors: {name}: instrument")


def _sound_speed(world: World) -> Callable[[float], float]:
    if world.ocean and world.ocean.profile:
        return WaterColumn(world.ocean.profile, world.gravity).sound_speed
    return lambda _: SOUND_SPEED
