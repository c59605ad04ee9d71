"""Queues of messages that wait for the network library's sending thread, as the library reads our settings."""

import json

import pytest
import zenoh

from hil.network.publisher import _PRIORITIES
from hil.network.role import Role
from hil.network.settings import Network, settings
from hil.ros.topics import TOPICS

URGENT = {"control": 2, "real_time": 16}
OTHERS = dict.fromkeys(("interactive_high", "interactive_low", "data_high", "data", "data_low", "background"), 2)


def queues(role: Role) -> dict[str, int]:
    """Return how many batches wait, by priority."""
    config = zenoh.Config.from_json5(settings(role, ("tcp/127.0.0.1:7447",), (), Network(), None))
    sizes: dict[str, int] = json.loads(config.get_json("transport/link/tx/queue/size"))
    return sizes


@pytest.mark.parametrize("role", ["slave", "imaging"])
def test_sixteen_urgent_messages_may_wait_and_no_more(role: Role) -> None:
    """The queue is bounded for each priority: nothing else waits longer than it did."""
    assert queues(role) == URGENT | OTHERS


def test_commands_and_traces_share_the_urgent_queue_alone() -> None:
    """One queue keeps their order: what is in another one overtakes them, or is overtaken."""
    urgent = {name for name, topic in TOPICS.items() if _PRIORITIES[topic.priority] is zenoh.Priority.REAL_TIME}
    assert urgent == {name for name in TOPICS if name.startswith("cmd_")} | {"trace"}
