"""One connection of the JSON gateway: requests in, answers and samples out.

    -> {"id": 1, "do": "login", "token": "..."}
    <- {"id": 1, "ok": true}
    -> {"id": 2, "vehicle": "uuv1", "do": "drive", "surge": 0.4, "depth": 3}
    <- {"id": 2, "ok": true}
    -> {"id": 3, "vehicle": "uuv1", "do": "get", "sensor": "state"}
    <- {"id": 3, "ok": true, "age": 0.012, "sample": {"position": [4.1, 4.0, 3.0], ...}}
    -> {"id": 4, "vehicle": "uuv1", "do": "go_to", "north": 6}
    <- {"id": 4, "ok": false, "error": "uuv1: go_to also needs east, depth"}

Commands are the methods of `hil.client.vehicle_handle.Vehicle`, their arguments by name; `newtons` of thrust and
`path` of follow are arrays. "arm", "reset", "set_pose" and "fail" are the functions of `hil.client.services`. All of
these need a login first, with the token of `hil.gateways.access`. Everybody may send
"vehicles", "get", "subscribe" with "sensor" and "rate" (lines with "sensor" then come by themselves), "unsubscribe",
and "status" of the last command. A number that is not finite is null.

A commanded vehicle stops when the connection ends (noticed after GONE_S where a machine vanishes), when the client
sends no line for its deadman time (`deadman` of the login, s), and when it does not read for UNREAD_S. The connection
ends at the first line that is not JSON: a web page that posts here gets no further than the first line of its header.
"""

import socket
import struct
import threading
from collections.abc import Callable
from contextlib import suppress

from hil.client.action import Action
from hil.client.fleet import Fleet
from hil.client.vehicle_handle import Vehicle
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import ConfigError, HilError
from hil.common.schema import nearest
from hil.gateways.access import Access
from hil.gateways.json_lines import requests
from hil.gateways.json_lines.requests import Request

LONGEST_LINE = 1 << 16  # bytes
MIN_RATE, MAX_RATE = 1e-3, 100.0  # Hz, of what comes by itself
RETRY_NS = NS_PER_S // 500, NS_PER_S // 10  # least and most, between two checks for a new sample that is due
LOST_S = 4  # of a machine's silence, until its connection is given up
UNREAD_S = 2  # for which a client may leave what is sent to it unread
DEADMAN_S, MAX_DEADMAN_S = 10.0, 3600.0
TOO_LONG: Request = {"id": None, "ok": False, "error": f"a line of more than {LONGEST_LINE} bytes; send several"}


def tcp_options(**values: int) -> list[tuple[int, int, int]]:
    """Return level, option and value of the TCP options with these names, without those that this system lacks."""
    return [
        (socket.IPPROTO_TCP, getattr(socket, name), value) for name, value in values.items() if hasattr(socket, name)
    ]


# The kernel asks a silent machine once a second whether it is there, and on Linux waits no longer for what it does not
# take. TCP_KEEPALIVE is the TCP_KEEPIDLE of macOS.
SOCKET_OPTIONS = (
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    *tcp_options(TCP_NODELAY=1, TCP_KEEPIDLE=1, TCP_KEEPALIVE=1, TCP_KEEPINTVL=1, TCP_KEEPCNT=LOST_S - 1),
    *tcp_options(TCP_USER_TIMEOUT=LOST_S * 1000),
)


