"""Nodes and endpoints of the ROS graph, as tokens that sessions declare."""

import time
from contextlib import nullcontext

import pytest

from hil.client.client import VehicleClient
from hil.common.errors import NetworkError
from hil.network.opening import listen
from hil.network.roles import open_client_session, open_master_session, open_router_session
from hil.network.session import Session
from hil.network.settings import Network
from hil.ros import graph
from hil.ros.graph import Node, read_token
from hil.ros.topics import TOPICS
from tests.support.processes import free_port, wait_for


def test_a_node_and_its_endpoints_are_declared_until_the_session_closes() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_master_session(endpoint) as master:
        with listen(endpoint) as slave:
            node = Node(slave, "uuv1")
            node.publishes(TOPICS["imu"], "uuv1")
            node.subscribes(TOPICS["cmd_vel"], "uuv1")
            node.serves("/uuv1/arm", "std_srvs/srv/SetBool")
            wait_for(lambda: len(master.tokens(graph.ALL)) == 4)
            entities = [read_token(key) for key in master.tokens(graph.ALL)]
            assert slave.zid != master.zid
            assert {(e.kind, e.node, e.topic, e.type) for e in entities if e} == {
                ("NN", "/uuv1", "", ""),
                ("MP", "/uuv1", "/uuv1/imu", "sensor_msgs/msg/Imu"),
                ("MS", "/uuv1", "/uuv1/cmd_vel", "geometry_msgs/msg/Twist"),
                ("SS", "/uuv1", "/uuv1/arm", "std_srvs/srv/SetBool"),
            }
            assert {e.session for e in entities if e} == {slave.zid}
            assert len({e.ident for e in entities if e}) == 4
        assert wait_for(lambda: not master.tokens(graph.ALL))


def topics_of(session: Session) -> set[tuple[str, str, str]]:
    return {(e.kind, e.node, e.topic) for key in session.tokens(graph.ALL) if (e := read_token(key))}


@pytest.mark.parametrize("routed", [False, True])
def test_masters_and_observers_are_nodes_until_they_close(routed: bool) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    network = Network(mode="routed", router=endpoint) if routed else Network()
    own_endpoint = f"tcp/127.0.0.1:{free_port()}" if routed else endpoint
    with (
        open_router_session(endpoint) if routed else nullcontext(),
        listen(own_endpoint, network) as slave,
        open_master_session(endpoint, network=network) as session,
        open_client_session(endpoint, network, seconds=3.0) as guest,
    ):
        Node(slave, "uuv1").subscribes(TOPICS["cmd_vel"], "uuv1")
        vehicle = {("NN", "/uuv1", ""), ("MS", "/uuv1", "/uuv1/cmd_vel")}
        clients = [
            VehicleClient(session, "uuv1"),
            VehicleClient(session, "uuv2", role="observer"),
            VehicleClient(session, "uuv3"),
        ]
        third = {("NN", "/uuv3_master", ""), ("MP", "/uuv3_master", "/uuv3/cmd_vel")}
        other_topics = {
            ("NN", "/uuv1_master", ""),
            ("MP", "/uuv1_master", "/uuv1/cmd_vel"),
            ("NN", "/uuv2_observer", ""),
        }
        assert wait_for(lambda: topics_of(guest) == vehicle | other_topics | third), topics_of(guest)
        found = [e for key in guest.tokens(graph.ALL) if (e := read_token(key)) and e.session == session.zid]
        assert len({e.ident for e in found}) == len(found) == 5, "one session, so all have numbers of their own"
        for client in clients[:2]:
            client.close()
        assert wait_for(lambda: topics_of(guest) == vehicle | third), topics_of(guest)
        clients[2].close()


def test_a_client_reports_that_nobody_answers() -> None:
    endpoint, attempts = f"tcp/127.0.0.1:{free_port()}", list[float]()
    with pytest.raises(NetworkError, match=f"nobody answered at {endpoint} within 0.2 s; is `uuv-hil slave` running"):
        open_client_session(endpoint, seconds=0.2, pause=lambda: attempts.append(time.monotonic()))
    assert not attempts
    with pytest.raises(NetworkError, match="nobody answered"):
        open_client_session(endpoint, seconds=0.8, pause=lambda: attempts.append(time.monotonic()))
    assert attempts
    with pytest.raises(NetworkError, match="tcp/HOST:PORT"):
        open_client_session("7447", seconds=60.0)
