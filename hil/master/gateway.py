"""Vehicles for programs that speak neither Python nor ROS: lines of JSON over TCP, both ways.

    -> {"id": 1, "vehicle": "uuv1", "do": "drive", "surge": 0.4, "depth": 3}
    <- {"id": 1, "ok": true}
    -> {"id": 2, "vehicle": "uuv1", "do": "get", "sensor": "state"}
    <- {"id": 2, "ok": true, "age": 0.012, "sample": {"position": [4.1, 4.0, 3.0], ...}}
    -> {"id": 3, "vehicle": "uuv1", "do": "go_to", "north": 6}
    <- {"id": 3, "ok": false, "error": "uuv1: go_to also needs east, depth"}

What can be told is what `hil.master.vehicle_handle.Vehicle` has, its arguments by name; `newtons` of thrust and `way`
of follow are arrays. Besides there are "vehicles", "get", "subscribe" with "sensor" and "rate" (lines with "sensor"
then come by themselves), "unsubscribe", and "status" of what was told last. A number that is none is null. A vehicle
that was told something stops when the connection ends, which is noticed after GONE_S where a machine vanishes.
"""

import json
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from inspect import signature
from itertools import pairwise
from math import hypot, isfinite
from operator import sub
from typing import Any

from hil.clock import now_ns
from hil.errors import ConfigError, HilError, NetworkError
from hil.master.client import Stamped
from hil.master.fleet import Fleet
from hil.master.maneuver import Maneuver
from hil.master.vehicle_handle import Vehicle
from hil.schema import nearest
from hil.topics import is_picture
from hil.transport.ros_commands import MOST_FORCE, MOST_PLACE

TOLD = ("drive", "hold_depth", "hold_heading", "go_to", "follow", "push", "thrust", "stop", "release")
LONGEST_LINE = 1 << 16  # bytes
LONGEST_ECHO = 60  # characters of what is said of a value that is refused
LONGEST_WAY = 1e4  # m: 5 s to plan, in which nobody sees that the connection has ended
LEAST_RATE, MOST_RATE = 1e-3, 100.0  # Hz, of what comes by itself
MOST_NUMBER = max(MOST_PLACE, MOST_FORCE)  # of any unit: beyond it nothing is meant
GONE_S = 4  # of a machine's silence, until its connection is given up
STATE_EXTRAS = ("depth", "heading", "roll", "pitch", "speed")
TYPES = {"smooth": bool}  # of arguments; all others are numbers, or arrays of numbers
ACCEPT_S = 0.2  # how often the end is looked for
# The kernel asks a silent machine once a second whether it is there, and waits no longer for what it does not take.
SOCKET_OPTIONS = (
    (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, GONE_S - 1),
    (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, GONE_S * 1000),
)

Request = dict[str, Any]
TOO_LONG: Request = {"id": None, "ok": False, "error": f"a line of more than {LONGEST_LINE} bytes; send several"}


class Gateway:
    """Serves a fleet at `host`:`port` (0: any free one; see `port`). Use as a context. Raises NetworkError."""

    def __init__(self, fleet: Fleet, host: str, port: int) -> None:
        self._fleet = fleet
        self._ending = threading.Event()
        self._clients: list[_Client] = []
        try:
            self._socket = socket.create_server((host, port))
        except OSError as error:
            raise NetworkError(f"cannot listen on {host}:{port}: {error.strerror}; choose another place") from None
        self._socket.settimeout(ACCEPT_S)
        self.port: int = self._socket.getsockname()[1]
        self._thread = threading.Thread(target=self._accept, name="gateway", daemon=True)
        self._thread.start()

    def __enter__(self) -> "Gateway":
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._socket.close()
        for client in self._clients:
            client.close()

    def _accept(self) -> None:
        while not self._ending.is_set():
            try:
                connection, _ = self._socket.accept()
            except OSError:  # nobody came meanwhile
                continue
            self._clients = [client for client in self._clients if client.alive]
            self._clients.append(_Client(self._fleet, connection))


