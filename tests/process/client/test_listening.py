"""A client receives the topics that it subscribes to, and the vehicle sends no others."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.common.errors import ConfigError
from hil.master.follow import Follow
from hil.master.planner import Planner, topics_of
from hil.master.tasks import Tasks
from hil.ros.topics import ALL
from tests.support.processes import slave_with, wait_for


@pytest.fixture
def endpoint(tmp_path: Path) -> Iterator[str]:
    with slave_with(tmp_path, "leak = { rate = 0.5 }") as endpoint:
        yield endpoint


def test_only_subscribed_topics_are_sent(endpoint: str) -> None:
    with VehicleClient(endpoint, "uuv1", topics=("odom",)) as client:
        assert client.wait_for_vehicle(60)
        assert wait_for(lambda: client.received["odom"] > 10 and client.diagnostics())
        client.command(VelocityCommand(surge=0.1))
        assert wait_for(lambda: len(client.delays) > 0), "what it needs for itself comes besides"
        assert set(client.latest) == {"odom", "diagnostics"}
        assert {"imu", "pressure", "odom", "dvl"} <= client.offers(), "and it knows what there is"
        client.watch("imu", "odom")
        assert wait_for(lambda: client.received["imu"] > 50)
        odom, imu = client.received["odom"], client.received["imu"]
        assert wait_for(lambda: client.received["imu"] > imu + 200)
        share = (client.received["odom"] - odom) / (client.received["imu"] - imu)
        assert share < 0.3, "listened to once: 20 of them for 100 of those"
        assert "pressure" not in client.latest


@pytest.mark.parametrize("topics", [("odom",), (ALL,)])
def test_a_late_client_gets_the_existing_map(endpoint: str, topics: tuple[str, ...]) -> None:
    for _ in range(2):
        with VehicleClient(endpoint, "uuv1", role="observer", topics=topics) as client:
            client.watch("map")
            assert wait_for(lambda: client.received["map"])


@pytest.mark.parametrize("later", [(), (ALL,)])
def test_a_topic_subscribed_by_name_and_by_all_arrives_once(endpoint: str, later: tuple[str, ...]) -> None:
    """A planner that names no topics subscribes to all of them."""
    with VehicleClient(endpoint, "uuv1", topics=("odom", "ground_truth", *(() if later else (ALL,)))) as client:
        assert wait_for(lambda: client.received["odom"] > 0)
        client.watch(*later)
        before = dict(client.received)
        assert wait_for(lambda: client.received["imu"] >= before["imu"] + 200)
        for topic in ("odom", "ground_truth"):
            assert 20 < client.received[topic] - before[topic] < 60, "40, and 80 if they came twice"


class PlannerWithoutTopics(Planner):
    """A planner that does not name the topics it uses."""

    def command(self, time: float, samples: object) -> VelocityCommand:
        return VelocityCommand()


def test_planners_name_the_topics_they_use() -> None:
    assert topics_of(Follow()) == ("odom", "ground_truth")
    tasks = Tasks(home=[0.0, 0.0], scan="scanning_sonar", task=[{"name": "a", "at": [0.0, 0.0], "duration": 1.0}])
    assert topics_of(tasks) == ("odom", "ground_truth", "scanning_sonar", "battery", "dvl", "leak")
    assert topics_of(PlannerWithoutTopics()) == ("odom", "ground_truth", ALL), "one of a user's own gets all"


@pytest.mark.parametrize(
    ("subscriptions", "message"),
    [("imu", r"expected a tuple of topics, such as \('imu',\)"), (("lasser",), "no topic 'lasser'.*laser")],
)
def test_an_unknown_topic_of_a_planner_is_reported(subscriptions: str | tuple[str, ...], message: str) -> None:
    planner = PlannerWithoutTopics()
    planner.subscriptions = subscriptions
    with pytest.raises(ConfigError, match=f"PlannerWithoutTopics: subscriptions.*{message}"):
        topics_of(planner)
