"""Samples of one vehicle in the Python interface: the newest of each sensor, and streams."""

import threading
import time
import weakref
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar, overload

from hil.client import samples
from hil.client.client import Stamped, VehicleClient
from hil.client.samples import State
from hil.client.stream import Stream
from hil.common.errors import ConfigError, NetworkError
from hil.common.schema import nearest
from hil.network.security import Security
from hil.network.session import Session
from hil.network.settings import Network
from hil.ros import graph
from hil.ros.diagnostics import Diagnostics
from hil.ros.topics import DESCRIPTIONS, TOPICS, is_picture, learn

if TYPE_CHECKING:
    from typing_extensions import Self

COMPRESSED = "/compressed"  # end of the name of a topic with JPEG pictures in ROS
RETURNS_WITHIN_S = 3.0  # time that a reader waits for a lost vehicle to return
FIRST_WITHIN_S = 1.0  # time that a reader waits for the first sample of a sensor
MADE_WITHIN_S = 30.0  # the same for descriptions and for pictures, whose process may still be starting
POLL_S = 0.1  # polling period of a wait

T = TypeVar("T")


class Newest(Generic[T]):
    """A sensor as an attribute of a vehicle: its newest sample. Raises NetworkError without one."""

    def __init__(self, kind: type[T], topic: str = "") -> None:
        self._kind = kind
        self._topic = topic

    def __set_name__(self, owner: type, name: str) -> None:
        self._topic = self._topic or name

    @overload
    def __get__(self, vehicle: None, owner: type) -> "Self": ...
    @overload
    def __get__(self, vehicle: "VehicleState", owner: type) -> T: ...
    def __get__(self, vehicle: "VehicleState | None", owner: type) -> "T | Self":
        return self if vehicle is None else vehicle.newest(self._topic)


class _Patience:
    """Time limit of a wait for a sample: `first_s`, extended while `comes_later` returns true, up to MADE_WITHIN_S.

    Each extension is RETURNS_WITHIN_S, because the topics of a process that starts appear one after the other.
    """

    def __init__(self, first_s: float, comes_later: Callable[[], bool]) -> None:
        self._first_s = self._end_s = first_s
        self._comes_later = comes_later
        self._waited_s = 0.0

    def is_over(self, waited_s: float) -> bool:
        """Return whether to give up after waiting `waited_s`; a smaller value than before starts a new wait."""
        if waited_s < self._waited_s:
            self._end_s = self._first_s
        self._waited_s = waited_s
        if waited_s <= self._end_s:
            return False
        self._end_s = waited_s + RETURNS_WITHIN_S
        return waited_s > MADE_WITHIN_S or not self._comes_later()


