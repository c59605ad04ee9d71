"""Two SeaTrac beacons and the sound between them: one at the station of the USBL sensor, one on the vehicle."""

from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from math import dist
from struct import pack
from typing import Annotated, Any, Literal, NamedTuple, cast

from hil.common.clock import NEVER_NS, NS_PER_MS, seconds_ns
from hil.common.schema import Range
from hil.common.vectors import Vector3
from hil.instruments.contract import Client, Facts, Instrument, Scene, Send
from hil.instruments.seatrac import messages
from hil.instruments.seatrac.beacon import Beacon
from hil.instruments.seatrac.messages import Cid, Cst, Place
from sim.environment.seawater.water_column import SOUND_SPEED
from sim.modems.acoustic import AcousticChannel, AcousticModem
from sim.rotations import from_euler
from sim.sensors.extra_samples import PositionSample
from sim.sensors.samples import Sensor

End = Literal["station", "vehicle"]
_LONGEST = 600  # characters of a line
_DATA = {Cid.PING_SEND: 0, Cid.ECHO_SEND: 30, Cid.NAV_QUERY_SEND: 29, Cid.DAT_SEND: 30}  # most bytes of data
_ERROR = 3  # the error of an exchange has the number of its command plus this
_DEPTH, _SUPPLY, _TEMPERATURE, _ATTITUDE, _HAS_DATA = 1, 2, 4, 8, 0x80
_HEADER = bytes(2)  # of an acoustic message
_LONGEST_S = 60.0  # of a message under way
_DEEP = 1e4  # m; echoes off the bottom are left out
_SURFACE_PA, _PA_PER_M = 101_325.0, 1.0e4


class LinkSettings(NamedTuple):
    """Which `end` the first wire is (the second is the other), which has an X150; the others have an X110.

    `heading` (rad) is that of the station's beacon, `temperature` (°C) that of the water. `modem` has the band, bit
    rate and source level of the data sheet, and the noise of the sea around. That a message has 2 bytes besides its
    data is our assumption.
    """

    end: End = "station"
    x150: Literal["station", "vehicle", "both"] = "station"
    heading: Annotated[float, Range(-3.2, 6.3, "rad")] = 0.0
    modem: AcousticModem = AcousticModem(bit_rate=100.0, source_level=176.0)
    temperature: Annotated[float, Range(-2.0, 40.0, "°C")] = 10.0


class Exchange(NamedTuple):
    """A message under way: its command (CID), kind, destination and content."""

    command: int
    kind: int
    destination: int
    content: bytes


