"""A client receives the topics that it subscribes to, and the vehicle sends no others."""

import json
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
from tests.support.processes import Program, slave_with, wait_for, write_scenario


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


def test_topics_that_a_planner_does_not_use_are_not_sent_in_a_mission(tmp_path: Path) -> None:
    """The same mission runs twice: in the second run the master records it, and so subscribes to all topics."""
    rates, folders, demos = [], [tmp_path / "spared", tmp_path / "whole"], []
    for folder, wish in zip(folders, ("", '[recording]\nmaster = true\ncompression = "none"\n'), strict=True):
        folder.mkdir()
        scenario, _ = write_scenario(folder)
        scenario.write_text(scenario.read_text().replace("goal = [8, 7]", "goal = [5.5, 5]") + wish)
        demos.append(Program(folder, "demo", scenario, "--output", folder / "run"))
    with demos[0], demos[1]:
        for demo in demos:
            assert demo.wait() == 0, demo.output
    for folder in folders:
        table = json.loads((folder / "run" / "table.json").read_text())["table"]
        slave = table["slave"]
        listened_s = float(slave["uptime_s"]) - table["startup_s"]  # before that there is nobody to send to
        simulated_s = listened_s - float(slave["steps_skipped"]) / 400.0  # what is skipped is not measured
        rates.append(float(slave["messages_sent"]) / simulated_s)
    spared, whole = rates
    assert whole > 150, "203 a second"
    assert spared < 0.5 * whole, "61 a second"


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
