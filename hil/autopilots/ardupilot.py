"""ArduPilot in the loop by its JSON interface: it sends servo packets, each is answered by the vehicle's state.

ArduPilot waits for every answer, so that its time is that of the answers. In lockstep the simulation in turn takes
one step a packet. In real time the simulation goes on by itself: a packet is answered at once with the newest state if
that is newer than the last answer, else by the next step.
"""

import socket
import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hil.autopilots.contract import ABSENT_NS, STALL_NS, Autopilot, Figures, Outputs, Report
from hil.autopilots.inputs import SensorInputs
from hil.autopilots.json_packets import JsonState, decode_servos, encode_state
from hil.common.clock import NS_PER_S, from_wall_ns, now_ns
from hil.common.errors import ConfigError, DeviceError
from hil.links.address import parse_address
from sim.rotations import rotate
from sim.sensors.samples import OdometrySample

if TYPE_CHECKING:
    from hil.autopilots.companion import Companion

LARGEST = 2048  # bytes of a datagram; a servo packet has 40 or 72
WRAP = 1 << 32
SO_TIMESTAMPNS = 35  # asm-generic/socket.h: the kernel's time of arrival comes with a datagram
TIMESPEC = struct.Struct("@qq")
ANCILLARY_SPACE = socket.CMSG_SPACE(TIMESPEC.size)
RESTART_BELOW = 2000  # frame numbers with which an autopilot that has just started may first be seen

Sender = tuple[str, int]