class _Client:
    """One connection, in two threads: one takes requests, one sends what was subscribed to."""

    def __init__(self, fleet: Fleet, connection: socket.socket) -> None:
        connection.settimeout(None)
        for option in SOCKET_OPTIONS:
            connection.setsockopt(*option)
        self._fleet = fleet
        self._connection = connection
        self._turn = threading.Lock()  # of writing
        self._told: dict[Vehicle, Maneuver | None] = {}
        self._wanted: dict[tuple[str, str], tuple[int, int]] = {}  # vehicle and sensor: period, when next (ns)
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._serve, self._tell)]
        for thread in self._threads:
            thread.start()

    @property
    def alive(self) -> bool:
        return not self._ended.is_set()

    def close(self) -> None:
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(2.0)

    def _serve(self) -> None:
        try:
            with self._connection, self._connection.makefile("rb") as lines, suppress(OSError):
                while line := lines.readline(LONGEST_LINE):
                    self._say(self._answer(line) if _is_whole(line) else _encoded(TOO_LONG))
                    while not _is_whole(line):
                        line = lines.readline(LONGEST_LINE)
        finally:
            self._ended.set()
            for vehicle in self._told:
                _leave(vehicle)

    def _say(self, line: bytes) -> None:
        with self._turn:
            self._connection.sendall(line)

    def _answer(self, line: bytes) -> bytes:
        answer: Request = {"id": None, "ok": True}
        try:
            request = _read(line)
            answer["id"] = request.pop("id", None)
            return _encoded(answer | self._do(request))
        except HilError as error:
            problem = str(error)
        except Exception as error:  # noqa: BLE001 - no line ends a connection that a vehicle may depend on
            problem = f"{type(error).__name__}: {error}"
        return _encoded(answer | {"ok": False, "error": problem})

    def _do(self, request: Request) -> Request:
        what = str(request.pop("do", ""))
        others: dict[str, Callable[[Request], Request]] = {
            "vehicles": self._vehicles, "get": self._get, "subscribe": self._subscribe,
            "unsubscribe": self._unsubscribe, "status": self._status,
        }  # fmt: skip
        if what in others:
            return others[what](request)
        if what not in TOLD:
            names = [*TOLD, *others]
            raise ConfigError(f"do: {what!r} is none of {', '.join(names)}{nearest(what, names)}")
        vehicle = self._vehicle(request)
        self._told.setdefault(vehicle, None)
        self._told[vehicle] = _call(vehicle, what, request)
        return {}

    def _vehicles(self, _: Request) -> Request:
        return {"vehicles": sorted(self._fleet.vehicles)}

    def _get(self, request: Request) -> Request:
        return _described(self._vehicle(request).newest(_sensor(request)))

    def _subscribe(self, request: Request) -> Request:
        vehicle, sensor, rate = self._vehicle(request), _sensor(request), request.get("rate", 10.0)
        if not (_is_number(rate) and LEAST_RATE <= rate <= MOST_RATE):
            raise ConfigError(f"rate: {_shown(rate)} is not between {LEAST_RATE:g} and {MOST_RATE:g} Hz")
        vehicle.newest(sensor)
        self._wanted[vehicle.name, sensor] = round(1e9 / rate), 0
        return {}

    def _unsubscribe(self, request: Request) -> Request:
        self._wanted.pop((self._vehicle(request).name, _sensor(request)), None)
        return {}

    def _status(self, request: Request) -> Request:
        """Whether what was told last is done, and why it will not be, if so."""
        told = self._told.get(self._vehicle(request))
        if told is None:
            return {"done": False, "over": True}
        return {"done": told.done, "over": told.over, "error": str(told.error or "")}

    def _vehicle(self, request: Request) -> Vehicle:
        """The one that is named, or the only one."""
        name = request.pop("vehicle", "")
        if name:
            return self._fleet[str(name)]
        found = self._fleet.vehicles
        if len(found) > 1:
            raise ConfigError(f"vehicle: name one of {', '.join(found)}")
        return next(iter(found.values()))

    def _tell(self) -> None:
        """What was subscribed to, each at its rate; what is not new is not told again."""
        last: dict[tuple[str, str], int] = {}
        while not self._ended.wait(0.002):
            for key, (period, due) in list(self._wanted.items()):
                now = now_ns()
                if now < due:
                    continue
                with suppress(Exception):  # gone for now, or nobody listens any more: the others are told all the same
                    sample = self._fleet[key[0]].newest(key[1])
                    if last.get(key) != sample.sent_ns:
                        last[key] = sample.sent_ns
                        if key in self._wanted:
                            self._wanted[key] = period, max(due, now - period) + period
                        self._say(_encoded({"vehicle": key[0], "sensor": key[1], **_described(sample)}))


