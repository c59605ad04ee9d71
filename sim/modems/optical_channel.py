"""Optical modems on a shared channel: who receives a message, and which messages are lost.

The interface is that of `sim.modems.acoustic.AcousticChannel`, except that `send` needs the attitude of the vehicles,
too.
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

HEADS = 4  # lamps with a detector each, evenly around a vehicle, the first one ahead
_UNDETECTED = 0.4  # bit error rate above which the light is not detected


class Pose(NamedTuple):
    """Position (NED, m) and attitude (body to world) of a vehicle."""

    position: Vector3
    orientation: Quaternion


class OpticalChannel:
    """The water between vehicles with four heads each: ahead, to starboard, astern, to port.

    Calls must come in the order of time. All heads send a message; the best pair of heads decides. `counts` has the
    numbers of messages sent and delivered, and of lost ones by cause: busy (the sender was still sending), too_weak (no
    light), damaged. Not modelled: interference of two lamps in one detector, which time slots avoid, and the effects
    that `bit_error` does not model.
    """

    def __init__(self, modem: OpticalModem, seed: int) -> None:
        self._modem = modem
        self._random = sensor_random(seed, "optical_channel")
        self._busy_until_ns: dict[str, int] = {}  # by modem: end of its transmission
        self._in_flight: list[Packet] = []
        self.counts: Counter[str] = Counter()

    def send(self, time_ns: int, sender: str, payload: bytes, poses: Mapping[str, Pose]) -> int:
        """Send to all other modems in `poses`; return the end of transmission (ns), 0 if not sent."""
        if self._busy_until_ns.get(sender, 0) > time_ns:
            self.counts["busy"] += 1
            return 0
        end_ns = self._busy_until_ns[sender] = time_ns + self._modem.airtime_ns(len(payload))
        self.counts["sent"] += 1
        for receiver, pose in poses.items():
            if receiver != sender:
                self._transmit(Packet(sender, receiver, payload, time_ns, end_ns, nan, nan), poses[sender], pose)
        return end_ns

    def receive(self, time_ns: int) -> list[Packet]:
        """Return the messages whose last bit has arrived by now, in order of arrival."""
        arrived = [packet for packet in self._in_flight if packet.received_ns <= time_ns]
        self._in_flight = [packet for packet in self._in_flight if packet.received_ns > time_ns]
        return sorted(arrived, key=_arrival_ns)

    def _transmit(self, packet: Packet, source: Pose, receiver: Pose) -> None:
        """Decide whether a packet arrives, and count the outcome."""
        errors = min(
            bit_error(self._modem, source.position, ahead, receiver.position, axis)
            for ahead in _heads(source)
            for axis in _heads(receiver)
        )
        outcome = "damaged"
        if errors > _UNDETECTED:
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
