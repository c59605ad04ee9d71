"""Optical modems on a shared channel: who receives a message, and which messages are lost.

The calls are those of `sim.modems.acoustic.AcousticChannel`, but for where vehicles are: light needs to know where they
look, too.
"""

from collections import Counter
from collections.abc import Mapping
from math import cos, log10, nan, pi, sin
from typing import NamedTuple

from hil.common.vectors import Quaternion, Vector3
from sim.modems.acoustic import Packet
from sim.modems.optical import OpticalModem, bit_error, packet_arrives, quality
from sim.rotations import rotate
from sim.sensors.error import sensor_random

HEADS = 4  # lamps with an eye each, evenly round a vehicle, the first one ahead
_UNSEEN = 0.4  # of the bits wrong: no light to speak of


class Pose(NamedTuple):
    """Position (NED, m) and attitude (body to world) of a vehicle."""

    position: Vector3
    orientation: Quaternion


class OpticalChannel:
    """The water between vehicles with four heads each: ahead, to starboard, astern, to port. Calls in order of time.

    A message goes out of all heads; the best pair of heads decides. `counts`: sent, delivered, and why not: busy (the
    sender itself was still sending), too_weak (no light), damaged. Not modelled: two lights at once in one eye, which
    takes a slot of time each to avoid, and what `bit_error` leaves out.
    """

    def __init__(self, modem: OpticalModem, seed: int) -> None:
        self._modem = modem
        self._random = sensor_random(seed, "optical_channel")
        self._through: dict[str, int] = {}  # by modem: when it has sent all
        self._in_flight: list[Packet] = []
        self.counts: Counter[str] = Counter()

    def send(self, time_ns: int, sender: str, payload: bytes, places: Mapping[str, Pose]) -> int:
        """Send to all others in `places`; return when it is through (ns), 0 if it cannot be sent."""
        if self._through.get(sender, 0) > time_ns:
            self.counts["busy"] += 1
            return 0
        end_ns = self._through[sender] = time_ns + self._modem.airtime_ns(len(payload))
        self.counts["sent"] += 1
        for receiver, place in places.items():
            if receiver != sender:
                self._judge(Packet(sender, receiver, payload, time_ns, end_ns, nan, nan), places[sender], place)
        return end_ns

    def receive(self, time_ns: int) -> list[Packet]:
        """Return the messages whose last bit has come by now, in that order."""
        there = [packet for packet in self._in_flight if packet.received_ns <= time_ns]
        self._in_flight = [packet for packet in self._in_flight if packet.received_ns > time_ns]
        return sorted(there, key=_arrival_ns)

    def _judge(self, packet: Packet, source: Pose, place: Pose) -> None:
        errors = min(
            bit_error(self._modem, source.position, ahead, place.position, axis)
            for ahead in _heads(source)
            for axis in _heads(place)
        )
        outcome = "damaged"
        if errors > _UNSEEN:
            outcome = "too_weak"
        elif packet_arrives(errors, len(packet.payload), self._random.random()):
            outcome = "delivered"
            self._in_flight.append(packet._replace(snr=20.0 * log10(quality(errors))))
        self.counts[outcome] += 1


def _heads(pose: Pose) -> list[Vector3]:
    """Return the directions of its heads: unit vectors, NED."""
    turns = [2.0 * pi * number / HEADS for number in range(HEADS)]
    return [rotate(pose.orientation, (cos(turn), sin(turn), 0.0)) for turn in turns]


def _arrival_ns(packet: Packet) -> int:
    return packet.received_ns
