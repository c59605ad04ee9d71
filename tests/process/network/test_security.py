"""Mutual TLS and access control: who may connect, who may command, and the reasons given to those refused."""

from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

import pytest

from hil.commands.keys import add_machine, init
from hil.network.diagnosis import why_not
from hil.network.opening import listen
from hil.network.presence import declare_presence, watch_presence
from hil.network.roles import open_master_session
from hil.network.security import Security
from hil.network.session import Session
from hil.network.tokens import Presence, clock_keys
from hil.ros import graph
from hil.ros.topics import TOPICS
from tests.support.processes import free_port, wait_for

MACHINES = ("uuv1", "laptop", "viewer", "outsider")


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Provide folders of four machines of one authority, and one of another."""
    folder = tmp_path_factory.mktemp("keys")
    init(str(folder))
    for name in MACHINES:
        add_machine(str(folder), name, ["localhost"])
    init(str(folder / "other"))
    add_machine(str(folder / "other"), "laptop", ["localhost"])
    return folder


def security(keys: Path, master: str = "laptop", may_listen: tuple[str, ...] = ("viewer",)) -> Security:
    return Security(str(keys / "uuv1"), str(keys / master), ("laptop",), may_listen)


@pytest.fixture
def slave(keys: Path) -> Iterator[tuple[Session, str, list[str]]]:
    """Provide a slave, its endpoint, and the names whose commands arrived."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    received: list[str] = []
    with listen(endpoint, security=security(keys)) as session:
        session.subscribe("uuv1", "cmd_vel", lambda _, payload, __: received.append(payload.decode()), 8)
        declare_presence(session, "uuv1", "slave")
        yield session, endpoint, received


def watch_node(session: Session) -> list[Presence]:
    """Return a list that receives the presences of the node as the session sees them."""
    seen: list[Presence] = []
    watch_presence(session, "uuv1", lambda presence, alive: seen.append(presence) if alive else None)
    return seen


def test_rights_follow_from_the_certificate(slave: tuple[Session, str, list[str]], keys: Path) -> None:
    session, endpoint, received = slave
    samples = session.publisher("uuv1", TOPICS["pressure"])
    topics: dict[str, list[str]] = {name: [] for name in MACHINES[1:]}
    sessions = {name: open_master_session(endpoint, security=security(keys, name)) for name in topics}
    commands = {}
    for name, other in sessions.items():
        other.subscribe("uuv1", "*", lambda topic, _, __, name=name: topics[name].append(topic), 8)  # type: ignore[misc]
        commands[name] = other.publisher("uuv1", TOPICS["cmd_vel"])

    def all_have_pinged() -> bool:
        samples.put(b"sample", 0)
        for name, publisher in commands.items():
            publisher.put(name.encode(), 0)
        return len(received) > 20 and len(topics["laptop"]) > 20 and len(topics["viewer"]) > 20

    assert wait_for(all_have_pinged), (received, topics)
    assert set(received) == {"laptop"}
    assert set(topics["laptop"]) == set(topics["viewer"]) == {"pressure"}
    assert topics["outsider"] == []
    assert sessions["laptop"].others() == ["uuv1"]
    assert {"laptop", "viewer", "outsider"} == set(session.others())
    for other in sessions.values():
        other.close()


def test_presence_is_sent_only_to_those_who_may_listen(slave: tuple[Session, str, list[str]], keys: Path) -> None:
    _, endpoint, _ = slave
    with (
        open_master_session(endpoint, security=security(keys, "viewer")) as viewer,
        open_master_session(endpoint, security=security(keys, "outsider")) as outsider,
    ):
        seen, unseen = watch_node(viewer), watch_node(outsider)
        assert wait_for(lambda: [presence.role for presence in seen]) == ["slave"]
        assert not unseen


def test_a_listener_cannot_appear_as_a_master_or_slave(slave: tuple[Session, str, list[str]], keys: Path) -> None:
    session, endpoint, _ = slave
    presences: list[str] = []
    session.watch_tokens("uuv_hil/**", lambda key, _: presences.append(key))
    with (
        open_master_session(endpoint, security=security(keys, "viewer")) as viewer,
        open_master_session(endpoint, security=security(keys, "laptop")) as laptop,
    ):
        for forged in ("uuv1/alive/master/9/ab/x", "uuv1/alive/slave/0/ab/x", "*/alive/**", "uuv1/alive/$*r/9/ab/x"):
            viewer.declare_token(f"uuv_hil/{forged}")
        declare_presence(viewer, "uuv1", "observer", "0b")
        graph.Node(viewer, "rviz")
        declare_presence(laptop, "uuv1", "master", "0a", 3)
        assert wait_for(lambda: len(presences) >= 3 and any("rviz" in key for key in session.tokens(graph.ALL)))
        others = sorted(key.split("/")[3:6] for key in presences if "/slave/" not in key or "/ab/" in key)
        assert others == [["master", "3", "0a"], ["observer", "0", "0b"]]
    assert wait_for(lambda: len(presences) == 5), "both have gone, and nobody else"