class VehicleState:
    """The samples of a vehicle; its commands are in `hil.client.vehicle_handle.Vehicle`.

    Every attribute raises NetworkError if the vehicle is lost or has no such sensor.
    """

    state = Newest(State, "odom")
    ground_truth = Newest(State)
    imu = Newest(samples.Imu)
    ahrs = Newest(samples.Imu)
    dvl = Newest(samples.Dvl)
    dvl_water = Newest(samples.Dvl)
    pressure = Newest(samples.Pressure)
    altitude = Newest(samples.Altitude)
    altimeter = Newest(samples.Distance)
    echosounder = Newest(samples.Distance)
    magnetometer = Newest(samples.Field)
    current_meter = Newest(samples.Current)
    gps = Newest(samples.Fix)
    usbl = Newest(samples.Position)
    battery = Newest(samples.Battery)
    laser = Newest(samples.Scan)
    profiler = Newest(samples.Scan)
    scanning_sonar = Newest(samples.Scan)
    contact = Newest(samples.Flag)
    leak = Newest(samples.Flag)

    def __init__(
        self,
        session: Session,
        name: str,
        role: Literal["master", "observer"],
        rank: int,
        network: Network,
        security: Security | None,
    ) -> None:
        self.name = name
        self._role = role
        self._session = session
        self._streams: dict[str, weakref.WeakSet[Stream]] = {}
        self._listeners: list[Callable[[str], None]] = []
        self._first = threading.Condition()
        self._closing = threading.Event()
        self.client = VehicleClient(
            session,
            name,
            role=role,
            rank=rank,
            network=network,
            security=security,
            on_sample=self._on_message,
            topics=("odom",),
        )

    def __repr__(self) -> str:
        return f"<vehicle {self.name} at {self.client.endpoint}{'' if self.present else ', lost'}>"

    @property
    def present(self) -> bool:
        """True if the vehicle is present."""
        return self.client.contact.present

    @property
    def diagnostics(self) -> Diagnostics:
        """The slave's newest diagnostics, published once a second; empty before the first."""
        return self.client.diagnostics()

    def newest(self, topic: str) -> Any:
        """Return the newest sample on a topic of hil.ros.topics. Raises NetworkError, ConfigError."""
        self._listen(topic)
        began, patience = time.monotonic(), _Patience(FIRST_WITHIN_S, lambda: self._comes_later(topic))
        while True:
            with self._first:
                has_come = self._first.wait_for(lambda: self.present and topic in self.client.latest, POLL_S)
            self._require_presence(RETURNS_WITHIN_S)
            if has_come:
                return samples.aged(topic, self.client.latest[topic])
            waited_s = time.monotonic() - began
            if self.present and patience.is_over(waited_s):
                raise NetworkError(self._no_sensor(topic, waited_s))

    def samples(self, topic: str, timeout: float = 5.0, depth: int = 256) -> Stream:
        """Iterate over the samples of a sensor from now on, with `for` or `async for`: vehicle.samples("imu").

        Raises ConfigError for an unknown topic; the iteration raises NetworkError if the vehicle is lost or the sensor
        sends nothing for `timeout` s. At most `depth` samples wait; beyond it the oldest are dropped.
        """

        patience = _Patience(timeout, lambda: self._starts(topic, self.pictures()))

        def check(waited_s: float) -> None:
            self._require_presence(RETURNS_WITHIN_S)
            if patience.is_over(waited_s):
                raise NetworkError(self._no_sensor(topic, waited_s))

        self._listen(topic)
        stream = Stream(check, depth)
        with self._first:
            self._streams.setdefault(topic, weakref.WeakSet()).add(stream)
        return stream

    def notify(self, listener: Callable[[str], None]) -> None:
        """Call `listener` with the topic of each message from now on, in the session's reader; it must be quick.

        It is called for the topics that are subscribed to, now or later.
        """
        self._listeners.append(listener)

    def close(self) -> None:
        """End the streams and disconnect from the vehicle. May be called twice."""
        self._closing.set()
        for streams in self._streams.values():
            for stream in list(streams):
                stream.close()
        self.client.close()

    def _listen(self, topic: str) -> None:
        if topic not in TOPICS and not self._learn(topic):
            raise ConfigError(
                f"{self.name}: no topic {topic!r}{nearest(topic, list(TOPICS))}; a sensor of your own is known once "
                "its scenario was read: hil.scenario.config.load_scenario(FILE)"
            )
        self.client.watch(topic)

    def _on_message(self, topic: str, stamped: Stamped) -> None:
        """Pass a message to listeners and streams; called by the session's reader."""
        with self._first:
            self._first.notify_all()
            streams = list(self._streams.get(topic, ()))
        for listener in self._listeners:
            listener(topic)
        for stream in streams:
            stream.put(samples.aged(topic, stamped))

    def _comes_later(self, topic: str) -> bool:
        """Return whether a topic is published only on subscription, or its process is still starting."""
        pictures = self.pictures()
        return topic in DESCRIPTIONS or topic in pictures or self._starts(topic, pictures)

    def _require_presence(self, patience_s: float = 0.0) -> None:
        """Raise NetworkError if this was closed, or the vehicle is lost and silent for more than `patience_s`."""
        if self._closing.is_set():
            raise NetworkError(f"{self.name}: the connection was closed; connect again")
        if not self.present and (contact := self.client.contact).silence_s > patience_s:
            raise NetworkError(
                f"{self.name} at {self.client.endpoint} {contact.silence}: its slave has ended, or "
                "the network between is down; the client reconnects by itself, "
                f'fleet.wait_for("{self.name}") waits for it'
            )

    def _no_sensor(self, topic: str, waited: float) -> str:
        pictures = self.pictures()
        if self._starts(topic, pictures):
            sensor = topic.partition("/")[0]
            return (
                f"{self.name} has sent no {topic!r} for {waited:.1f} s: the process that makes the pictures of its "
                f"{sensor} is still starting; ask again, or see the slave's log if it does not come up"
            )
        available = ", ".join(sorted({name for name in self.client.offers() if name.isidentifier()} | pictures))
        other = topic.removesuffix(COMPRESSED) if topic.endswith(COMPRESSED) else topic + COMPRESSED
        if other in pictures - {topic}:
            remedy = f"its pictures are {other!r}, as [ros] images in the slave's scenario says"
        else:
            remedy = "other sensors are sections [sensors.NAME] of the slave's scenario"
        return f"{self.name} has sent no {topic!r} for {waited:.1f} s; it sends {available}; {remedy}"

    def pictures(self) -> set[str]:
        """Return the topics of its pictures, from the ROS graph, because pictures are sent only on subscription.

        Topics of further sensors of a kind are added to the known topics.
        """
        published = self._published()
        return {name for name, kind in published.items() if is_picture(name) and learn(name, kind, published)}

    def _published(self) -> dict[str, str]:
        """Return the topics that the vehicle's node publishes, with their types, from the ROS graph."""
        own = f"/{self.name}/"
        entities = [graph.read_token(key) for key in self._session.tokens(graph.ALL)]
        published = {entity.topic: entity.type for entity in entities if entity and entity.kind == "MP"}
        return {topic.removeprefix(own): kind for topic, kind in published.items() if topic.startswith(own)}

    def _learn(self, topic: str) -> bool:
        """Return whether the vehicle publishes this topic, of a kind that we know; add it to the known topics.

        For a picture this waits: the graph may show its topic later than the slave.
        """
        began = time.monotonic()
        while topic not in (published := self._published()):
            patience_s = MADE_WITHIN_S if self._starts(topic, published) else RETURNS_WITHIN_S
            if not self._may_come(topic) or time.monotonic() - began > patience_s or self._closing.wait(POLL_S):
                return False
        return learn(topic, published[topic], published)

    def _may_come(self, topic: str) -> bool:
        """Return False if the slave's diagnostics list no imaging sensor for the topic; True if unknown."""
        sensors = self.diagnostics.imaging_requested
        return sensors is None or topic.partition("/")[0] in sensors

    def _starts(self, topic: str, published: Iterable[str]) -> bool:
        """Return whether the topic belongs to an imaging sensor that has published nothing yet, as at its start."""
        sensor = topic.partition("/")[0]
        is_there = any(name.partition("/")[0] == sensor for name in published)
        return not is_there and sensor in (self.diagnostics.imaging_requested or {})
