"""Positions by USBL between the vehicles of a fleet: a head interrogates the other modems in turn, and they reply.

A vehicle with a head measures where the reply comes from: its range by travel time, its direction by the phase at an
array. The result is relative to the head, in axes of north, east and down, as of a head that is levelled by its own
attitude sensor. Interrogations and replies of two bytes use the channel as any message: they are lost, and collide.
Not modelled: errors of the head's attitude, directions bent by a profile of the speed of sound.
"""

from collections.abc import Mapping, Sequence
from math import sqrt
from typing import NamedTuple

from hil.common.vectors import Vector3
from sim.modems.acoustic import AcousticChannel, Packet
from sim.sensors.error import ErrorModel, ErrorProcess, sensor_random, variance
from sim.sensors.samples import Covariance
from sim.sensors.usbl import position_covariance, rotate_direction

_ASK, _REPLY = 0xF0, 0xF1  # first of two bytes; no report of a fleet has two


class UsblFix(NamedTuple):
    """Where `receiver` found `sender`, which replied at `sent_ns`: NED from the receiver (m), with covariance (m²)."""

    receiver: str
    sender: str
    sent_ns: int
    offset: Vector3
    covariance: Covariance


class UsblRounds:
    """The interrogations of `heads`, each every `period_ns`, of all `nodes` in turn over `channel`.

    `angle` is the error of a direction (rad, about each of two axes), `range_error` that of the channel's modems.
    """

    def __init__(
        self, channel: AcousticChannel, heads: Sequence[str], nodes: Sequence[str], period_ns: int,
        angle: ErrorModel, range_error: ErrorModel, seed: int,
    ) -> None:  # fmt: skip
        self._channel, self._nodes, self._period_ns = channel, list(nodes), period_ns
        self._turns = {head: [node for node in nodes if node != head] for head in heads}
        self._due_ns = {head: (i + 1) * period_ns // (len(heads) + 1) for i, head in enumerate(heads)}
        self._angles = [ErrorProcess(angle, period_ns * 1e-9, sensor_random(seed, f"usbl/{axis}")) for axis in (0, 1)]
        self._range_error, self._angle_variance = range_error, variance(angle, period_ns * 1e-9)
        self._replied: dict[str, Vector3] = {}  # position of each vehicle at its last reply

    def ask(self, time_ns: int, positions: Mapping[str, Vector3]) -> None:
        """Send the interrogations that are due; `positions` (m, NED) are those of all vehicles that have one."""
        for head, turns in self._turns.items():
            if time_ns < self._due_ns[head] or head not in positions or not turns:
                continue
            self._due_ns[head] = time_ns + self._period_ns
            turns.append(turns.pop(0))
            self._channel.send(time_ns, head, bytes((_ASK, self._nodes.index(turns[-1]))), positions)

    def take(
        self, time_ns: int, packets: Sequence[Packet], positions: Mapping[str, Vector3]
    ) -> tuple[list[Packet], list[UsblFix]]:
        """Answer the interrogations among `packets`; return the other messages, and the positions measured."""
        others, fixes = [], []
        for packet in packets:
            kind, number = packet.payload if len(packet.payload) == 2 else (0, 0)
            if kind not in (_ASK, _REPLY):
                others.append(packet)
            elif number >= len(self._nodes) or packet.receiver != self._nodes[number]:
                continue  # for another one
            elif kind == _ASK and packet.sender in self._nodes:
                self._replied[packet.receiver] = positions[packet.receiver]
                reply = bytes((_REPLY, self._nodes.index(packet.sender)))
                self._channel.send(time_ns, packet.receiver, reply, positions)
            elif packet.sender in self._replied:
                fixes.append(self._measure(packet, self._replied[packet.sender], positions[packet.receiver]))
        return others, fixes

    def _measure(self, packet: Packet, source: Vector3, head: Vector3) -> UsblFix:
        north, east, down = (a - b for a, b in zip(source, head, strict=True))
        size = sqrt(north * north + east * east + down * down)
        line = (north / size, east / size, down / size) if size else (0.0, 0.0, 1.0)
        down, starboard = (process.measure(0.0) for process in self._angles)
        x, y, z = rotate_direction(line, down, starboard)
        along = variance(self._range_error, self._period_ns * 1e-9, size)
        covariance = position_covariance(line, along, self._angle_variance * size * size)
        measured = packet.distance
        return UsblFix(
            packet.receiver, packet.sender, packet.sent_ns, (measured * x, measured * y, measured * z), covariance
        )