def test_a_listener_may_ping_but_not_report_as_a_master(slave: tuple[Session, str, list[str]], keys: Path) -> None:
    session, endpoint, _ = slave
    ask, _, masters = clock_keys("uuv1")
    requested: list[bytes] = []
    reported: list[bytes] = []
    session.receive(ask, requested.append, 64)
    session.receive(masters, reported.append, 64)
    with (
        open_master_session(endpoint, security=security(keys, "viewer")) as viewer,
        open_master_session(endpoint, security=security(keys, "laptop")) as laptop,
    ):
        forged = ("uuv_hil/**", "uuv_hil/uuv1/*/*", "uuv_hil/uuv1/ping/**", "**/master")
        viewers = cycle([viewer.sender(key) for key in (masters, *forged, ask)])
        laptops = [laptop.sender(key) for key in (masters, ask)]

        def all_have_pinged() -> bool:
            next(viewers)(b"viewer")  # one at a time: many at once would be dropped as a flood, whatever they may do
            for send in laptops:
                send(b"laptop")
            return len(reported) > 20 and {b"viewer", b"laptop"} <= set(requested)

        assert wait_for(all_have_pinged), (requested, reported)
    assert set(reported) == {b"laptop"}


def test_a_wildcard_lets_everyone_with_a_certificate_listen(keys: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        listen(endpoint, security=security(keys, may_listen=("*",))) as slave,
        open_master_session(endpoint, security=security(keys, "outsider")) as outsider,
    ):
        declare_presence(slave, "uuv1", "slave")
        seen = watch_node(outsider)
        assert wait_for(lambda: seen)


@pytest.mark.parametrize(
    ("folder", "messages"),
    [("other/laptop", ["not of the authority", "ca.pem"]), ("", ["wants a certificate", "[security]"])],
)
def test_a_wrong_or_missing_certificate_is_refused_with_a_reason(
    slave: tuple[Session, str, list[str]], keys: Path, folder: str, messages: list[str]
) -> None:
    session, endpoint, received = slave
    with open_master_session(endpoint, security=security(keys, folder) if folder else None) as refused:
        publisher, seen = refused.publisher("uuv1", TOPICS["cmd_vel"]), watch_node(refused)
        assert not wait_for(lambda: publisher.put(b"refused", 0) and (received or seen or refused.others()), 1)
    assert session.others() == []
    fault = why_not(endpoint, str(keys / folder) if folder else "")
    assert fault is not None
    assert fault.lasting
    assert all(word in fault.text for word in messages), fault.text


def test_a_certificate_that_the_slave_does_not_trust_is_reported(
    slave: tuple[Session, str, list[str]], keys: Path, tmp_path: Path
) -> None:
    """This side trusts the authority of the slave, which does not trust that of this side."""
    for name, source in (("ca.pem", "laptop"), ("cert.pem", "other/laptop"), ("key.pem", "other/laptop")):
        (tmp_path / name).write_bytes((keys / source / name).read_bytes())
    fault = why_not(slave[1], str(tmp_path))
    assert fault is not None
    assert fault.lasting
    assert "refuses our certificate" in fault.text, fault.text
    assert str(tmp_path) in fault.text


def test_a_host_that_is_not_in_the_certificate_is_reported(keys: Path) -> None:
    endpoint = f"tcp/127.0.0.2:{free_port()}"
    with (
        listen(endpoint, security=security(keys)) as slave,
        open_master_session(endpoint, security=security(keys)) as master,
    ):
        declare_presence(slave, "uuv1", "slave")
        presences = watch_node(master)
        fault = why_not(endpoint, str(keys / "laptop"))
        assert fault is not None
        assert "not made for '127.0.0.2'" in fault.text
        assert "--host 127.0.0.2" in fault.text
        assert not wait_for(lambda: presences, 0.5)


def test_a_machine_that_is_not_made_for_localhost_cannot_pass_for_the_vehicle_over_a_tunnel(keys: Path) -> None:
    add_machine(str(keys), "visitor", ["10.0.0.9"])
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint, security=security(keys)._replace(slave=str(keys / "visitor"))):
        fault = why_not(endpoint, str(keys / "laptop"))
        assert fault is not None
        assert "not made for '127.0.0.1'" in fault.text


def test_the_right_certificate_has_no_fault(slave: tuple[Session, str, list[str]], keys: Path) -> None:
    assert why_not(slave[1], str(keys / "laptop")) is None


def test_a_client_with_tls_and_a_slave_without_is_reported(keys: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with listen(endpoint):
        assert why_not(endpoint) is None
        fault = why_not(endpoint, str(keys / "laptop"))
        assert fault is not None
        assert "without TLS" in fault.text
    fault = why_not(endpoint)
    assert fault is not None
    assert not fault.lasting
    assert "uuv-hil slave" in fault.text


def test_folders_are_found_beside_the_scenario() -> None:
    found = Security("keys/uuv1", "/abs/laptop", ("laptop",)).resolve_paths("/home/me")
    assert (found.slave, found.master, found.router) == ("/home/me/keys/uuv1", "/abs/laptop", "")
    assert found.name("slave") == "uuv1"
