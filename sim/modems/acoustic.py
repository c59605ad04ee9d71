"""Acoustic modems on a shared channel: who receives a message, when, and which messages are lost.

A message needs its transmission time and its propagation time. While a modem sends, it cannot receive; while it
receives one message, it loses any other (collision), which also adds noise to the first. Whether a message arrives
without bit errors is drawn at random from its signal-to-noise ratio. Time is an argument of each call; the same seed
and the same calls give the same losses.
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
RECEIVED = "received"  # the outcome of a message that has not been lost so far
_NEGLIGIBLE = 1e-3  # of the noise: weaker arrivals are ignored


class AcousticModem(NamedTuple):
    """A modem and the sea around it. The defaults are Newcastle University's Nanomodem V3 (its published table).

    `frequency` and `bandwidth` are in Hz, `bit_rate` in bit/s, `source_level` in dB re 1 uPa at 1 m, `longest` is the
    greatest message in bytes. Our assumptions, not from the table: `overhead` (s) before the first bit (a chirp for
    detection, the header), and `detection`, the signal-to-noise ratio (dB) below which a message is not detected. Of
    the sea: `spreading` (1 cylindrical to 2 spherical), `wind` (m/s), `shipping` (0 to 1). Echoes with up to `bounces`
    reflections at surface and bottom are received, too; each reflection loses `surface_loss` or `bottom_loss` dB.
    `range_error` is the error of a distance (m), measured with `assumed_speed` (m/s).
    """

    frequency: Annotated[float, Range(1e3, 1e6, "Hz")] = 28_000.0
    bandwidth: Annotated[float, Range(100.0, 1e6, "Hz")] = 8_000.0
    bit_rate: Annotated[float, Range(1.0, 1e6, "bit/s")] = 640.0
    source_level: Annotated[float, Range(100.0, 230.0, "dB")] = 168.0
    longest: Annotated[int, Range(1, 4096)] = 64
    overhead: Annotated[float, Range(0.0, 5.0, "s")] = 0.03
    detection: Annotated[float, Range(-30.0, 30.0, "dB")] = -6.0
    spreading: Annotated[float, Range(1.0, 2.0)] = 1.5
    wind: Annotated[float, Range(0.0, 40.0, "m/s")] = 5.0
    shipping: Annotated[float, Range(0.0, 1.0)] = 0.5
    bounces: Annotated[int, Range(0, 8)] = 0
    surface_loss: Annotated[float, Range(0.0, 60.0, "dB")] = 1.0
    bottom_loss: Annotated[float, Range(0.0, 60.0, "dB")] = 6.0
    range_error: ErrorModel = ErrorModel(noise=0.1, resolution=0.047)
    assumed_speed: Annotated[float, Range(1300.0, 1700.0, "m/s")] = 1500.0

    def airtime_ns(self, size: int) -> int:
        """Return the transmission time (ns) of a message of `size` bytes."""
        return round((self.overhead + 8 * size / self.bit_rate) * NS)


class Packet(NamedTuple):
    """A message that was received.

    `sent_ns` is the time at which its sender began, `received_ns` that at which its last bit arrived. `snr` (dB) is the
    ratio of signal to noise and interference. `distance` (m) is that measured by synchronised clocks, with errors.
    """

    sender: str
    receiver: str
    payload: bytes
    sent_ns: int
    received_ns: int
    snr: float
    distance: float


class _Arrival(NamedTuple):
    """The arrival of one message at one receiver along one path: begin and end (ns), power relative to 1 uPa."""

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

    `counts` has the numbers of messages sent and delivered, and of lost ones by cause: busy (the sender was still
    sending), too_long, too_weak, shadowed (no sound ray reaches the receiver), deaf (the receiver was sending),
    collided (with another message), damaged (bit errors).

    If the profile of `column` bends the rays (seawater/sound_rays.py), time and length of the direct path are those of
    the ray. Echoes are straight, at the mean speed of the direct path; in a shadow the shortest echo carries the
    message.

    Vehicles do not move while a message is on its way; at 2 m/s over 1500 m this neglects 2 m. Bit errors are those of
    noncoherent orthogonal signals, ½ exp(-Eb / 2 N0) (Proakis, Digital Communications), without error correction. Not
    modelled: Doppler, fading, directivity, obstacles.
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
        self._sending: dict[str, list[tuple[int, int]]] = {}  # by modem: begin and end of its transmissions
        self._arrivals: list[_Arrival] = []  # not yet decided, or may still interfere with others
        self._outcomes: dict[tuple[int, str], str] = {}  # of each message at each receiver, so far
        self._busy_until_ns: dict[str, int] = {}  # by modem: end of the message that it receives
        self._number = 0
        self.counts: Counter[str] = Counter()

    def send(self, time_ns: int, sender: str, payload: bytes, positions: Mapping[str, Vector3]) -> int:
        """Send to all other modems in `positions` (NED, m); return the end of transmission (ns), 0 if not sent."""
        for name in positions:
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
        for receiver, position in positions.items():
            if receiver != sender:
                self._add_arrivals(time_ns, end_ns, sender, receiver, payload, positions[sender], position)
        return end_ns

    def receive(self, time_ns: int) -> list[Packet]:
        """Return the messages whose last bit has arrived by now, in order of arrival."""
        for arrival in sorted(self._arrivals):  # by their beginning: the first one occupies the receiver
            if arrival.direct and arrival.begin_ns <= time_ns and arrival.name not in self._outcomes:
                self._outcomes[arrival.name] = self._begin(arrival)
        ended = [
            a for a in self._arrivals if a.end_ns <= time_ns and self._outcomes.get(a.name) == RECEIVED and a.direct
        ]
        packets = [self._finish(arrival) for arrival in sorted(ended, key=_end)]
        self._remove_old(time_ns)
        return [packet for packet in packets if packet]

    def _add_arrivals(
        self, begin_ns: int, end_ns: int, sender: str, receiver: str, payload: bytes, source: Vector3, position: Vector3
    ) -> None:
        """Add an arrival for each path of a message from `source` to the receiver at `position`."""
        modem, speed = self._modem, self._sound_speed(source, position)
        level = hypot(source[0] - position[0], source[1] - position[1])
        depth = max(self._depth, source[2], position[2])
        all_paths = paths(level, source[2], position[2], depth, modem.bounces)
        if self._rays is not None:
            ray = self._rays.between(level, source[2], position[2])
            if ray is None:
                del all_paths[0]
            elif ray.time > 0.0:
                speed = ray.length / ray.time
                all_paths[0] = Path(ray.length, 0, 0)
            if not all_paths:
                self.counts["shadowed"] += 1
        for path in all_paths:
            loss = transmission_loss(path.length, modem.frequency, modem.spreading)
            loss += path.surface * modem.surface_loss + path.bottom * modem.bottom_loss
            received = power(modem.source_level - loss)
            is_direct = path is all_paths[0]
            if received < _NEGLIGIBLE * self._noise and not is_direct:
                continue
            delay = round(path.length / speed * NS)
            self._arrivals.append(
                _Arrival(
                    begin_ns + delay, end_ns + delay, sender, receiver, self._number, received, is_direct,
                    payload, begin_ns,
                )
            )  # fmt: skip

    def _begin(self, arrival: _Arrival) -> str:
        """Return the outcome for a message whose first bit arrives: RECEIVED, or the cause of its loss."""
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

    def _finish(self, arrival: _Arrival) -> Packet | None:
        """Return the packet of a message whose last bit has arrived; if it is lost, count the cause and return None."""
        modem = self._modem
        interference = sum(
            other.power * _overlap(arrival, other)
            for other in self._arrivals
            if other.receiver == arrival.receiver and other is not arrival
        )
        ratio = arrival.power / (self._noise + interference)
        bit_error = 0.5 * exp(-0.5 * ratio * modem.bandwidth / modem.bit_rate)
        probability = (1.0 - bit_error) ** (8 * len(arrival.payload))  # of no bit error
        outcome = "delivered" if self._random.random() < probability else "damaged"
        if any(begin < arrival.end_ns and arrival.begin_ns < end for begin, end in self._sending[arrival.receiver]):
            outcome = "deaf"  # the receiver began to send during the message
        self.counts[outcome] += 1
        self._outcomes[arrival.name] = outcome
        if outcome != "delivered":
            return None
        seconds = (arrival.begin_ns - arrival.sent_ns) / NS
        distance = self._ranging.measure(seconds * modem.assumed_speed)
        snr = 10.0 * log10(ratio)
        return Packet(arrival.sender, arrival.receiver, arrival.payload, arrival.sent_ns, arrival.end_ns, snr, distance)

    def _sound_speed(self, source: Vector3, position: Vector3) -> float:
        """Return the speed of sound (m/s) at the mean depth of two positions."""
        return self._column.sound_speed(0.5 * (source[2] + position[2])) if self._column else SOUND_SPEED

    def _remove_old(self, time_ns: int) -> None:
        """Remove arrivals and transmissions that can neither be received nor interfere any more."""
        outcomes = self._outcomes
        pending = [a.begin_ns for a in self._arrivals if a.direct and outcomes.get(a.name, RECEIVED) == RECEIVED]
        since = min(pending, default=time_ns)
        self._arrivals = [a for a in self._arrivals if a.end_ns > since]
        names = {a.name for a in self._arrivals}
        self._outcomes = {name: outcome for name, outcome in outcomes.items() if name in names}
        for spans in self._sending.values():
            spans[:] = [span for span in spans if span[1] > since]


def _end(arrival: _Arrival) -> int:
    return arrival.end_ns


def _overlap(arrival: _Arrival, other: _Arrival) -> float:
    """Return the share of the duration of `arrival` during which `other` also arrives."""
    common = min(arrival.end_ns, other.end_ns) - max(arrival.begin_ns, other.begin_ns)
    return max(0, common) / max(arrival.end_ns - arrival.begin_ns, 1)
