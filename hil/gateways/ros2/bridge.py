"""Vehicles on a ROS 2 network of another middleware: the graph of their network is mirrored there, node by node.

A topic goes one way only, so that several bridges cannot echo each other: one that a vehicle subscribes to below its
own name goes to the vehicle, any other one to ROS. A node that is on the ROS network already, as that of another
bridge to the same vehicle, is left out.
"""

import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from hil.common.clock import NS_PER_S, now_ns, to_wall_ns
from hil.common.errors import HilError
from hil.common.stop import is_stopped
from hil.common.text import clean
from hil.gateways.ros2.interfaces import find_class
from hil.gateways.ros2.mirrors import Mirror, Source, is_shared, mirror
from hil.network.reception import ReaderThread
from hil.network.roles import open_when_present
from hil.network.session import Session
from hil.ros import graph
from hil.ros.graph import Entity, Kind

NAME = "uuv_hil_ros2_"  # how the name of a bridge's node begins, in both networks
CHECK_S = 0.2  # between two checks of who subscribes
SETTLE_NS = NS_PER_S  # in which the nodes of a ROS network find each other
CALLS = 16  # threads, for calls of services that wait at the same time
MOST = 4096  # entities of a source, because anybody can invent names
ELSEWHERE = "this ROS network has that node already, of another bridge or of its own"