class SeatracLink(Instrument):
    """The two beacons, ids 15 (station) and 1 (vehicle). A ping needs the sound's time there and back.

    Ranges and angles are those of the USBL sensor, measured when the vehicle hears or answers. Messages go through the
    acoustic channel of modems, at the mean speed of sound: noise damages them, two at a time collide, and who sends
    does not hear. Where the sensor measures nothing (out of reach, out of the water, in a shadow) they are lost, too,
    as when the receiver waits for a response. A lost request times out. Not simulated: raw data of the compass,
    XCVR_USBL messages, the position filter.
    """

    Model = LinkSettings
    sensors = ("usbl",)
    wires = ("tcp", "serial", "pty")
    first = b"#\r\n"
    warm_up_s = 1.0

    def __init__(self, settings: Any, facts: Facts, scene: Scene, send: Send) -> None:
        super().__init__(settings, facts, scene, send)
        self._sensor: Sensor | None = None
        self._clients: dict[End, list[Client]] = {"station": [], "vehicle": []}
        self._buffers: dict[Client, bytes] = {}
        self._events: list[tuple[int, int, Callable[[int], object]]] = []
        self._order = count()
        self._beacons: dict[End, Beacon] = {}
        self._channel = AcousticChannel(settings.modem, _DEEP, facts.seed)
        self._under_way: dict[tuple[str, int], Exchange] = {}  # by sender and time (ns)

    def start(self, now_ns: int) -> None:
        """Build the beacons and the sensor that measures between them."""
        self._sensor = self.scene.build()
        numbers: dict[End, int] = {"station": 15, "vehicle": 1}
        for end, number in numbers.items():
            memory = self.facts.memory.setdefault(end, {})
            self._beacons[end] = Beacon(memory, number, self.settings.x150 in (end, "both"), now_ns)

    def _end(self, client: Client) -> End:
        return self.settings.end if client.wire == 0 else _other(self.settings.end)

    def connected(self, client: Client, now_ns: int) -> None:
        """Take up a client of one of the beacons."""
        self._clients[self._end(client)].append(client)

    def disconnected(self, client: Client, now_ns: int) -> None:
        """Forget a client."""
        self._buffers.pop(client, None)
        if client in self._clients[self._end(client)]:
            self._clients[self._end(client)].remove(client)

    def on_data(self, client: Client, data: bytes, now_ns: int) -> None:
        """Carry out each complete line."""
        self._let_happen(now_ns)
        *lines, rest = (self._buffers.get(client, b"") + data).replace(b"\r", b"\n").split(b"\n")
        self._buffers[client] = rest[-_LONGEST:]
        for line in filter(None, lines):
            payload = messages.decode_line(line)
            answer = self._carry_out(self._end(client), payload, now_ns) if payload else None
            if answer is None:
                self.malformed += 1
            else:
                self.send(messages.encode_line(answer), client)

    def _carry_out(self, end: End, payload: bytes, now_ns: int) -> bytes | None:
        command, beacon = payload[0], self._beacons[end]
        if command in _DATA:
            return self._begin(end, command, payload[1:], now_ns)
        if command == Cid.STATUS:
            return self._status(end, now_ns)
        return beacon.answer(command, payload[1:], now_ns)

    def tick(self, now_ns: int) -> int:
        """Let sound arrive, and send what is due."""
        self._let_happen(now_ns)
        for end, beacon in self._beacons.items():
            if beacon.is_status_due(now_ns) and (status := self._status(end, now_ns)):
                self._report(end, status)
        first_ns = self._events[0][0] if self._events else NEVER_NS
        return min([first_ns, *[beacon.next_ns for beacon in self._beacons.values()]])

    def _report(self, end: End, payload: bytes, measured_ns: int = 0) -> None:
        for client in self._clients[end]:
            self.send(messages.encode_line(payload), client, measured_ns=measured_ns)

    def _let_happen(self, now_ns: int) -> None:
        while self._events and self._events[0][0] <= now_ns:
            due_ns, _, happen = heappop(self._events)
            happen(due_ns)

    def _at(self, due_ns: int, happen: Callable[[int], object]) -> None:
        heappush(self._events, (due_ns, next(self._order), happen))

    # --- where the beacons are

    def _position(self, end: End, now_ns: int) -> Vector3 | None:
        station: Vector3 = self.facts.model.station
        if end == "station":
            return station
        state = self.scene.state(now_ns)
        return self.facts.mounting.world_position(state) if state else None

    def _place(self, end: End, now_ns: int) -> Place | None:
        position, state = self._position(end, now_ns), self.scene.state(now_ns)
        if position is None or state is None:
            return None
        settings = self._beacons[end].settings
        is_automatic = settings.environment & messages.AUTO_SOUND_SPEED
        speed = self.facts.sound_speed(position[2]) if is_automatic else settings.sound_speed / 10.0
        turned = self.facts.mounting.attitude(state)
        return Place(position[2], turned if end == "vehicle" else from_euler(0.0, 0.0, self.settings.heading), speed)

    def _status(self, end: End, now_ns: int) -> bytes | None:
        here = self._place(end, now_ns)
        if here is None:
            return None
        pressure = _SURFACE_PA + _PA_PER_M * max(0.0, here.depth)
        return self._beacons[end].status(here, pressure, self.settings.temperature, now_ns)

    # --- exchanges

    def _begin(self, end: End, command: int, payload: bytes, now_ns: int) -> bytes:
        """Send a message into the water; return the answer to the command."""
        beacon = self._beacons[end]
        destination = payload[0] if payload else 0
        is_nav = command == Cid.NAV_QUERY_SEND  # has flags of a query in place of a kind
        kind = messages.REQUEST if is_nav else payload[1] if len(payload) > 1 else 0xFF
        size = payload[2] if len(payload) > 2 and _DATA[Cid(command)] else 0
        content = payload[1:2] * is_nav + payload[3 : 3 + size]
        is_request = kind in (messages.REQUEST, messages.REQUEST_USBL, messages.REQUEST_DEPTH)
        is_one_way = command == Cid.DAT_SEND and kind in (messages.ONE_WAY, messages.ONE_WAY_USBL)
        if len(payload) < 2 + bool(_DATA[Cid(command)]) or (len(payload) < 3 + size and size):
            return bytes((command, Cst.PARAM_MISSING, destination))
        if destination > 15 or size > _DATA[Cid(command)] or not (is_one_way or (is_request and destination)):
            return bytes((command, Cst.PARAM_INVALID, destination))
        if now_ns < beacon.busy_until_ns:
            return bytes((command, Cst.BUSY, destination))
        exchange, settings = Exchange(command, kind, destination, content), beacon.settings
        end_ns = self._transmit(end, exchange, now_ns)
        if not end_ns:
            return bytes((command, Cst.BUSY, destination))
        if is_one_way:
            beacon.busy_until_ns = end_ns
        else:
            longest_ns = self.settings.modem.airtime_ns(31) + settings.turnaround * NS_PER_MS
            until_ns = beacon.busy_until_ns = end_ns + longest_ns + seconds_ns(2.0 * settings.range_limit / SOUND_SPEED)
            self._at(until_ns, lambda _: self._time_out(end, exchange, until_ns))
        return bytes((command, Cst.OK, destination))

    def _transmit(self, end: End, exchange: Exchange, now_ns: int) -> int:
        """Send a message into the water; return the end of its transmission, 0 if it is not sent."""
        here, there = self._position(end, now_ns), self._position(_other(end), now_ns)
        if here is None or there is None:
            return 0
        end_ns = self._channel.send(now_ns, end, _HEADER + exchange.content, {end: here, _other(end): there})
        if end_ns:
            self._under_way[end, now_ns] = exchange
            self._at(end_ns + seconds_ns(dist(here, there) / SOUND_SPEED) + 1, self._deliver)
        return end_ns

    def _deliver(self, due_ns: int) -> None:
        """Take what the water has carried; forget what must have been lost."""
        for packet in self._channel.receive(due_ns):
            exchange, receiver = self._under_way.pop((packet.sender, packet.sent_ns)), cast(End, packet.receiver)
            if exchange.kind >= messages.REQUEST and exchange.kind & 1:
                self._return(receiver, exchange, due_ns)
            else:
                self._arrive(receiver, exchange, due_ns)
        oldest_ns = due_ns - seconds_ns(_LONGEST_S)
        self._under_way = {key: exchange for key, exchange in self._under_way.items() if key[1] > oldest_ns}

    def _time_out(self, end: End, exchange: Exchange, until_ns: int) -> None:
        if self._beacons[end].busy_until_ns == until_ns:  # no response has ended it
            self._report(end, bytes((exchange.command + _ERROR, Cst.TIMEOUT, exchange.destination)))

    def _arrive(self, end: End, exchange: Exchange, due_ns: int) -> None:
        """A message has arrived at a beacon: report it, and answer a request."""
        beacon = self._beacons[end]
        if exchange.destination not in (0, beacon.settings.beacon) or due_ns < beacon.busy_until_ns:
            return
        fix = self._fix(end, exchange, due_ns)
        if fix is None:
            return
        content, size = exchange.content, bytes((len(exchange.content),))
        body = {
            Cid.PING_SEND: b"",
            Cid.ECHO_SEND: size + content,
            Cid.NAV_QUERY_SEND: content[:1] + bytes((max(0, len(content) - 1),)) + content[1:] + b"\1",
            Cid.DAT_SEND: b"\0" + size + content + b"\1",
        }[Cid(exchange.command)]
        self._report(end, bytes((exchange.command + 1,)) + fix + body, due_ns)
        if exchange.kind >= messages.REQUEST:
            response = exchange._replace(kind=exchange.kind + 1, content=self._response(end, exchange, due_ns))
            sent_ns = due_ns + beacon.settings.turnaround * NS_PER_MS
            self._at(sent_ns, lambda at_ns: self._transmit(end, response, at_ns))

    def _response(self, end: End, exchange: Exchange, now_ns: int) -> bytes:
        """Return the content of a beacon's response."""
        beacon, here = self._beacons[end], self._place(end, now_ns)
        if exchange.command == Cid.ECHO_SEND:
            return exchange.content
        if exchange.command == Cid.DAT_SEND:
            content, beacon.queue = beacon.queue, b""
            return content
        if exchange.command == Cid.PING_SEND or here is None:
            return b""
        flags = exchange.content[0]
        data = bytes((flags,))
        data += pack("<i", round(10.0 * here.depth)) if flags & _DEPTH else b""
        data += pack("<H", 12_000) if flags & _SUPPLY else b""
        data += pack("<h", round(10.0 * self.settings.temperature)) if flags & _TEMPERATURE else b""
        data += messages.attitude(here.attitude) if flags & _ATTITUDE else b""
        if flags & _HAS_DATA:
            data += bytes((len(beacon.queue),)) + beacon.queue
            beacon.queue = b""
        return data

    def _return(self, end: End, response: Exchange, due_ns: int) -> None:
        """A response has arrived: report it with its range, and the position that this gives."""
        beacon = self._beacons[end]
        fix = self._fix(end, response, due_ns)
        if fix is None or due_ns >= beacon.busy_until_ns:
            return
        beacon.busy_until_ns = 0
        content, size = response.content, bytes((len(response.content),))
        if beacon.settings.flags & messages.REPORT_FIXES:
            self._report(end, bytes((Cid.XCVR_FIX,)) + fix, due_ns)
        number, body = {
            Cid.PING_SEND: (2, b""),
            Cid.ECHO_SEND: (2, size + content),
            Cid.NAV_QUERY_SEND: (2, content + b"\1"),
            Cid.DAT_SEND: (1, b"\1" + size + content + b"\1"),  # an acknowledgement, with what was queued there
        }[Cid(response.command)]
        self._report(end, bytes((response.command + number,)) + fix + body, due_ns)

    def _fix(self, end: End, exchange: Exchange, now_ns: int) -> bytes | None:
        """Return the record of a fix that a beacon makes of a message; None if it does not hear it."""
        sample = self.scene.measure(self._sensor, now_ns) if self._sensor else None
        here, there = self._place(end, now_ns), self._place(_other(end), now_ns)
        if not isinstance(sample, PositionSample) or here is None or there is None:
            return None
        x, y, z = [a - b for a, b in zip(sample.position, self.facts.model.station, strict=True)]
        relative = (x, y, z) if end == "station" else (-x, -y, -z)
        beacon, other = self._beacons[end], self._beacons[_other(end)]
        ids = beacon.settings.beacon if exchange.destination else 0, other.settings.beacon
        seconds, turnaround = dist(relative, (0.0, 0.0, 0.0)) / here.sound_speed, other.settings.turnaround * 1e-3
        assumed = beacon.assumed(here.attitude)
        return messages.encode_fix(
            ids, exchange.kind, here, relative, seconds, turnaround, beacon.has_head, assumed, there.depth
        )


def _other(end: End) -> End:
    return "vehicle" if end == "station" else "station"
