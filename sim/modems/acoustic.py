"""Acoustic modems on a shared channel: who receives a message, when, and which messages are lost.

A message takes its time in the water and its time on the air. While a modem sends it receives nothing, and while it
receives one message it misses another (collision), which disturbs it. Whether a message is whole is drawn from its
signal to noise ratio. Time comes in as an argument; the same seed and the same calls give the same losses.
"""

from collections import Counter
from collections.abc import Mapping
from math import exp, hypot, log10
from typing import Annotated, NamedTuple

from hil.common.schema import Range
from hil.common.vectors import Vector3
from sim.environment.seawater.water_column import SOUND_SPEED, WaterColumn
from sim.modems.sound import Path, ambient_noise, paths, power, transmission_loss
from sim.sensors.error import ErrorModel, ErrorProcess, sensor_random

NS = 1_000_000_000
RECEIVED = "received"  # so far
_NEGLIGIBLE = 1e-3  # of the noise: what is weaker disturbs nobody


class AcousticModem(NamedTuple):
    """A modem and the sea it works in. The defaults are Newcastle University's Nanomodem V3 (its published table).

    `frequency` and `bandwidth` Hz, `bit_rate` bit/s, `source_level` dB re 1 uPa at 1 m, `longest` bytes a message.
    Ours, not the table's: `overhead` s before the first bit (a chirp to detect, the header), `detection` dB
    of signal to noise below which nothing is noticed. `spreading` 1 to 2, `wind` m/s, `shipping` 0 to 1: the sea's.
    `bounces`: echoes from surface and bottom are received too, up to so many reflections, each of which costs
    `surface_loss` or `bottom_loss` dB. `range_error` is that of a distance (m), measured with `assumed_speed` m/s.
    """

    frequency: Annotated[float, Range(1e3, 1e6, "Hz")] = 28_000.0
    bandwidth: Annotated[float, Range(100.0, 1e6, "Hz")] = 8_000.0
    bit_rate: Annotated[float, Range(1.0, 1e6)] = 640.0
    source_level: Annotated[float, Range(100.0, 230.0)] = 168.0
    longest: Annotated[int, Range(1, 4096)] = 64
    overhead: Annotated[float, Range(0.0, 5.0, "s")] = 0.03
    detection: Annotated[float, Range(-30.0, 30.0)] = -6.0
    spreading: Annotated[float, Range(1.0, 2.0)] = 1.5
    wind: Annotated[float, Range(0.0, 40.0, "m/s")] = 5.0
    shipping: Annotated[float, Range(0.0, 1.0)] = 0.5
    bounces: Annotated[int, Range(0, 8)] = 0
    surface_loss: Annotated[float, Range(0.0, 60.0)] = 1.0
    bottom_loss: Annotated[float, Range(0.0, 60.0)] = 6.0
    range_error: ErrorModel = ErrorModel(noise=0.1, resolution=0.047)
    assumed_speed: Annotated[float, Range(1300.0, 1700.0, "m/s")] = 1500.0

    def airtime_ns(self, size: int) -> int:
        """Return how long a message of `size` bytes is on the air."""
        return round((self.overhead + 8 * size / self.bit_rate) * NS)


class Packet(NamedTuple):
    """A message that was received.

    `sent_ns` is when its sender began, `received_ns` when its last bit was there; `snr` (dB) is that of signal to noise
    and disturbance; `distance` (m) what two clocks that agree make of the time it took, errors included.
    """

    sender: str
    receiver: str
    payload: bytes
    sent_ns: int
    received_ns: int
    snr: float
    distance: float


class _Arrival(NamedTuple):
    """One way of one message to one receiver: begin and end there (ns), power over that of 1 uPa."""

    begin_ns: int
    end_ns: int
    sender: str
    receiver: str
    number: int  # of the message
    power: float
    direct: bool
    payload: bytes
    sent_ns: int

    @property
    def name(self) -> tuple[int, str]:
        """Message and receiver."""
        return self.number, self.receiver


