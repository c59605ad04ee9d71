"""ROS 2 on the network: sessions with the relevant settings of rmw_zenoh, of the present and the first release.

From rmw_zenoh_cpp/config/DEFAULT_RMW_ZENOH_{SESSION,ROUTER}_CONFIG.json5 of ros2/rmw_zenoh: rolling (30f3030, as in
Jazzy and Kilted) and the first release (bfc065f, 2024), whose peers sent gossip to all peers.
"""

from typing import Any, Literal

import zenoh

from hil.network.settings import json5
from hil.ros import encoders as ros
from hil.ros import graph

Release = Literal["now", "2024"]
RELEASES: tuple[Release, ...] = ("now", "2024")
CHATTER = "std_msgs/msg/String"
HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"


def _common(release: Release) -> dict[str, Any]:
    patience = 60_000 if release == "now" else 10_000  # ms
    return {
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True, "multihop": False}},
        "timestamping": {"enabled": {"router": True, "peer": True, "client": release == "now"}},
        "transport": {
            "unicast": {"open_timeout": patience, "accept_timeout": patience, "max_links": 1},
            "link": {"tx": {"lease": patience, "keep_alive": 2 if release == "now" else 4}},
            "shared_memory": {"enabled": False},
        },
    }


def session_settings(endpoint: str, release: Release = "now") -> str:
    """Return the settings of a context: all nodes of a process. By default `endpoint` is tcp/localhost:7447."""
    table = _common(release)
    gossip = table["scouting"]["gossip"]
    gossip["autoconnect"] = {"router": [], "peer": ["router", "peer"]}
    if release == "now":
        gossip["target"] = {"router": ["router", "peer"], "peer": ["router"]}
        gossip["autoconnect_strategy"] = {"peer": {"to_router": "always", "to_peer": "greater-zid"}}
    return json5({
        **table,
        "mode": "peer",
        "connect": {
            "endpoints": [endpoint],
            "retry": {"period_init_ms": 1000, "period_max_ms": 4000, "period_increase_factor": 2},
        },
        "listen": {"endpoints": ["tcp/localhost:0"]},
    })  # fmt: skip


def router_settings(endpoint: str, release: Release = "now") -> str:
    """Return the settings of `ros2 run rmw_zenoh_cpp rmw_zenohd`. By default `endpoint` is tcp/[::]:7447."""
    table = _common(release)
    gossip = table["scouting"]["gossip"]
    gossip["autoconnect"] = {"router": [], "peer": ["router", "peer"]}
    if release == "now":
        gossip["target"] = {"router": ["router", "peer"], "peer": ["router"]}
        gossip["autoconnect_strategy"] = {"router": {"to_router": "always", "to_peer": "always"}}
        table["routing"] = {"router": {"peers_failover_brokering": False}}  # zenoh's own default is on
    return json5({**table, "mode": "router", "listen": {"endpoints": [endpoint]}})


class Context:
    """A ROS 2 context with one node, which publishes "NAME N" on /chat_NAME and subscribes to all topics.

    Use as a context manager.
    """

    def __init__(self, name: str, endpoint: str, release: Release = "now") -> None:
        self.name = name
        self.received: set[str] = set()  # names of topics
        self.node_names: set[str] = set()  # names of nodes
        self._session = zenoh.open(zenoh.Config.from_json5(session_settings(endpoint, release)))
        zid = str(self._session.info.zid())
        node = graph.Entity("NN", f"/{name}", zid, 0, 0)
        self._references: list[Any] = [
            self._session.liveliness().declare_token(graph.token(node)),
            self._session.declare_subscriber("0/**", zenoh.handlers.Callback(self._receive, indirect=False)),
            self._session.liveliness().declare_subscriber(
                graph.ALL, zenoh.handlers.Callback(self._on_token, indirect=False), history=True
            ),
        ]

    def __enter__(self) -> "Context":
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def say(self, topic: str, type_name: str = CHATTER, type_hash: str = HASH, payload: bytes = b"") -> None:
        """Publish one message."""
        self._session.put(
            ros.data_key(0, topic, type_name, type_hash),
            payload,
            attachment=ros.pack_attachment(1, 0, bytes(16)),
        )

    def _receive(self, sample: zenoh.Sample) -> None:
        self.received.add("/" + "/".join(str(sample.key_expr).split("/")[1:-2]))

    def _on_token(self, sample: zenoh.Sample) -> None:
        entity = graph.read_token(str(sample.key_expr))
        if entity and entity.kind == "NN":
            (self.node_names.add if sample.kind == zenoh.SampleKind.PUT else self.node_names.discard)(entity.node)


def open_router(endpoint: str, release: Release = "now") -> zenoh.Session:
    """Open the session of rmw_zenohd."""
    return zenoh.open(zenoh.Config.from_json5(router_settings(endpoint, release)))
