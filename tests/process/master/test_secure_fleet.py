"""Planners of a fleet with TLS: access to their reports and commands by certificate."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from hil.master.agent import run
from hil.network.opening import listen
from hil.network.presence import declare_presence, watch_presence
from hil.network.roles import open_client_session, open_master_session, open_peer_session
from hil.network.security import Security
from hil.network.session import Session
from hil.ros.topics import TOPICS
from hil.scenario.config import load_scenario
from hil.scenario.variant import write_variant
from tests.support.network.fleet_keys import PLANNERS, keys
from tests.support.processes import free_port, wait_for

__all__ = ["keys"]  # the fixture


def security(keys: Path, master: str) -> Security:
    return Security(str(keys / "uuv"), str(keys / master), PLANNERS, ("viewer",))


@pytest.fixture
def first(keys: Path) -> Iterator[tuple[Session, str, str]]:
    """Provide the first planner, connected to its vehicle, with the endpoints of the planner and of the vehicle."""
    agent, vehicle = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with (
        listen(vehicle, security=security(keys, PLANNERS[0])),
        open_peer_session(agent, vehicle, security=security(keys, PLANNERS[0])) as session,
    ):
        yield session, agent, vehicle


def test_planners_exchange_reports_only_and_others_cannot_report(first: tuple[Session, str, str], keys: Path) -> None:
    session, endpoint, _ = first
    received: list[tuple[str, str]] = []
    session.subscribe("uuv1", "*", lambda topic, payload, _: received.append((payload.decode(), topic)), 64)
    sent = [session.publisher("uuv1", TOPICS[topic]) for topic in ("formation", "cmd_vel", "odom")]
    other_sessions = {
        name: open_master_session(endpoint, security=security(keys, name))
        for name in (PLANNERS[1], "viewer", "outsider", "other/planner2")
    }
    topics: dict[str, set[str]] = {name: set() for name in other_sessions}
    publishers = []
    for name, other in other_sessions.items():
        other.subscribe("uuv1", "*", lambda topic, _, __, name=name: topics[name].add(topic), 64)  # type: ignore[misc]
        publishers += [(name, other.publisher("uuv1", TOPICS[topic])) for topic in ("formation", "cmd_vel", "odom")]

    def all_publish() -> bool:
        for publisher in sent:
            publisher.put(b"first", 0)
        for name, publisher in publishers:
            publisher.put(name.encode(), 0)
        return len(received) > 20 and bool(topics[PLANNERS[1]] and topics["viewer"])

    assert wait_for(all_publish), (received, topics)
    for _ in range(20):
        all_publish()
    assert set(received) == {(PLANNERS[1], "formation")}
    assert topics == {PLANNERS[1]: {"formation"}, "viewer": {"formation"}, "outsider": set(), "other/planner2": set()}
    for other in other_sessions.values():
        other.close()


def test_a_client_of_a_planner_can_only_appear_as_an_observer(first: tuple[Session, str, str], keys: Path) -> None:
    session, endpoint, _ = first
    presences: list[str] = []
    watch_presence(session, "uuv1", lambda presence, _: presences.append(presence.role))
    with open_master_session(endpoint, security=security(keys, PLANNERS[1])) as other_session:
        declare_presence(other_session, "uuv1", "slave")
        declare_presence(other_session, "uuv1", "master")
        declare_presence(other_session, "uuv1", "observer")
        assert wait_for(lambda: presences)
    assert set(presences) == {"observer"}


def test_a_planner_with_tls_commands_its_vehicle_and_receives_samples(keys: Path) -> None:
    agent, vehicle = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    arrived: list[str] = []
    received: list[str] = []
    with (
        listen(vehicle, security=security(keys, PLANNERS[0])) as slave,
        open_peer_session(agent, vehicle, security=security(keys, PLANNERS[0])) as planner,
        open_client_session(vehicle, security=security(keys, "viewer"), seconds=30.0),
    ):
        slave.subscribe("uuv1", "cmd_vel", lambda topic, _, __: arrived.append(topic), 8)
        planner.subscribe("uuv1", "odom", lambda topic, _, __: received.append(topic), 8)
        command, odom = planner.publisher("uuv1", TOPICS["cmd_vel"]), slave.publisher("uuv1", TOPICS["odom"])
        assert wait_for(lambda: (command.put(b"", 0), odom.put(b"", 0)) and arrived and received)


def test_a_modem_together_with_security_is_refused(keys: Path, tmp_path: Path) -> None:
    changes = {
        "security.slave": str(keys / "uuv"),
        "security.master": str(keys / PLANNERS[0]),
        "security.may_command": list(PLANNERS),
    }
    scenario = load_scenario(write_variant("target_hunting_acoustic", str(tmp_path), changes))
    with pytest.raises(ConfigError, match="leave out one of the two"):
        run(scenario, scenario.member[0].node, -1, print)