class AcousticChannel:
    """The water between modems, over a bottom at `depth` m. Calls must come in the order of time.

    `counts`: sent, delivered, and why not: busy (the sender itself was still sending), too_long, too_weak,
    shadowed (no ray of sound leads there), deaf (the receiver was sending), collided (with another), damaged
    (bit errors).

    Where the profile of `column` bends the rays (seawater/sound_rays.py) time and length of the direct way are
    theirs. Echoes go straight, at the direct way's mean speed; in a shadow the shortest of them carries the message.

    Vehicles stand still while a message is on its way: at 2 m/s over 1500 m that is 2 m. Bit errors are those of
    orthogonal signals without a common phase, ½ exp(-Eb / 2 N0) (Proakis, Digital Communications), without error
    correction. Not modelled: Doppler, fading, directivity, what stands in the way.
    """

    def __init__(self, modem: AcousticModem, depth: float, seed: int, column: WaterColumn | None = None) -> None:
        self._modem = modem
        self._depth = depth
        self._column = column
        self._rays = column.rays(depth) if column else None
        self._random = sensor_random(seed, "acoustic_channel")
        self._ranging = ErrorProcess(modem.range_error, 1.0, sensor_random(seed, "acoustic_ranging"))
        spectral = ambient_noise(modem.frequency, modem.wind, modem.shipping)
        self._noise = power(spectral + 10.0 * log10(modem.bandwidth))
        self._sending: dict[str, list[tuple[int, int]]] = {}  # by modem: when it sends
        self._arrivals: list[_Arrival] = []  # not yet judged, or may still disturb
        self._outcomes: dict[tuple[int, str], str] = {}
        self._busy_until_ns: dict[str, int] = {}  # by modem: until when it is taken by a message
        self._number = 0
        self.counts: Counter[str] = Counter()

    def send(self, time_ns: int, sender: str, payload: bytes, places: Mapping[str, Vector3]) -> int:
        """Send to all others in `places` (NED, m); return when it is through (ns), 0 if it cannot be sent."""
        for name in places:
            self._sending.setdefault(name, [])
        own = self._sending[sender]
        if len(payload) > self._modem.longest:
            self.counts["too_long"] += 1
            return 0
        if own and own[-1][1] > time_ns:
            self.counts["busy"] += 1
            return 0
        end_ns = time_ns + self._modem.airtime_ns(len(payload))
        own.append((time_ns, end_ns))
        self._number += 1
        self.counts["sent"] += 1
        for receiver, place in places.items():
            if receiver != sender:
                self._spread(time_ns, end_ns, sender, receiver, payload, places[sender], place)
        return end_ns

    def receive(self, time_ns: int) -> list[Packet]:
        """Return the messages whose last bit has come by now, in that order."""
        for arrival in sorted(self._arrivals):  # by their beginning: the first takes the receiver
            if arrival.direct and arrival.begin_ns <= time_ns and arrival.name not in self._outcomes:
                self._outcomes[arrival.name] = self._begin(arrival)
        over = [
            a for a in self._arrivals if a.end_ns <= time_ns and self._outcomes.get(a.name) == RECEIVED and a.direct
        ]
        judged = [self._judge(arrival) for arrival in sorted(over, key=_end)]
        self._remove_old(time_ns)
        return [packet for packet in judged if packet]

    def _spread(
        self, begin_ns: int, end_ns: int, sender: str, receiver: str, payload: bytes, source: Vector3, place: Vector3
    ) -> None:
        """Add an arrival with its time and power for each path of a message to one receiver."""
        modem, speed = self._modem, self._sound_speed(source, place)
        level = hypot(source[0] - place[0], source[1] - place[1])
        depth = max(self._depth, source[2], place[2])
        ways = paths(level, source[2], place[2], depth, modem.bounces)
        if self._rays is not None:
            ray = self._rays.between(level, source[2], place[2])
            if ray is None:
                del ways[0]
            elif ray.time > 0.0:
                speed = ray.length / ray.time
                ways[0] = Path(ray.length, 0, 0)
            if not ways:
                self.counts["shadowed"] += 1
        for path in ways:
            loss = transmission_loss(path.length, modem.frequency, modem.spreading)
            loss += path.surface * modem.surface_loss + path.bottom * modem.bottom_loss
            received = power(modem.source_level - loss)
            carries = path is ways[0]
            if received < _NEGLIGIBLE * self._noise and not carries:
                continue
            late = round(path.length / speed * NS)
            self._arrivals.append(
                _Arrival(
                    begin_ns + late, end_ns + late, sender, receiver, self._number, received, carries,
                    payload, begin_ns,
                )
            )  # fmt: skip

    def _begin(self, arrival: _Arrival) -> str:
        """Return what becomes of a message when its first bit arrives: RECEIVED, or why it is lost."""
        receiver, outcome = arrival.receiver, RECEIVED
        if 10.0 * log10(arrival.power / self._noise) < self._modem.detection:
            outcome = "too_weak"
        elif any(begin <= arrival.begin_ns < end for begin, end in self._sending.get(receiver, ())):
            outcome = "deaf"
        elif arrival.begin_ns < self._busy_until_ns.get(receiver, 0):
            outcome = "collided"
        if outcome == RECEIVED:
            self._busy_until_ns[receiver] = arrival.end_ns
        else:
            self.counts[outcome] += 1
        return outcome

    def _judge(self, arrival: _Arrival) -> Packet | None:
        """Return the packet, if it was received whole; otherwise why not is counted."""
        modem = self._modem
        disturbance = sum(
            other.power * _overlap(arrival, other)
            for other in self._arrivals
            if other.receiver == arrival.receiver and other is not arrival
        )
        ratio = arrival.power / (self._noise + disturbance)
        bit_error = 0.5 * exp(-0.5 * ratio * modem.bandwidth / modem.bit_rate)
        whole = (1.0 - bit_error) ** (8 * len(arrival.payload))
        outcome = "delivered" if self._random.random() < whole else "damaged"
        if any(begin < arrival.end_ns and arrival.begin_ns < end for begin, end in self._sending[arrival.receiver]):
            outcome = "deaf"  # it began to send meanwhile
        self.counts[outcome] += 1
        self._outcomes[arrival.name] = outcome
        if outcome != "delivered":
            return None
        seconds = (arrival.begin_ns - arrival.sent_ns) / NS
        distance = self._ranging.measure(seconds * modem.assumed_speed)
        snr = 10.0 * log10(ratio)
        return Packet(arrival.sender, arrival.receiver, arrival.payload, arrival.sent_ns, arrival.end_ns, snr, distance)

    def _sound_speed(self, source: Vector3, place: Vector3) -> float:
        """Return the speed of sound (m/s) half way between the two."""
        return self._column.sound_speed(0.5 * (source[2] + place[2])) if self._column else SOUND_SPEED

    def _remove_old(self, time_ns: int) -> None:
        """Drop what can neither be received nor disturb any more."""
        outcomes = self._outcomes
        awaited = [a.begin_ns for a in self._arrivals if a.direct and outcomes.get(a.name, RECEIVED) == RECEIVED]
        since = min(awaited, default=time_ns)
        self._arrivals = [a for a in self._arrivals if a.end_ns > since]
        names = {a.name for a in self._arrivals}
        self._outcomes = {name: outcome for name, outcome in outcomes.items() if name in names}
        for spans in self._sending.values():
            spans[:] = [span for span in spans if span[1] > since]


def _end(arrival: _Arrival) -> int:
    return arrival.end_ns


def _overlap(arrival: _Arrival, other: _Arrival) -> float:
    """Return the share of `arrival` during which `other` arrives too."""
    common = min(arrival.end_ns, other.end_ns) - max(arrival.begin_ns, other.begin_ns)
    return max(0, common) / max(arrival.end_ns - arrival.begin_ns, 1)