class Ros2Bridge:
    """A bridge between the sessions that `openers` open and the ROS network of `rclpy`. Use as a context.

    With `may_command` nodes of ROS can publish commands, call all services and set parameters. `report` gets lines for
    a person. `nodes` are those mirrored now, by their full names.
    """

    def __init__(
        self, rclpy: Any, openers: list[Callable[[], Session]], may_command: bool, report: Callable[[str], None]
    ) -> None:
        self._rclpy, self._may_command, self._print = rclpy, may_command, report
        self._name = f"{NAME}{to_wall_ns(now_ns()):x}"  # of two bridges, the older one comes first
        self._sources: list[Source] = []
        self.nodes: dict[str, Any] = {}
        self._mirrors: dict[tuple[int, Kind, str], Mirror] = {}  # by numbers of sources, kinds and topics
        self._told: set[tuple[str, str]] = set()  # problems and names
        self._reader = ReaderThread()
        self._ticks = self._reader.open_queue(self._check, 1)
        self._closing = threading.Event()
        self._began_ns = now_ns()
        self._context = rclpy.context.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        self._executor = rclpy.executors.MultiThreadedExecutor(CALLS, context=self._context)
        self._end = rclpy.task.Future()
        self._own = self._create_node(f"/{self._name}")
        work: list[Callable[[], None]] = [self._reader.run, self._spin]
        work += [partial(self._connect, opener) for opener in openers]
        self._threads = [threading.Thread(target=run, daemon=True) for run in work]

    def __enter__(self) -> "Ros2Bridge":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._reader.end()
        self._end.set_result(None)
        for thread in self._threads:  # one that is inside the library when the interpreter ends aborts the process
            thread.join()
        self._executor.shutdown()
        self._context.try_shutdown()
        for source in self._sources:
            source.session.close()

    def run(self, stop_fd: int, on_change: Callable[[list[str]], None]) -> None:
        """Serve until `stop_fd` becomes readable; `on_change` gets the names of nodes, at first and after changes."""
        names: list[str] | None = None
        while not is_stopped(stop_fd, CHECK_S):
            self._ticks.put(None)
            if (now := sorted(self.nodes.copy())) != names:
                names = now
                on_change(names)

    def _connect(self, opener: Callable[[], Session]) -> None:
        """Wait until an endpoint answers; after that the session reconnects by itself."""
        if session := open_when_present(opener, self._closing):
            source = Source(session, self._name)
            session.watch_tokens(graph.ALL, partial(self._on_token, source))
            session.supervisor.watch_presence(lambda: bool(source.entities))
            self._sources.append(source)

    def _spin(self) -> None:
        while not self._end.done():
            try:
                self._executor.spin_until_future_complete(self._end)
            except Exception as error:  # noqa: BLE001 - HilError of a call or command, rclpy's if a node has just left
                self._report(str(error), [""])

    def _on_token(self, source: Source, key: str, alive: bool) -> None:
        entity = graph.read_token(key)
        if not alive:
            source.entities.pop(key, None)
        elif entity and not entity.node.startswith(f"/{NAME}") and len(source.entities) < MOST:
            source.entities[key] = entity._replace(session="", node_id=0, ident=0)

    def _check(self, _: None) -> None:
        """Mirror what is there now, and nothing else; receive what somebody subscribes to."""
        if now_ns() - self._began_ns < SETTLE_NS:
            return
        wanted = self._wanted()
        for key in [key for key, each in self._mirrors.items() if wanted.get(key) != each.entity]:
            self._mirrors.pop(key).close()
        for name in self.nodes.keys() - {entity.node for entity in wanted.values()}:
            self._executor.remove_node(self.nodes[name])
            self.nodes.pop(name).destroy_node()
        problems: dict[str, list[str]] = {}
        for key in wanted.keys() - self._mirrors.keys():
            try:
                self._mirrors[key] = self._mirror(self._sources[key[0]], wanted[key])
            except Exception as error:  # noqa: BLE001 - also rclpy's, for a name that ROS forbids
                problems.setdefault(str(error), []).append(key[2])
        for problem, names in problems.items():
            self._report(problem, names)
        for each in self._mirrors.values():
            with suppress(HilError):  # no connection at this moment
                each.check()

    def _wanted(self) -> dict[tuple[int, Kind, str], Entity]:
        """Return what is to be mirrored, without the nodes that ROS has already."""
        wanted: dict[tuple[int, Kind, str], Entity] = {}
        elsewhere = self._elsewhere()
        for number, source in enumerate(self._sources):
            entities = sorted(set(source.entities.copy().values()))
            taken = {each.topic for each in entities if _is_taken(each)}
            for entity in [each for each in entities if self._is_for_ros(each, taken)]:
                if entity.node in elsewhere:
                    self._report(ELSEWHERE, [entity.node])
                else:
                    node = "" if is_shared(entity) else entity.node  # "" is the bridge's own
                    wanted.setdefault((number, entity.kind, entity.topic), entity._replace(node=node))
        return wanted

    def _is_for_ros(self, entity: Entity, taken: set[str]) -> bool:
        """Return whether nodes of ROS may subscribe to it, publish or call it; vehicles subscribe to topics `taken`.

        Without the right to command, they call services whose types say that they change nothing.
        """
        if entity.kind == "SS":
            return self._may_command or entity.type.rpartition("/")[2].startswith(("Get", "List", "Describe"))
        if entity.kind == "MS":
            return self._may_command and _is_taken(entity)
        return entity.kind == "MP" and entity.topic not in taken

    def _elsewhere(self) -> set[str]:
        """Return the full names of others' nodes. Of two bridges with the same node, the newer one leaves it out."""
        names = [f"{space.rstrip('/')}/{name}" for name, space in self._own.get_node_names_and_namespaces()]
        others = {name for name in names if name not in self.nodes}
        if any(name.startswith(f"/{NAME}") and name < f"/{self._name}" for name in names):
            others |= {name for name in names if names.count(name) > 1}
        return others

    def _mirror(self, source: Source, entity: Entity) -> Mirror:
        kind, problem = find_class(entity.type, entity.type_hash)
        if problem:
            raise ValueError(problem)
        if entity.node and entity.node not in self.nodes:
            self.nodes[entity.node] = self._create_node(entity.node)
        return mirror(self._rclpy, self.nodes.get(entity.node, self._own), source, entity, kind, self._reader)

    def _create_node(self, name: str) -> Any:
        """Return a node with nothing of its own: its parameters and its log are the vehicle's."""
        namespace, _, last = name.rpartition("/")
        node = self._rclpy.create_node(
            last,
            namespace=namespace or "/",
            context=self._context,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[self._rclpy.parameter.Parameter("start_type_description_service", value=False)],
        )
        self._executor.add_node(node)
        return node

    def _report(self, problem: str, names: list[str]) -> None:
        """Report a problem, once for each name."""
        new = sorted({name for name in names if (problem, name) not in self._told})
        if new and len(self._told) < MOST:
            self._told |= {(problem, name) for name in new}
            self._print(clean(f"{', '.join(new)}: {problem}".removeprefix(": "), 400))


def _is_taken(entity: Entity) -> bool:
    """Return whether a vehicle subscribes to it, below its own name."""
    return entity.kind == "MS" and entity.topic.startswith(f"{entity.node}/")
