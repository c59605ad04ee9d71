"""Two SeaTrac beacons and the sound between them: one at the station of the USBL sensor, one on the vehicle."""

from functools import partial
from math import dist
from struct import pack
from typing import Annotated, Literal, NamedTuple

from hil.common.clock import NS_PER_MS, seconds_ns
from hil.common.schema import Range
from hil.instruments.contract import Client, Instrument
from hil.instruments.seatrac import beacon as messages
from hil.instruments.seatrac.beacon import Beacon, Cid, Cst, Place
from sim.environment.seawater.pressure import ATMOSPHERE_PA
from sim.environment.seawater.water_column import SOUND_SPEED
from sim.modems.acoustic import AcousticChannel, AcousticModem
from sim.rotations import from_euler
from sim.sensors.extra_samples import PositionSample
from sim.sensors.samples import Sensor

End = Literal["station", "vehicle"]
_DATA = {Cid.PING_SEND: 0, Cid.ECHO_SEND: 30, Cid.NAV_QUERY_SEND: 29, Cid.DAT_SEND: 30}  # most bytes of data
_ERROR = 3  # the error of an exchange has the number of its command plus this
_DEPTH, _SUPPLY, _TEMPERATURE, _ATTITUDE, _HAS_DATA = 1, 2, 4, 8, 0x80
_HEADER = bytes(2)  # of an acoustic message
_LONGEST_S = 60.0  # of a message under way
_DEEP = 1e4  # m; echoes off the bottom are left out


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
    first = b"#\r\n"
    warm_up_s = 1.0
    longest = 600

    def prepare(self) -> None:
        """Set its state at power on."""
        self._sensor: Sensor | None = None
        self._beacons: dict[str, Beacon] = {}
        for end, number in (("station", 15), ("vehicle", 1)):
            memory = self.facts.memory.setdefault(end, {})
            self._beacons[end] = Beacon(end, memory, number, self.settings.x150 in (end, "both"))
        self._channel = AcousticChannel(self.settings.modem, _DEEP, self.facts.seed)
        self._under_way: dict[tuple[str, int], Exchange] = {}  # by sender and time (ns)

    def start(self, now_ns: int) -> None:
        """Switch the beacons on, and build the sensor that measures between them."""
        self._sensor = self.scene.build()
        for beacon in self._beacons.values():
            beacon.reboot(now_ns)

    def _other(self, beacon: Beacon) -> Beacon:
        return self._beacons["vehicle" if beacon.end == "station" else "station"]

    def _of(self, client: Client) -> Beacon:
        first = self._beacons[self.settings.end]
        return self._other(first) if client.wire else first

    def on_message(self, client: Client, message: bytes, now_ns: int) -> None:
        """Carry out a command."""
        super().tick(now_ns)
        payload, beacon, answer = messages.decode_line(message), self._of(client), None
        if payload and payload[0] in _DATA:
            answer = self._begin(beacon, payload[0], payload[1:], now_ns)
        elif payload:
            is_status = payload[0] == Cid.STATUS
            answer = self._status(beacon, now_ns) if is_status else beacon.answer(payload[0], payload[1:], now_ns)
        if answer is None:
            self.malformed += 1
        else:
            self.send(messages.encode_line(answer), client)

    def tick(self, now_ns: int) -> int:
        """Let sound arrive, and send what is due."""
        due_ns = super().tick(now_ns)
        for beacon in self._beacons.values():
            if beacon.is_status_due(now_ns) and (status := self._status(beacon, now_ns)):
                self._report(beacon, status)
        return min(due_ns, *[beacon.status_due_ns for beacon in self._beacons.values()])

    def _report(self, beacon: Beacon, payload: bytes, measured_ns: int = 0) -> None:
        for client in [client for client in self.readers if self._of(client) is beacon]:
            self.send(messages.encode_line(payload), client, measured_ns=measured_ns)

    # --- where the beacons are

    def _place(self, beacon: Beacon, now_ns: int) -> Place | None:
        state = self.scene.state(now_ns)
        if state is None:
            return None
        position, turned = self.facts.mounting.world_position(state), self.facts.mounting.attitude(state)
        if beacon.end == "station":
            position, turned = self.facts.model.station, from_euler(0.0, 0.0, self.settings.heading)
        is_automatic = beacon.settings["environment"] & messages.AUTO_SOUND_SPEED
        speed = self.facts.sound_speed(position[2]) if is_automatic else beacon.settings["sound_speed"] / 10.0
        return Place(position, turned, speed)

    def _status(self, beacon: Beacon, now_ns: int) -> bytes | None:
        here = self._place(beacon, now_ns)
        if here is None:
            return None
        pressure = ATMOSPHERE_PA + self.facts.pressure(here.depth)
        return beacon.status(here, pressure, self.settings.temperature, now_ns)

    # --- exchanges

    def _begin(self, beacon: Beacon, command: int, payload: bytes, now_ns: int) -> bytes:
        """Send a message into the water; return the answer to the command."""
        most = _DATA[command]
        destination, kind, size = (payload + bytes(3))[:3] if most else (*(payload + bytes(2))[:2], 0)
        content = payload[3 : 3 + size]
        if command == Cid.NAV_QUERY_SEND:  # has flags of a query in place of a kind
            kind, content = messages.REQUEST, payload[1:2] + content
        is_request = kind in (messages.REQUEST, messages.REQUEST_USBL, messages.REQUEST_DEPTH)
        is_one_way = command == Cid.DAT_SEND and kind in (messages.ONE_WAY, messages.ONE_WAY_USBL)
        result = Cst.OK
        if len(payload) < 2 + bool(most) or (len(payload) < 3 + size and size):
            result = Cst.PARAM_MISSING
        elif destination > 15 or size > most or not (is_one_way or (is_request and destination)):
            result = Cst.PARAM_INVALID
        elif now_ns < beacon.busy_until_ns:
            result = Cst.BUSY
        else:
            exchange = Exchange(command, kind, destination, content)
            end_ns = beacon.busy_until_ns = self._transmit(beacon, exchange, now_ns)
            if not end_ns:
                result = Cst.BUSY
            elif is_request:
                longest_ns = self.settings.modem.airtime_ns(31) + beacon.settings["turnaround"] * NS_PER_MS
                until_ns = end_ns + longest_ns + seconds_ns(2.0 * beacon.settings["range_limit"] / SOUND_SPEED)
                beacon.busy_until_ns = until_ns
                self.timers[partial(self._time_out, beacon, exchange)] = until_ns
        return bytes((command, result, destination))

    def _transmit(self, beacon: Beacon, exchange: Exchange, now_ns: int) -> int:
        """Send a message into the water; return the end of its transmission, 0 if it is not sent."""
        other = self._other(beacon)
        here, there = self._place(beacon, now_ns), self._place(other, now_ns)
        if here is None or there is None:
            return 0
        places = {beacon.end: here.position, other.end: there.position}
        end_ns = self._channel.send(now_ns, beacon.end, _HEADER + exchange.content, places)
        if end_ns:
            self._under_way[beacon.end, now_ns] = exchange
            sound_ns = seconds_ns(dist(here.position, there.position) / SOUND_SPEED)
            self.timers[partial(self._deliver)] = end_ns + sound_ns + 1
        return end_ns

    def _deliver(self, due_ns: int, _: int) -> None:
        """Take what the water has carried; forget what must have been lost."""
        for packet in self._channel.receive(due_ns):
            exchange = self._under_way.pop((packet.sender, packet.sent_ns))
            self._arrive(self._beacons[packet.receiver], exchange, due_ns)
        oldest_ns = due_ns - seconds_ns(_LONGEST_S)
        self._under_way = {key: exchange for key, exchange in self._under_way.items() if key[1] > oldest_ns}

    def _time_out(self, beacon: Beacon, exchange: Exchange, due_ns: int, _: int) -> None:
        if beacon.busy_until_ns == due_ns:  # no response has ended it
            self._report(beacon, bytes((exchange.command + _ERROR, Cst.TIMEOUT, exchange.destination)))

    def _arrive(self, beacon: Beacon, exchange: Exchange, due_ns: int) -> None:
        """Report a message at a beacon that is free for it or has waited for this response, and answer a request."""
        is_response = exchange.kind >= messages.REQUEST and bool(exchange.kind & 1)
        is_meant = is_response or exchange.destination in (0, beacon.settings["beacon"])
        is_waiting = due_ns < beacon.busy_until_ns
        fix = self._fix(beacon, exchange, due_ns) if is_meant and is_waiting == is_response else None
        if fix is None:
            return
        if is_response:
            beacon.busy_until_ns = 0
            if beacon.settings["flags"] & messages.REPORT_FIXES:
                self._report(beacon, bytes((Cid.XCVR_FIX,)) + fix, due_ns)
        number = exchange.command + (2 if is_response and exchange.command != Cid.DAT_SEND else 1)
        self._report(beacon, bytes((number,)) + fix + _body(exchange, is_response), due_ns)
        if exchange.kind >= messages.REQUEST and not is_response:
            response = exchange._replace(kind=exchange.kind + 1, content=self._response(beacon, exchange, due_ns))
            sent_ns = due_ns + beacon.settings["turnaround"] * NS_PER_MS
            self.timers[lambda at_ns, _: self._transmit(beacon, response, at_ns)] = sent_ns

    def _response(self, beacon: Beacon, exchange: Exchange, now_ns: int) -> bytes:
        """Return the content of a beacon's response."""
        here, query = self._place(beacon, now_ns), exchange.content
        if exchange.command == Cid.ECHO_SEND:
            return query
        queue = beacon.queue
        if exchange.command == Cid.DAT_SEND:
            beacon.queue = b""
            return queue
        if exchange.command == Cid.PING_SEND or here is None:
            return b""
        data, flags = query[:1], query[0]
        data += pack("<i", round(10.0 * here.depth)) if flags & _DEPTH else b""
        data += pack("<H", messages.SUPPLY_MV) if flags & _SUPPLY else b""
        data += pack("<h", round(10.0 * self.settings.temperature)) if flags & _TEMPERATURE else b""
        data += messages.attitude(here.attitude) if flags & _ATTITUDE else b""
        if flags & _HAS_DATA:
            beacon.queue = b""
            data += bytes((len(queue),)) + queue
        return data

    def _fix(self, beacon: Beacon, exchange: Exchange, now_ns: int) -> bytes | None:
        """Return the record of a fix that a beacon makes of a message; None if it does not hear it."""
        other = self._other(beacon)
        sample = self.scene.measure(self._sensor, now_ns) if self._sensor else None
        here, there = self._place(beacon, now_ns), self._place(other, now_ns)
        if not isinstance(sample, PositionSample) or here is None or there is None:
            return None
        x, y, z = [a - b for a, b in zip(sample.position, self.facts.model.station, strict=True)]
        relative = (x, y, z) if beacon.end == "station" else (-x, -y, -z)
        ids = beacon.settings["beacon"] if exchange.destination else 0, other.settings["beacon"]
        assumed = beacon.assumed(here.attitude) if beacon.has_head else None
        turnaround = other.settings["turnaround"] * 1e-3
        return messages.encode_fix(ids, exchange.kind, here, relative, turnaround, assumed, there.depth)


def _body(exchange: Exchange, is_response: bool) -> bytes:
    """Return what the report of a message has behind the fix."""
    content = exchange.content
    sized = bytes((len(content),)) + content
    if exchange.command == Cid.PING_SEND:
        return b""
    if exchange.command == Cid.ECHO_SEND:
        return sized
    if exchange.command == Cid.DAT_SEND:
        return bytes((is_response,)) + sized + b"\1"
    if not is_response:
        content = content[:1] + bytes((max(0, len(content) - 1),)) + content[1:]
    return content + b"\1"