class Connection:
    """One client, in two threads: one answers requests, one sends samples and watches the deadman."""

    def __init__(self, fleet: Fleet, access: Access, opened: socket.socket) -> None:
        opened.settimeout(None)
        for option in SOCKET_OPTIONS:
            opened.setsockopt(*option)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", UNREAD_S, 0))
        self._fleet = fleet
        self._access = access
        self._socket = opened
        self._writing = threading.Lock()
        self._may_command = False
        self._commanded: dict[Vehicle, Action | None] = {}
        self._stopped = ""  # why the deadman has stopped them, since the last command
        self._wanted: dict[tuple[str, str], tuple[int, int]] = {}  # vehicle and sensor: period, when next (ns)
        self._deadman_ns = round(DEADMAN_S * NS_PER_S)
        self._received_ns = now_ns()
        self._has_sent = False
        self._changed = threading.Condition()
        self._ended = False
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._send_samples, self._serve)]

    def start(self) -> None:
        """Begin to answer."""
        for thread in self._threads:
            thread.start()

    @property
    def is_alive(self) -> bool:
        """True until the connection has ended."""
        return not self._ended

    def silent_since(self, time_ns: int) -> bool:
        """Return whether the client was there at that time and has sent no line until now."""
        return not self._has_sent and self._received_ns <= time_ns

    def close(self) -> None:
        """End it; commanded vehicles stop."""
        self._hang_up()
        for thread in self._threads:
            thread.join(2.0)

    def _hang_up(self) -> None:
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def _serve(self) -> None:
        try:
            with self._socket, self._socket.makefile("rb") as lines, suppress(OSError, requests.NotJsonError):
                while line := lines.readline(LONGEST_LINE):
                    self._received_ns, self._has_sent = now_ns(), True
                    if _is_whole(line):
                        self._answer(line)
                    else:
                        self._send(requests.encode(TOO_LONG))
                    while not _is_whole(line):
                        line = lines.readline(LONGEST_LINE)
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify()
            for vehicle in self._commanded:
                _leave(vehicle)

    def _send(self, line: bytes) -> None:
        with self._writing:
            try:
                self._socket.sendall(line)
            except OSError:  # disconnected, or it does not read: half a line may have been sent, so nothing can follow
                self._hang_up()
                raise

    def _answer(self, line: bytes) -> None:
        """Answer a line. Raises NotJsonError after that was answered; OSError."""
        answer: Request = {"id": None, "ok": True}
        problem = ""
        try:
            request = requests.read_request(line)
            answer["id"] = request.pop("id", None)
            answer |= self._do(request)
        except requests.NotJsonError as error:
            self._send(requests.encode(answer | {"ok": False, "error": str(error)}))
            raise
        except HilError as error:
            problem = str(error)
        except Exception as error:  # noqa: BLE001 - no line ends a connection that a vehicle may depend on
            problem = f"{type(error).__name__}: {error}"
        self._send(requests.encode(answer | {"ok": False, "error": problem} if problem else answer))

    def _do(self, request: Request) -> Request:
        what = str(request.pop("do", ""))
        handlers: dict[str, Callable[[Request], Request]] = {
            "login": self._login, "vehicles": self._vehicles, "get": self._get, "subscribe": self._subscribe,
            "unsubscribe": self._unsubscribe, "status": self._status,
        }  # fmt: skip
        if what in handlers:
            return handlers[what](request)
        if what not in requests.COMMANDS and what not in requests.SERVICES:
            names = [*requests.COMMANDS, *requests.SERVICES, *handlers]
            raise ConfigError(f"do: {what!r} is none of {', '.join(names)}{nearest(what, names)}")
        if not self._may_command:
            where = self._access.path or "what the gateway showed when it started"
            raise ConfigError(f'{what}: first send {{"do": "login", "token": "..."}}; the token is in {where}')
        vehicle = self._vehicle(request)
        if what in requests.SERVICES:
            return {"message": requests.serve(vehicle, what, request)}
        self._commanded.setdefault(vehicle, None)  # it stops with the connection, whatever comes of this
        command = requests.call(vehicle, what, request)
        with self._changed:
            self._commanded[vehicle], self._stopped = command, ""
            self._changed.notify()
        return {}

    def _login(self, request: Request) -> Request:
        deadman = request.get("deadman", DEADMAN_S)
        if not (requests.is_number(deadman) and 0 < deadman <= MAX_DEADMAN_S):
            raise ConfigError(f"deadman: {requests.show(deadman)} is not a number of seconds up to {MAX_DEADMAN_S:g}")
        if not self._access.admits(request.get("token")):
            raise ConfigError(
                "token: this is not the token of this gateway; it makes a new one at each start, and shows it then"
            )
        self._may_command, self._deadman_ns = True, round(deadman * NS_PER_S)
        return {}

    def _vehicles(self, _: Request) -> Request:
        return {"vehicles": sorted(self._fleet.vehicles)}

    def _get(self, request: Request) -> Request:
        return requests.describe(self._vehicle(request).newest(requests.sensor_of(request)))

    def _subscribe(self, request: Request) -> Request:
        vehicle, sensor, rate = self._vehicle(request), requests.sensor_of(request), request.get("rate", 10.0)
        if not (requests.is_number(rate) and MIN_RATE <= rate <= MAX_RATE):
            raise ConfigError(f"rate: {requests.show(rate)} is not between {MIN_RATE:g} and {MAX_RATE:g} Hz")
        vehicle.newest(sensor)
        with self._changed:
            self._wanted[vehicle.name, sensor] = round(NS_PER_S / rate), 0
            self._changed.notify()
        return {}

    def _unsubscribe(self, request: Request) -> Request:
        with self._changed:
            self._wanted.pop((self._vehicle(request).name, requests.sensor_of(request)), None)
        return {}

    def _status(self, request: Request) -> Request:
        """Return whether the last command is done, and why it will not be, if so."""
        command = self._commanded.get(self._vehicle(request))
        if command is None:
            return {"done": False, "over": True, "error": self._stopped}
        return {"done": command.done, "over": command.over, "error": str(command.error or "")}

    def _vehicle(self, request: Request) -> Vehicle:
        """Return the one that is named, or the only one."""
        name = request.pop("vehicle", "")
        if name:
            return self._fleet[str(name)]
        vehicles = self._fleet.vehicles
        if len(vehicles) > 1:
            raise ConfigError(f"vehicle: name one of {', '.join(vehicles)}")
        return next(iter(vehicles.values()))

    def _send_samples(self) -> None:
        """Send what was subscribed to, each at its rate, and stop vehicles whose client is silent.

        Waits without waking up while there is neither a subscription nor a command.
        """
        sent: dict[tuple[str, str], int] = {}
        while True:
            with self._changed:
                if self._ended:
                    return
                wake_ns = min([due for _, due in self._wanted.values()], default=None)
                if any(self._commanded.values()):
                    silent_ns = self._received_ns + self._deadman_ns
                    wake_ns = silent_ns if wake_ns is None else min(wake_ns, silent_ns)
                self._changed.wait(None if wake_ns is None else max(0.0, (wake_ns - now_ns()) / NS_PER_S))
                if self._ended:
                    return
                due_keys = [key for key, (_, due) in self._wanted.items() if due <= now_ns()]
            self._check_deadman()
            for key in due_keys:
                with suppress(Exception):  # disconnected, or without subscribers: the others are sent nevertheless
                    self._send_sample(key, sent)

    def _send_sample(self, key: tuple[str, str], sent: dict[tuple[str, str], int]) -> None:
        """Send the newest sample of a vehicle's sensor, or check again soon if it has been sent already."""
        vehicle, sensor = key
        with self._changed:
            if key not in self._wanted:
                return
            now, (period, due) = now_ns(), self._wanted[key]
            self._wanted[key] = period, now + min(max(RETRY_NS[0], period // 20), RETRY_NS[1])
        sample = self._fleet[vehicle].newest(sensor)
        if sent.get(key) == sample.sent_ns:
            return
        sent[key] = sample.sent_ns
        with self._changed:
            if key in self._wanted:
                self._wanted[key] = period, max(due, now - period) + period
        self._send(requests.encode({"vehicle": vehicle, "sensor": sensor, **requests.describe(sample)}))

    def _check_deadman(self) -> None:
        with self._changed:
            silent_ns = now_ns() - self._received_ns
            if silent_ns < self._deadman_ns or not any(self._commanded.values()):
                return
            self._stopped = f"stopped: no line came for {self._deadman_ns / NS_PER_S:g} s, the deadman of this login"
            vehicles = list(self._commanded)
            self._commanded = dict.fromkeys(vehicles)
        for vehicle in vehicles:
            _leave(vehicle)


def _leave(vehicle: Vehicle) -> None:
    """Stop the vehicle. One that is disconnected gets no command, or it would move when it is back."""
    try:
        vehicle.stop()
    except Exception:  # noqa: BLE001 - what keeps one from stopping must not keep the others
        vehicle.release()


def _is_whole(line: bytes) -> bool:
    """Return whether what was read is a line to its end, and not the beginning of a longer one."""
    return len(line) < LONGEST_LINE or line.endswith(b"\n")