def _leave(vehicle: Vehicle) -> None:
    """Bring it to a standstill. One that is gone is told nothing any more, or it would go on when it is back."""
    try:
        vehicle.stop()
    except Exception:  # noqa: BLE001 - what keeps one from stopping must not keep the others
        vehicle.release()


def _is_whole(line: bytes) -> bool:
    """Whether what was read is a line to its end, and not the beginning of a longer one."""
    return len(line) < LONGEST_LINE or line.endswith(b"\n")


def _read(line: bytes) -> Request:
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        raise ConfigError(f"not a line of JSON: {line[:LONGEST_ECHO].decode(errors='replace')!r}") from None
    if not isinstance(request, dict):
        raise ConfigError('a request is an object, like {"do": "vehicles"}')
    if isinstance(request.get("id"), (dict, list)):
        raise ConfigError("id: expected a text or a number")
    return request


def _sensor(request: Request) -> str:
    sensor = str(request.get("sensor", "state"))
    if is_picture(sensor):
        raise ConfigError(f"sensor: {sensor!r} sends pictures, which do not come through here")
    return {"state": "odom"}.get(sensor, sensor)


def _call(vehicle: Vehicle, what: str, arguments: Request) -> Maneuver | None:
    method = getattr(vehicle, what)
    if what == "thrust":
        newtons = arguments.pop("newtons", [])
        _refuse(vehicle, what, arguments, [])
        return vehicle.thrust(*_array("newtons", newtons))
    parameters = signature(method).parameters
    _refuse(vehicle, what, arguments, [name for name in parameters if name != "limits"])
    if what == "follow":
        way = _points(arguments.pop("way", []))
        others = {name: _argument(name, value) for name, value in arguments.items()}
        if not others.get("lookahead") and _length([vehicle.state.position, *way]) > LONGEST_WAY:
            raise ConfigError(f"way: longer than {LONGEST_WAY:g} m; send its parts one after the other, or a lookahead")
        return vehicle.follow(way, **others)
    missing = [name for name, each in parameters.items() if each.default is each.empty and name not in arguments]
    if missing:
        raise ConfigError(f"{vehicle.name}: {what} also needs {', '.join(missing)}")
    told: Maneuver | None = method(**{name: _argument(name, value) for name, value in arguments.items()})
    return told


def _refuse(vehicle: Vehicle, what: str, arguments: Request, names: list[str]) -> None:
    for name in arguments:
        if name not in names:
            raise ConfigError(f"{vehicle.name}: {what} has no {name!r}{nearest(name, names)}")


def _argument(name: str, value: Any) -> Any:
    if isinstance(value, bool) and TYPES.get(name) is bool:
        return value
    if not _is_number(value):
        raise ConfigError(f"{name}: {_shown(value)} is not a number from -{MOST_NUMBER:g} to {MOST_NUMBER:g}")
    return float(value)


def _array(name: str, values: Any) -> list[float]:
    """A row of numbers; MATLAB writes a single one without brackets."""
    values = values if isinstance(values, list) else [values]
    return [_argument(f"{name}[{number}]", value) for number, value in enumerate(values)]


def _points(way: Any) -> list[Any]:
    """Points of three numbers; MATLAB writes a single one without the outer brackets."""
    if isinstance(way, list) and way and not isinstance(way[0], list):
        way = [way]
    if not isinstance(way, list) or not way:
        raise ConfigError("way: expected an array of points [north, east, depth]")
    return [tuple(_array("way", point)) for point in way]


def _length(way: list[Any]) -> float:
    return sum(hypot(*map(sub, a, b)) for a, b in pairwise(way))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= MOST_NUMBER


def _shown(value: Any) -> str:
    return f"{value!r:.{LONGEST_ECHO}}"


def _encoded(message: Request) -> bytes:
    return json.dumps(_plain(message), allow_nan=False).encode() + b"\n"


def _described(sample: Any) -> Request:
    if isinstance(sample, Stamped):  # no record: the figures of health
        return {"age": sample.age_s, "sample": sample.value}
    values = sample._asdict()
    values |= {name: getattr(sample, name) for name in STATE_EXTRAS if hasattr(sample, name)}
    return {"age": sample.age, "sample": values}


def _plain(value: Any) -> Any:
    """What JSON can say; a number that is none becomes null."""
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, bytes):
        return value.hex()
    return None if isinstance(value, float) and not isfinite(value) else value
