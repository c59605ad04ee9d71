"""Queues of messages that wait for the network library's sending thread, as the library applies our settings."""

import json

import pytest
import zenoh

from hil.network.publisher import _PRIORITIES
from hil.network.settings import Network, settings
from hil.network.tokens import Role
from hil.ros.topics import TOPICS

URGENT = {"control": 2, "real_time": 16}
OTHERS = dict.fromkeys(("interactive_high", "interactive_low", "data_high", "data", "data_low", "background"), 2)


def queue_sizes(role: Role) -> dict[str, int]:
    """Return how many batches wait, by priority."""
    config = zenoh.Config.from_json5(settings(role, ("tcp/127.0.0.1:7447",), (), Network(), None))
    sizes: dict[str, int] = json.loads(config.get_json("transport/link/tx/queue/size"))
    return sizes


@pytest.mark.parametrize("role", ["slave", "imaging"])
def test_the_urgent_queue_holds_16_messages(role: Role) -> None:
    """The queue is bounded for each priority; the other queues keep their size."""
    assert queue_sizes(role) == URGENT | OTHERS


def test_only_commands_and_traces_use_the_urgent_queue() -> None:
    """One queue keeps their order: messages in different queues overtake each other."""
    urgent = {name for name, topic in TOPICS.items() if _PRIORITIES[topic.priority] is zenoh.Priority.REAL_TIME}
    assert urgent == {name for name in TOPICS if name.startswith("cmd_")} | {"trace"}
