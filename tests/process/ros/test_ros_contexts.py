"""ROS 2 contexts with default settings of rmw_zenoh and the vehicle discover each other in each kind of connection."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest
import zenoh

from hil.network.opening import listen
from hil.network.presence import declare_presence, watch_presence
from hil.network.roles import open_master_session, open_router_session
from hil.network.settings import Network
from hil.network.tokens import Presence
from hil.ros import encoders as ros
from hil.ros.graph import Node
from hil.ros.topics import TOPICS, hash_of
from tests.support.network.rmw import RELEASES, Context, Release, open_router, router_settings
from tests.support.processes import free_port, wait_for

DEADLINE_S = 30.0  # generous: ROS tries again after up to 4 s
TWIST = TOPICS["cmd_vel"]
CONNECTIONS = ("to the slave", "through rmw_zenohd", "through uuv-hil router")


class Vehicle:
    """The network interface of a slave without its simulation."""

    def __init__(self, endpoint: str, router: str = "") -> None:
        self.session = listen(endpoint, Network(mode="routed", router=router) if router else Network())
        self.commands: list[bytes] = []
        self.session.subscribe("uuv1", "cmd_vel", lambda _, payload, __: self.commands.append(payload), 8)
        node = Node(self.session, "uuv1")
        node.subscribes(TWIST, "uuv1")
        node.publishes(TOPICS["imu"], "uuv1")
        self._imu = self.session.publisher("uuv1", TOPICS["imu"])
        declare_presence(self.session, "uuv1", "slave")

    def say(self) -> None:
        self._imu.put(b"imu", 0)


class Site:
    """A vehicle, and the endpoint to which ROS connects."""

    def __init__(self, connection: str, release: Release, stack: ExitStack) -> None:
        own_endpoint, self.endpoint = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
        self.network = Network(mode="routed", router=self.endpoint)
        if connection == "through rmw_zenohd":
            stack.enter_context(open_router(self.endpoint, release))
        elif connection == "through uuv-hil router":
            stack.enter_context(open_router_session(self.endpoint))
        else:
            self.endpoint, self.network = own_endpoint, Network()
        self.vehicle = Vehicle(own_endpoint, self.network.router)
        stack.enter_context(self.vehicle.session)


@pytest.fixture(params=[(way, release) for way in CONNECTIONS for release in RELEASES], ids=" ".join)
def site(request: pytest.FixtureRequest) -> Iterator[Site]:
    with ExitStack() as stack:
        connection, release = request.param
        yield Site(connection, release, stack)


def all_reported(vehicle: Vehicle, *contexts: Context) -> bool:
    """Let every context publish, and return whether each has received all of it."""
    vehicle.say()
    for context in contexts:
        context.say(f"/chat_{context.name}")
        payload = ros.encode_twist((len(context.name), 0.0, 0.0), (0.0, 0.0, 0.0))
        context.say("/uuv1/cmd_vel", TWIST.type, hash_of(TWIST.type), payload)
    topics = {"/uuv1/imu", *[f"/chat_{context.name}" for context in contexts]}
    nodes = {"/uuv1", *[f"/{context.name}" for context in contexts]}
    commanded = {len(context.name) for context in contexts} <= {round(command(each)) for each in vehicle.commands}
    return commanded and all(topics <= context.received and nodes <= context.node_names for context in contexts)


def command(payload: bytes) -> float:
    decoded = ros.decode_twist(payload)
    assert decoded
    return decoded[0][0]


def test_two_contexts_and_the_vehicle_exchange_messages_and_tokens(site: Site) -> None:
    with Context("a", site.endpoint) as first, Context("bb", site.endpoint) as second:
        assert wait_for(lambda: all_reported(site.vehicle, first, second), DEADLINE_S), (
            first.received, first.node_names, second.received, second.node_names, len(site.vehicle.commands),
        )  # fmt: skip


def test_a_master_connects_together_with_a_ros_context(site: Site) -> None:
    received: set[str] = set()
    presences: set[Presence] = set()
    with open_master_session(site.endpoint, network=site.network) as master, Context("a", site.endpoint) as context:
        master.subscribe("uuv1", "*", lambda name, _, __: received.add(name), 8)
        watch_presence(master, "uuv1", lambda presence, _: presences.add(presence))
        publisher = master.publisher("uuv1", TWIST)
        payload = ros.encode_twist((9.0, 0.0, 0.0), (0.0, 0.0, 0.0))

        def all_present() -> bool:
            publisher.put(payload, 0)
            others = all_reported(site.vehicle, context)
            return others and payload in site.vehicle.commands and received >= {"imu"} and bool(presences)

        assert wait_for(all_present, DEADLINE_S), (received, presences, context.received, context.node_names)


def test_rmw_zenohd_may_connect_to_the_vehicle() -> None:
    """Two machines are connected as usual in ROS: each has a router, whose contexts have no endpoint of the vehicle."""
    own_endpoint, hub = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    vehicle = Vehicle(own_endpoint)
    config = zenoh.Config.from_json5(router_settings(hub))
    config.insert_json5("connect/endpoints", f'["{own_endpoint}"]')
    with vehicle.session, zenoh.open(config), Context("a", hub) as context, Context("bb", hub) as other:
        assert wait_for(lambda: all_reported(vehicle, context, other), DEADLINE_S), (context.received, other.received)
