"""Pairs of wires with injected faults, and a clock for them."""

import select
import socket
from contextlib import ExitStack

from hil.common.clock import NS_PER_S, now_ns
from hil.links.contract import Wire
from hil.links.wires.faults import Faults, FaultyWire
from hil.links.wires.terminal import DescriptorWire, PtyHostWire, PtyWire
from tests.support.links.can_pairs import socket_pair


class Clock:
    """A clock of the wires that only the test sets, in place of the machine's.

    It is an hour ahead of the machine's, so that no timer fires.
    """

    def __init__(self) -> None:
        self.now_ns = now_ns() + 3600 * NS_PER_S

    def __call__(self) -> int:
        return self.now_ns

    def advance(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS_PER_S)


def instant_pair(opened: ExitStack, faults: Faults = Faults(), seed: int = 1) -> tuple[Wire, FaultyWire]:
    """Return a wire without transmission time, with faults at the host's end."""
    device, host = socket.socketpair()
    for end in (device, host):
        end.setblocking(False)
    far = DescriptorWire(device.detach(), "device")
    near = FaultyWire(DescriptorWire(host.detach(), "host"), faults, seed)
    opened.callback(far.close)
    opened.callback(near.close)
    return far, near


def pty_pair(opened: ExitStack, faults: Faults) -> tuple[Wire, FaultyWire]:
    far = PtyWire()
    near = FaultyWire(PtyHostWire(far.path), faults)
    opened.callback(far.close)
    opened.callback(near.close)
    return far, near


def can_pair(opened: ExitStack, faults: Faults) -> tuple[Wire, FaultyWire]:
    far, host = socket_pair()
    near = FaultyWire(host, faults, seed=3)
    opened.callback(far.close)
    opened.callback(near.close)
    return far, near


def cross(sender: Wire, receiver: Wire, data: bytes) -> tuple[bytes, int]:
    """Send `data` at once and receive as much while serving both ends; return the received data and the time (ns)."""
    start, received, sent = now_ns(), b"", 0
    while len(received) < len(data):
        sent += sender.write(data[sent:])
        ready = select.select([sender, receiver], [], [], 30.0)[0]
        assert ready, "nothing is due any more"
        if sender in ready:
            assert sender.read() == b""
        if receiver in ready:
            received += receiver.read()
    return received, now_ns() - start
