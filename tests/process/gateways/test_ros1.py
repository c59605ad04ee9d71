"""Nodes of ROS 1 subscribe to a real slave and command it, and their errors do no harm."""

import random
from collections.abc import Iterator
from contextlib import suppress
from struct import pack
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

import hil
from hil.gateways.commanding import Commanding
from tests.support.clients.ros1 import Peer, Publisher, Served, SmallMaster, served_to_ros1
from tests.support.processes import wait_for

STORE = get_typestore(Stores.ROS1_NOETIC)
TWIST, IMU, ODOMETRY, SET_BOOL = (
    "9f195f881246fdfa2798d1d3eebca84a", "6a62c6daae103f4ff57a132d6f95cec2", "cd5e73d190d741a2f92e81eda573aca7",
    "09fb03525b03e7ea1fd3992bafd87e16",
)  # fmt: skip


def topic(name: str, kind: str, md5sum: str, **fields: str) -> dict[str, str]:
    return {"callerid": "/test", "topic": name, "type": kind, "md5sum": md5sum, **fields}


def service(name: str, md5sum: str, **fields: str) -> dict[str, str]:
    return {"callerid": "/test", "service": name, "md5sum": md5sum, **fields}


def twist(surge: float) -> bytes:
    return pack("<6d", surge, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served_to_ros1(tmp_path_factory.mktemp("ros1"), "--command") as served:
        yield served


def subscribed(served: Served, name: str, kind: str, md5sum: str) -> Peer:
    assert wait_for(lambda: name in served.master.names("Publisher"))
    peer = Peer(served.tcpros, topic(name, kind, md5sum))
    reply = peer.header()
    assert (reply.get("error"), reply["type"], reply["md5sum"]) == (None, kind, md5sum)
    return peer


def speed(odometry: Peer) -> float:
    message: Any = STORE.deserialize_ros1(odometry.receive(), "nav_msgs/msg/Odometry")
    return float(message.twist.twist.linear.x)


def test_topics_are_registered_and_encoded_for_ros_1(served: Served) -> None:
    with subscribed(served, "/uuv1/imu", "sensor_msgs/Imu", IMU) as imu:
        messages: list[Any] = [STORE.deserialize_ros1(imu.receive(), "sensor_msgs/msg/Imu") for _ in range(3)]
    assert messages[0].linear_acceleration.z == pytest.approx(9.8, abs=1.0)
    assert [each.header.seq - messages[0].header.seq for each in messages] == [0, 1, 2]
    assert messages[0].header.frame_id == "imu_link"
    assert served.master.items["Publisher", "/uuv1/imu"] == ("sensor_msgs/Imu", served.api)
    there = {"/clock", "/tf", "/tf_static", "/uuv1/odom"}
    assert wait_for(lambda: there <= served.master.names("Publisher"))


def test_a_latched_topic_is_sent_to_each_subscriber(served: Served) -> None:
    for _ in range(2):
        with subscribed(served, "/tf_static", "tf2_msgs/TFMessage", "94810edda583a504dfda3829e70d7eec") as frames:
            assert b"\x08\x00\x00\x00imu_link" in frames.receive()


def test_errors_are_reported_in_the_connection_header(served: Served) -> None:
    assert wait_for(lambda: "/uuv1/arm" in served.master.names("Service"))
    cases = [
        (topic("/uuv1/imu", "sensor_msgs/Imu", "0" * 32), f"md5sum {IMU}; sensor_msgs/Imu came with 000"),
        (topic("/uuv1/imu", "sensor_msgs/Image", "*"), "has the type sensor_msgs/Imu, not sensor_msgs/Image"),
        (topic("/nothing", "*", "*"), "does not publish '/nothing'"),
        (service("/nothing", "*"), "has no service '/nothing'"),
        (service("/uuv1/arm", "1" * 32), f"md5sum {SET_BOOL}"),
        ({"callerid": "/test", "topic": "/uuv1/imu"}, "has no field 'md5sum'"),
        ({"md5sum": "*"}, "has no field 'topic'"),
    ]
    for header, words in cases:
        with Peer(served.tcpros, header) as peer:
            assert words in peer.header()["error"]


def test_corrupt_headers_end_their_connections_only(served: Served) -> None:
    source = random.Random(7)
    cases = [
        pack("<I", 0xFFFFFFFF), pack("<I", 4) + b"\xff\xff\xff\xff", pack("<II", 8, 3) + b"abcd", b"GET / HTTP/1.1\r\n",
        pack("<I", 9) + pack("<I", 5) + b"topic",
    ]  # fmt: skip
    for data in cases:
        with Peer(served.tcpros) as peer:
            peer.send(data)
            assert peer.header()["error"]
    for _ in range(30):
        with Peer(served.tcpros) as peer, suppress(ConnectionError):
            peer.send(source.randbytes(source.randrange(200)))
    with subscribed(served, "/uuv1/imu", "sensor_msgs/Imu", IMU) as imu:
        imu.receive()
    served.gateway.expect("a connection from .* was refused")


def test_a_subscriber_that_does_not_read_does_not_block_others(served: Served) -> None:
    idle_clients = [subscribed(served, "/uuv1/imu", "sensor_msgs/Imu", IMU) for _ in range(3)]
    with subscribed(served, "/uuv1/imu", "sensor_msgs/Imu", IMU) as imu:
        for _ in range(100):
            imu.receive()
    for each in idle_clients:
        each.socket.close()
    assert wait_for(lambda: not any(entry[4] == "/uuv1/imu" for entry in bus_info(served)))


def bus_info(served: Served) -> list[list[Any]]:
    answer: Any = served.node.getBusInfo("/test")
    return list(answer[2])


def test_a_publisher_commands_the_vehicle_until_it_is_unregistered(served: Served) -> None:
    assert wait_for(lambda: "/uuv1/cmd_vel" in served.master.names("Subscriber"))
    with (
        Publisher("/driver", "geometry_msgs/Twist", TWIST) as driver,
        subscribed(served, "/uuv1/ground_truth", "nav_msgs/Odometry", ODOMETRY) as truth,
    ):
        served.master.announce(served.node, "/uuv1/cmd_vel", [driver.uri])
        header = driver.accept()
        assert (header["type"], header["md5sum"], header["topic"]) == ("geometry_msgs/Twist", TWIST, "/uuv1/cmd_vel")

        def is_driven() -> bool:
            driver.publish(twist(0.5))
            return speed(truth) > 0.3

        assert wait_for(is_driven)
        with Publisher("/second", "geometry_msgs/Twist", TWIST) as second:
            served.master.announce(served.node, "/uuv1/cmd_vel", [driver.uri, second.uri])
            second.accept()

            def is_refused() -> bool:
                driver.publish(twist(0.5))
                second.publish(twist(-0.5))
                return "/driver commands; what /second sends is dropped" in served.gateway.output

            assert wait_for(is_refused)
            assert speed(truth) > 0.1
        driver.publish(b"short")  # is counted
        driver.leave()
        served.master.announce(served.node, "/uuv1/cmd_vel", [])
        assert wait_for(lambda: abs(speed(truth)) < 0.1)  # its deadman: nothing is repeated here


def test_a_publisher_of_another_type_is_refused(served: Served) -> None:
    assert wait_for(lambda: "/uuv1/cmd_vel" in served.master.names("Subscriber"))
    with Publisher("/wrong", "std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1") as wrong:
        served.master.announce(served.node, "/uuv1/cmd_vel", [wrong.uri])
        wrong.accept()
        served.gateway.expect("/uuv1/cmd_vel from .* has the type geometry_msgs/Twist .* std_msgs/String came with")
        served.master.announce(served.node, "/uuv1/cmd_vel", [])


def test_what_only_the_ros_master_may_send_is_asked_of_it(served: Served) -> None:
    """Everyone who reaches the port can send it."""
    key = "/uuv1/gains/surge/i"
    assert wait_for(lambda: key in served.master.parameters and "/uuv1/cmd_vel" in served.master.names("Subscriber"))
    value = served.master.parameters[key]
    with Publisher("/attacker", "geometry_msgs/Twist", TWIST) as attacker:
        served.node.publisherUpdate("/master", "/uuv1/cmd_vel", [attacker.uri])
        served.node.paramUpdate("/master", key, 99.0)
        refused: Any = served.node.shutdown("/master", "Reason: new node registered with same name")
        assert refused[:2] == [0, "only the master ends this node, and it lists it; end its process in its place"]
        with Publisher("/driver", "geometry_msgs/Twist", TWIST) as driver:
            served.master.announce(served.node, "/uuv1/cmd_vel", [driver.uri])
            driver.accept()
        answer: Any = served.node.getBusInfo("/test")
        assert attacker.uri not in str(answer)
    served.master.announce(served.node, "/uuv1/cmd_vel", [])
    assert served.gateway.process.poll() is None
    with hil.connect(f"tcp/127.0.0.1:{served.slave_port}") as fleet:
        fleet.wait_for("uuv1")
        assert Commanding(fleet).parameters(["/uuv1/gains.surge.i"]) == {"/uuv1/gains.surge.i": value}


def test_services_answer_on_a_persistent_connection(served: Served) -> None:
    assert wait_for(lambda: "/uuv1/arm" in served.master.names("Service"))
    with Peer(served.tcpros, service("/uuv1/arm", SET_BOOL, persistent="1")) as peer:
        assert peer.header()["type"] == "std_srvs/SetBool"
        for wanted, message in ((b"\x00", b"disarmed"), (b"\x01", b"armed: commands are executed")):
            peer.send(pack("<I", 1) + wanted)
            assert peer.read(1) == b"\x01"
            answer = peer.receive()
            assert (answer[0], message in answer) == (1, True)
        peer.send(pack("<I", 3) + b"abc")
        assert peer.read(1) == b"\x00"
        assert b"none of std_srvs/SetBool" in peer.receive()
        peer.send(pack("<I", 1 << 30))
        assert "at most 8192" in peer.header()["error"]
    with Peer(served.tcpros, service("/uuv1/arm", "*", probe="1")) as peer:
        assert peer.header()["md5sum"] == SET_BOOL
        with pytest.raises(ConnectionError):
            peer.read(1)


def test_parameters_are_set_at_the_ros_master_and_updated_from_it(served: Served) -> None:
    key = "/uuv1/gains/surge/p"
    assert wait_for(lambda: key in served.master.parameters)
    before = served.master.parameters[key]
    assert wait_for(lambda: served.master.watched.get("/uuv1/gains/surge"))
    served.master.parameters[key] = before + 1.0
    served.node.paramUpdate("/master", f"{key}/", before + 1.0)
    served.master.parameters["/uuv1/gains/surge"] = {"d": "much", "nothing": 3}
    served.node.paramUpdate("/master", "/uuv1/gains/surge", {"d": "much", "nothing": 3})
    served.gateway.expect("gains.surge.d")
    assert wait_for(lambda: served.master.parameters["/uuv1/gains/surge/d"] == 0.0)
    assert wait_for(lambda: "<robot" in str(served.master.parameters.get("/uuv1/robot_description")))


def test_unknown_requests_of_xmlrpc_get_an_error(served: Served) -> None:
    responses: list[Any] = [
        served.node.fly("/test"), served.node.getPid(), served.node.requestTopic("/test", "/nothing", [["TCPROS"]]),
        served.node.requestTopic("/test", "/uuv1/imu", [["UDPROS", 1, 2]]),
    ]  # fmt: skip
    assert [answer[0] for answer in responses] == [-1, -1, 0, 0]
    with Peer(int(served.api.rstrip("/").rpartition(":")[2])) as peer:
        peer.send(b"POST / HTTP/1.0\r\nHost: 127.0.0.1\r\nContent-Type: text/xml\r\nContent-Length: 5\r\n\r\n<a><b")
        assert b"no request of XML-RPC" in b"".join(iter(lambda: peer.socket.recv(4096), b""))


def test_a_restarted_ros_master_receives_all_registrations(tmp_path: Any) -> None:
    with served_to_ros1(tmp_path) as served:
        assert wait_for(lambda: "/uuv1/odom" in served.master.names("Publisher"))
        assert not served.master.names("Subscriber") | served.master.names("Service"), "without --command"
        assert not served.master.watched
        port = served.master.port
        served.master.close()
        served.gateway.expect("no ROS master: .*waiting for one")
        with SmallMaster(port, pid=2) as second:
            assert wait_for(lambda: "/uuv1/odom" in second.names("Publisher"))
            assert wait_for(lambda: "/uuv1/gains/surge/p" in second.parameters)
            second.nodes["/uuv_hil"] = "http://127.0.0.1:1/"  # another node has taken the name
            served.node.shutdown("/test", "[/test] Reason: new node registered with same name")
            assert served.gateway.wait() == 0
            assert "ended: [/test] Reason: new node" in served.gateway.output
            assert not second.names("Publisher"), "it has withdrawn them"


def test_connections_are_limited(served: Served) -> None:
    port = served.tcpros
    open_peers = [Peer(port) for _ in range(256)]
    try:

        def is_refused() -> bool:
            with Peer(port) as peer, suppress(ConnectionError):
                peer.socket.settimeout(2.0)
                with suppress(TimeoutError):
                    return "connections are open already" in peer.header()["error"]
            return False

        assert wait_for(is_refused)
    finally:
        for each in open_peers:
            each.socket.close()
    with subscribed(served, "/uuv1/imu", "sensor_msgs/Imu", IMU) as imu:
        assert len(imu.receive()) > 300
