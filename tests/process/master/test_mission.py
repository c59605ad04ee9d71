"""A mission whose vehicle sends no odometry, refuses commands or was restarted; without network, in simulated time."""

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import Stamped, VehicleClient
from hil.common.clock import NS_PER_S, to_wall_ns
from hil.common.errors import MissionError, NetworkError
from hil.master import mission as module
from hil.master.flight import Flight, Outcome, Plan, prepare, require_success
from hil.master.mission import Mission
from hil.master.progress import Progress
from hil.master.recorder import TrackWriter
from hil.ros import encoders as ros
from hil.scenario.config import load_scenario
from sim.run_events import RunEvent
from sim.sensors.samples import OdometrySample
from tests.support.diagnostics import reported
from tests.support.processes import write_scenario

LEVEL = (1.0, 0.0, 0.0, 0.0)


class Clock:
    """A monotonic clock that advances by the command period whenever the mission waits."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100 * NS_PER_S
        monkeypatch.setattr(module, "now_ns", lambda: self.now)
        monkeypatch.setattr("hil.master.mission.is_stopped", self.wait)
        monkeypatch.setattr("hil.client.client.now_ns", lambda: self.now)
        self.at_each: Any = lambda: None

    def wait(self, *arguments: Any) -> bool:
        self.now += 50_000_000
        self.at_each()
        return False


class Contact:
    losses = 0
    samples = 0

    def forget_clock(self) -> None:
        """Do nothing: a new slave was detected."""


class Vehicle:
    """The interface of a client as a mission uses it; the vehicle does not move unless the test moves it."""

    node, endpoint = "uuv1", "tcp/nowhere:1"

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.contact = Contact()
        self.latest: dict[str, Stamped] = {}
        self.commands: list[VelocityCommand] = []
        self.published: list[tuple[int, str]] = []
        self.events: tuple[RunEvent, ...] = ()
        self.reason = ""
        self.delays = self
        self.position = [4.0, 4.0, 2.0]
        self.attitude = LEVEL

    def totals_ns(self, newest: int = 0) -> list[int]:
        return []

    def publish_odometry(self) -> None:
        """Deliver the present odometry."""
        north, east, depth = self.position
        sample = OdometrySample(self.clock.now, (north, east, depth), self.attitude, (0.0,) * 6)
        self.latest["odom"] = Stamped(sample, self.clock.now, self.clock.now)

    def diagnostics(self) -> Any:
        return reported()

    def unavailable_reason(self) -> str:
        return self.reason

    def run_events(self, began_ns: int) -> tuple[RunEvent, ...]:
        return self.events

    def command(self, command: VelocityCommand) -> None:
        self.commands.append(command)

    def publish(self, topic: str, payload: bytes) -> None:
        self.published.append((self.clock.now, topic))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


@pytest.fixture
def vehicle(clock: Clock) -> Vehicle:
    return Vehicle(clock)


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    return prepare(load_scenario(str(write_scenario(tmp_path, allow="")[0])))


@pytest.fixture
def fly(tmp_path: Path, vehicle: Vehicle, plan: Plan) -> Iterator[Callable[[], Outcome]]:
    scenario = load_scenario(str(tmp_path / "short.toml"))
    progress = Progress(str(tmp_path / "log"), lambda text: None)
    with TrackWriter(str(tmp_path)) as track:
        mission = Mission(Flight(scenario, plan), 0.05, vehicle, track, progress)  # type: ignore[arg-type]

        def run() -> Outcome:
            try:
                return mission.fly(-1)
            finally:
                progress.close()

        yield run


def test_a_vehicle_without_odometry_ends_the_mission_after_a_timeout(
    fly: Callable[[], Outcome], vehicle: Vehicle, tmp_path: Path
) -> None:
    with pytest.raises(NetworkError, match=r"uuv1 at tcp/nowhere:1 has sent no odom for 10 s.*\[sensors.odometry\]"):
        fly()
    assert "no odom from uuv1 for 1." in (tmp_path / "log").read_text()
    assert not any(command.surge for command in vehicle.commands)


def test_a_vehicle_that_refuses_commands_ends_the_mission_with_the_reason(
    fly: Callable[[], Outcome], vehicle: Vehicle, clock: Clock
) -> None:
    def disarm() -> None:
        vehicle.publish_odometry()
        vehicle.reason = "uuv1 is disarmed" if clock.now > 102 * NS_PER_S else ""

    clock.at_each = disarm
    with pytest.raises(NetworkError, match="uuv1 is disarmed"):
        fly()


def test_missing_odometry_is_an_event_with_start_and_duration(
    fly: Callable[[], Outcome], vehicle: Vehicle, clock: Clock
) -> None:
    def stop_odometry() -> None:
        if not 105 * NS_PER_S < clock.now < 108 * NS_PER_S:
            vehicle.publish_odometry()

    clock.at_each = stop_odometry
    outcome = fly()
    (event,) = outcome.events
    assert (event.kind, event.what) == ("link_lost", "no odometry from uuv1")
    assert event.start_ns == pytest.approx(5 * NS_PER_S, abs=0.1 * NS_PER_S)
    assert event.duration_ns == pytest.approx(3 * NS_PER_S, abs=0.2 * NS_PER_S)
    assert outcome.reason == "time limit"
    assert outcome.verdict == "time limit, but link lost: no odometry from uuv1"


def test_a_short_loss_of_the_vehicle_is_an_event(fly: Callable[[], Outcome], vehicle: Vehicle, clock: Clock) -> None:
    def interrupt_vehicle() -> None:
        vehicle.publish_odometry()
        vehicle.contact.losses = int(clock.now > 110 * NS_PER_S)

    clock.at_each = interrupt_vehicle
    assert [event.kind for event in fly().events] == ["link_lost"]


def test_events_of_the_vehicle_and_of_the_mission_are_merged(
    fly: Callable[[], Outcome], vehicle: Vehicle, clock: Clock
) -> None:
    """Both report the capsizing, only the mission the surfacing, and only the vehicle the collision with the bed."""

    def tumble() -> None:
        elapsed_ns = clock.now - 100 * NS_PER_S
        vehicle.attitude = (0.0, 1.0, 0.0, 0.0) if 2 * NS_PER_S <= elapsed_ns < 3 * NS_PER_S else LEVEL
        there = [8.0, 7.0] if elapsed_ns > 9 * NS_PER_S else [4.0, 4.0]
        vehicle.position = [*there, 0.05 if 5 * NS_PER_S <= elapsed_ns < 7 * NS_PER_S else 2.0]
        vehicle.publish_odometry()

    clock.at_each = tumble
    vehicle.position = [4.0, 4.0, 2.0]
    vehicle.events = (
        RunEvent("collision", 1 * NS_PER_S, NS_PER_S, (4.0, 4.0, 4.8), "the seabed"),
        RunEvent("capsize", 2 * NS_PER_S, NS_PER_S, (4.0, 4.0, 2.0)),
    )
    outcome = fly()
    assert outcome.reached
    assert outcome.verdict.startswith("goal reached, but collision with the seabed")
    kinds = [event.kind for event in outcome.events]
    assert kinds == ["collision", "capsize", "surfaced"]
    with pytest.raises(
        MissionError, match=r"goal reached after .*, but collision with the seabed 1.0 s after the start"
    ):
        require_success(outcome)
    allowed = outcome._replace(allow=tuple(kinds))
    assert allowed.success
    assert allowed.verdict == "goal reached"
    require_success(allowed)
    plain = json.loads(json.dumps(outcome.as_plain()))
    assert not plain["success"]
    assert plain["events"][0] == {
        "kind": "collision", "what": "the seabed", "start_s": 1.0, "duration_s": 1.0, "place": [4.0, 4.0, 4.8],
    }  # fmt: skip
    assert any("EVENT: collision with the seabed 1.0 s after the start" in line for line in outcome.event_lines)


def receiver() -> VehicleClient:
    """Return a client that was never connected; the test passes messages to it."""
    client = VehicleClient.__new__(VehicleClient)
    client.received, client.latest, client.malformed = {}, {}, 0
    client._senders = {}
    client._first_samples, client._first_sample = {}, threading.Event()
    client._on_sample = lambda *_: None
    client.contact = Contact()  # type: ignore[assignment]  # a stand-in
    client.contact.sent_ns = lambda their_wall_ns, received_ns: received_ns  # type: ignore[method-assign]
    return client


def test_start_up_time_ends_with_the_first_sample_of_the_same_slave(clock: Clock) -> None:
    """A slave was replaced while the master waited: the start-up was -7.669 s, from the first one's sample."""
    client, exec_wall_ns = receiver(), {}
    for second, gid in ((0, b"a"), (8, b"b")):
        clock.now = (100 + second) * NS_PER_S
        exec_wall_ns[gid] = to_wall_ns(clock.now)
        for number in range(1, 4):
            clock.now += NS_PER_S // 10
            for topic in ("odom", "ground_truth"):
                sample = OdometrySample(to_wall_ns(clock.now), (0.0, 0.0, 5.0), LEVEL, (0.0,) * 6)
                stamp = ros.pack_attachment(number, to_wall_ns(clock.now), gid * 16)
                client._deliver(topic, ros.encode_odometry(sample), stamp)
    assert client.first_sample_ns(exec_wall_ns[b"b"]) == exec_wall_ns[b"b"] + NS_PER_S // 10
    assert client.first_sample_ns(exec_wall_ns[b"b"] + NS_PER_S) is None, "a third one has sent nothing yet"


def test_the_path_is_published_at_once_and_then_once_a_second(
    fly: Callable[[], Outcome], vehicle: Vehicle, clock: Clock, plan: Plan
) -> None:
    """A new path is published at once, then once a second."""
    start = clock.now

    def at_each() -> None:
        vehicle.publish_odometry()
        if clock.now - start > 2.4e9 and plan.planner.path is path:
            plan.planner.path = [*path]
        if clock.now - start > 4e9:
            vehicle.reason = "enough"

    path = plan.planner.path
    clock.at_each = at_each
    with pytest.raises(NetworkError, match="enough"):
        fly()
    assert {topic for _, topic in vehicle.published} == {"plan"}
    instants = [(now - start) / NS_PER_S for now, _ in vehicle.published]
    assert [round(instant, 1) for instant in instants] == pytest.approx([0.1, 1.1, 2.1, 2.5, 3.5], abs=0.1)