class ArduPilot(Autopilot):
    """One ArduPilot that sends to `address` (udp://host:port), where this listens.

    `inputs` are the sensors of its vehicle, `rc` constant pulse widths of a receiver. `companion` sends it positions,
    if any. Raises ConfigError, DeviceError.
    """

    def __init__(
        self, address: str, inputs: SensorInputs, lockstep: bool, rc: Sequence[int], report: Report,
        companion: "Companion | None" = None,
    ) -> None:  # fmt: skip
        self.name = f"ArduPilot on {address}"
        self.lockstep = lockstep
        self.figures = Figures()
        self.frame_rate = 0
        self._inputs, self._rc, self._report, self._companion = inputs, tuple(rc), report, companion
        self._socket = _listen(address)
        self._peer: Sender | None = None
        self._count = -1  # frame number of the last packet
        self._waiting = False  # it has sent a packet that is not answered
        self._restarting = False
        self._epoch_ns = 0  # simulation time that is 0 for this autopilot
        self._state = b""  # the newest, unless it has been sent
        self._received_ns = self._complained_ns = now_ns()
        self._other_senders: set[Sender] = set()

    def fileno(self) -> int:
        """Return the socket's descriptor; -1 once closed."""
        return self._socket.fileno()

    @property
    def connected(self) -> bool:
        """Return whether packets come."""
        return self._peer is not None

    def update_sensor(self, topic: str, sample: Any) -> None:
        """Take one sensor sample."""
        self._inputs.update(topic, sample)

    def advance(self, time_ns: int, truth: OdometrySample) -> None:
        """Answer the packet that waits; without one the state is stored for it. Raises DeviceError."""
        if self._restarting:
            self._restarting, self._epoch_ns = False, time_ns
        self._state = encode_state(self._state_of(time_ns, truth))
        if self._waiting:
            self._answer()
        if self._companion and self._peer:
            self._companion.advance(time_ns - self._epoch_ns, truth, self._peer[0])

    def receive(self, now: int) -> Outputs | None:
        """Return the newest outputs. Raises DeviceError."""
        newest, arrived_ns = None, now
        while True:
            try:
                packet, ancillary, _, sender = self._socket.recvmsg(LARGEST, ANCILLARY_SPACE)
            except (BlockingIOError, ConnectionRefusedError):  # refused: it had ended when it was answered
                break
            except OSError as error:
                raise DeviceError(f"{self.name}: {error.strerror or error}; start again") from None
            servos = decode_servos(packet)
            if servos is None:
                self.figures.malformed += 1
            elif self._is_peer(sender, now) and self._count_packet(servos.frame_count, now):
                self.frame_rate = servos.frame_rate
                newest, arrived_ns = servos, _arrival(ancillary, now)
        if newest is None:
            return None
        if not self.lockstep and self._state:
            self._answer()
        return Outputs(newest.pwm_us, None, arrived_ns)

    def may_step(self) -> bool:
        """Return whether it waits for the next state, or is not there."""
        return self._waiting or self._peer is None or not self.lockstep

    def check(self, now: int) -> None:
        """Report that nobody is there, or that it has stopped."""
        silent = now - self._received_ns
        if self._peer is not None and not self._waiting and silent > STALL_NS:
            self._peer, self._complained_ns = None, now
            self.figures.stalls += 1
            self._report(
                f"{self.name}: no servo packet for {silent / NS_PER_S:.1f} s after frame {self._count}: "
                "it has ended, or is stopped in a debugger"
            )
        elif self._peer is None and now - self._complained_ns > ABSENT_NS:
            self._complained_ns = now
            self._report(
                f"{self.name}: no servo packet yet: start ArduSub with --model JSON:127.0.0.1, and -I N for "
                "[autopilot] instance = N; it may wait for a ground station on TCP 5760 + 10 N first"
            )

    def close(self) -> None:
        """Close the port."""
        self._socket.close()
        if self._companion:
            self._companion.close()

    def _is_peer(self, sender: Sender, now: int) -> bool:
        if self._peer is None:
            self._peer = sender
            self._report(f"{self.name}: servo packets come from port {sender[1]}")
        if sender == self._peer:
            return True
        if sender not in self._other_senders:
            self._other_senders.add(sender)
            self._report(
                f"{self.name}: a second autopilot sends from port {sender[1]} and is ignored: give each vehicle an "
                "[autopilot] instance of its own, and its autopilot the same -I"
            )
        return False

    def _count_packet(self, count: int, now: int) -> bool:
        """Count one packet; return whether its outputs are new."""
        self._received_ns = now
        self._waiting = True
        step = (count - self._count) % WRAP
        if self._count >= 0 and step == 0:
            self.figures.duplicates += 1
            return False
        if self._count < 0:
            self._restarting = True
        elif step > WRAP // 2 and count < RESTART_BELOW:
            self._restarting = True
            self.figures.resets += 1
            self._report(f"{self.name}: the autopilot has restarted (frame {count} after {self._count})")
        elif step > WRAP // 2:
            self._report(f"{self.name}: frame numbers go back, from {self._count} to {count}")
        else:
            self.figures.lost += step - 1
        self._count = count
        self.figures.outputs += 1
        return True

    def _answer(self) -> None:
        state, self._state, self._waiting = self._state, b"", False
        if self._peer is None:
            return
        try:
            self._socket.sendto(state, self._peer)
            self.figures.states += 1
        except (BlockingIOError, ConnectionRefusedError):  # it asks again
            self.figures.lost += 1
        except OSError as error:
            raise DeviceError(f"{self.name}: cannot answer: {error.strerror or error}") from None

    def _state_of(self, time_ns: int, truth: OdometrySample) -> JsonState:
        """Return the state for ArduPilot, which makes its own GPS and compass of it.

        So position on the level, velocity and attitude are the truth. Depth is that of the pressure sensor, if there is
        one: ArduPilot makes its water pressure of it.
        """
        inputs = self._inputs
        north, east, down = truth.position
        ranges = () if inputs.range_m is None else (inputs.range_m,)
        battery = () if inputs.battery is None else (inputs.battery.voltage, inputs.battery.current)
        return JsonState(
            (time_ns - self._epoch_ns) / NS_PER_S,
            inputs.gyro,
            inputs.acceleration,
            (north, east, inputs.depth if inputs.has["pressure"] else down),
            rotate(truth.orientation, truth.nu[:3]),
            truth.orientation,
            ranges,
            self._rc,
            battery,
        )


def _listen(address: str) -> socket.socket:
    parsed = parse_address(address)
    if parsed.kind != "udp":
        raise ConfigError(f"[autopilot] address: {address!r}: ArduPilot's JSON interface is on udp://host:port")
    family = socket.AF_INET6 if ":" in parsed.place else socket.AF_INET
    opened = socket.socket(family, socket.SOCK_DGRAM)
    try:
        opened.bind((parsed.place, parsed.port))
    except OSError as error:
        opened.close()
        raise DeviceError(
            f"{address}: cannot listen for ArduPilot: {error.strerror}; another simulator of this instance runs, "
            "or give [autopilot] instance another number"
        ) from None
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    return opened


def _arrival(ancillary: Sequence[tuple[int, int, bytes]], now: int) -> int:
    """Return when (monotonic ns) a datagram arrived, as the kernel recorded it; `now` where it did not."""
    for _, kind, data in ancillary:
        if kind == SO_TIMESTAMPNS and len(data) == TIMESPEC.size:
            seconds, nanoseconds = TIMESPEC.unpack(data)
            arrived = from_wall_ns(seconds * NS_PER_S + nanoseconds)
            return arrived if now - NS_PER_S < arrived <= now else now  # the wall clock may have been set
    return now
