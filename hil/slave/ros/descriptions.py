"""Publish the vehicle's URDF, the map and the obstacles of its world, latched, once somebody subscribes to them.

A separate process makes each message (`hil.slave.ros.describe`) and then ends. A run without ROS therefore pays neither
start-up time nor memory for them.
"""

import os
import threading
from collections.abc import Callable

from hil.common.clock import now_ns, to_wall_ns
from hil.network.session import Session
from hil.ros.graph import SUBSCRIPTIONS, Node, read_token
from hil.ros.topics import DESCRIPTIONS, TOPICS
from hil.scenario.config import Scenario

QUIET = {"OPENBLAS_NUM_THREADS": "1"}  # a map is too small for several threads


class Descriptions:
    """The descriptions of one node; `report` gets a line if one cannot be made."""

    def __init__(self, session: Session, graph: Node, scenario: Scenario, report: Callable[[str], None]) -> None:
        self._scenario = scenario.for_process({})
        self._report = report
        self._made: set[str] = set()
        self._session = session
        node = scenario.slave.node
        self._names = {TOPICS[name].full_name(node): name for name in DESCRIPTIONS}
        self._gids = {name: graph.publishes(TOPICS[name], node) for name in DESCRIPTIONS}
        session.watch_tokens(SUBSCRIPTIONS, self._on_token)

    def _on_token(self, key: str, alive: bool) -> None:
        """Make a description when the first subscriber to it appears."""
        entity = read_token(key) if alive else None
        name = self._names.get(entity.topic) if entity else None
        if name and name not in self._made:
            self._made.add(name)
            threading.Thread(target=self._make, args=(name,), name=name, daemon=True).start()

    def _make(self, name: str) -> None:
        """Make and publish one description; the thread then ends."""
        import pickle  # most runs have no subscriber to a description

        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # inherited by the process
        try:
            payload, problem = _run(name, pickle.dumps(self._scenario))
        except OSError as error:
            payload, problem = b"", f"cannot be made: {error.strerror}"
        if problem:
            self._report(f"no {name}: {problem}")
        else:
            publisher = self._session.publisher(self._scenario.slave.node, TOPICS[name], wait=True)
            publisher.gid = self._gids[name]
            publisher.put(payload, to_wall_ns(now_ns()))


def _run(name: str, setup: bytes) -> tuple[bytes, str]:
    """Return the message and the problem; one of the two is empty. Raises OSError."""
    from hil.slave.spawn import spawn_piped

    pid, to_it, output, errors = spawn_piped("hil.slave.ros.describe", name, **QUIET)
    with open(to_it, "wb") as file:
        file.write(setup)
    with open(output, "rb") as file, open(errors, errors="replace", encoding="utf-8") as complaints:
        payload, last = file.read(), complaints.read().strip().rpartition("\n")[2]
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return payload, (last or f"exit code {code}") if code else ""
