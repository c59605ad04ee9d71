"""ArduPilot in the loop over its JSON interface: it sends servo packets and receives a vehicle state for each.

ArduPilot waits for each state and takes its time from it. In lockstep the simulation makes one step per packet. In real
time the simulation runs by the clock: the reply to a packet is the newest state if it has not been sent yet, else the
state of the next step.
"""

import socket
import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hil.autopilots.contract import ABSENT_NS, STALL_NS, Autopilot, AutopilotCounters, EstimateError, Outputs, Report
from hil.autopilots.inputs import SensorInputs
from hil.autopilots.json_packets import decode_servos, encode_state
from hil.common.clock import NS_PER_S, from_wall_ns, now_ns
from hil.common.errors import ConfigError, DeviceError
from hil.links.address import parse_address
from sim.rotations import rotate
from sim.sensors.samples import OdometrySample

if TYPE_CHECKING:
    from hil.autopilots.companion import Companion

LARGEST = 2048  # bytes of a datagram; a servo packet has 40 or 72
WRAP = 1 << 32
SO_TIMESTAMPNS = 35  # asm-generic/socket.h: the kernel adds its time of arrival to each datagram
TIMESPEC = struct.Struct("@qq")
ANCILLARY_SPACE = socket.CMSG_SPACE(TIMESPEC.size)
RESTART_BELOW = 2000  # a lower frame number than before, and below this one, is a restart

Sender = tuple[str, int]


class ArduPilot(Autopilot):
    """Connection to one ArduPilot, which sends to `address` (udp://host:port), where this object listens.

    `inputs`: sensors of its vehicle. `companion` sends positions to it, if given. Raises ConfigError, DeviceError.
    """

    def __init__(
        self, address: str, inputs: SensorInputs, lockstep: bool, report: Report, companion: "Companion | None" = None
    ) -> None:
        self.name = f"ArduPilot on {address}"
        self.lockstep = lockstep
        self.figures = AutopilotCounters()
        self.frame_rate = 0
        self._inputs, self._report, self._companion = inputs, report, companion
        self._socket = _listen(address)
        self._peer: Sender | None = None
        self._count = -1  # frame number of the last packet
        self._waiting = False  # it has sent a packet and waits for the state
        self._restarting = False
        self._epoch_ns = 0  # simulation time at which the autopilot's time is 0
        self._state = b""  # the newest state, empty once it has been sent
        self._received_ns = self._reported_ns = now_ns()
        self._other_senders: set[Sender] = set()

    def fileno(self) -> int:
        """Return the socket's descriptor; -1 after closing."""
        return self._socket.fileno()

    @property
    def connected(self) -> bool:
        """Return whether servo packets are received."""
        return self._peer is not None

    @property
    def estimate(self) -> EstimateError | None:
        """The error of its newest estimate, if a companion's port is connected."""
        return self._companion.estimate if self._companion else None

    def advance(self, time_ns: int, truth: OdometrySample) -> None:
        """Send the state if a packet is waiting for it, else store it for the next packet. Raises DeviceError."""
        if self._restarting:
            self._restarting, self._epoch_ns = False, time_ns
        self._state = self._encode_state(time_ns, truth)
        if self._waiting:
            self._send_state()
        if self._companion and self._peer:
            self._companion.advance(time_ns - self._epoch_ns, truth, self._peer[0])

    def receive(self, now: int) -> Outputs | None:
        """Return the newest outputs. Raises DeviceError."""
        newest, arrived_ns = None, now
        while True:
            try:
                packet, ancillary, _, sender = self._socket.recvmsg(LARGEST, ANCILLARY_SPACE)
            except (BlockingIOError, ConnectionRefusedError):  # refused: it had ended before the last state was sent
                break
            except OSError as error:
                raise DeviceError(f"{self.name}: {error.strerror or error}; start again") from None
            servos = decode_servos(packet)
            if servos is None:
                self.figures.malformed += 1
            elif self._is_peer(sender) and self._count_packet(servos.frame_count, now):
                self.frame_rate = servos.frame_rate
                newest, arrived_ns = servos, _arrival(ancillary, now)
        if newest is None:
            return None
        if not self.lockstep and self._state:
            self._send_state()
        return Outputs(newest.pwm_us, None, arrived_ns)

    def may_step(self) -> bool:
        """Return whether it waits for the next state, is not connected, or does not run in lockstep."""
        return self._waiting or self._peer is None or not self.lockstep

    def check(self, now: int) -> None:
        """Report if no autopilot has connected, or if it has stopped sending."""
        silent = now - self._received_ns
        if self._peer is not None and not self._waiting and silent > STALL_NS:
            self._peer, self._reported_ns = None, now
            self.figures.stalls += 1
            self._report(
                f"{self.name}: no servo packet for {silent / NS_PER_S:.1f} s after frame {self._count}: "
                "it has ended, or is stopped in a debugger; start it again"
            )
        elif self._peer is None and now - self._reported_ns > ABSENT_NS:
            self._reported_ns = now
            self._report(
                f"{self.name}: no servo packet yet: is ArduSub started with the options above? It may first wait for a "
                "ground station on TCP 5760 + 10 * instance"
            )

    def close(self) -> None:
        """Close the port."""
        self._socket.close()
        if self._companion:
            self._companion.close()

    def _is_peer(self, sender: Sender) -> bool:
        if self._peer is None:
            self._peer = sender
            self._report(f"{self.name}: receiving servo packets from port {sender[1]}")
        if sender == self._peer:
            return True
        if sender not in self._other_senders:
            self._other_senders.add(sender)
            self._report(
                f"{self.name}: a second autopilot sends from port {sender[1]} and is ignored: give each vehicle its "
                "own [autopilot] instance, and its autopilot the same -I"
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
            self._report(f"{self.name}: the frame number went back from {self._count} to {count}")
        else:
            self.figures.lost += step - 1
        self._count = count
        self.figures.outputs += 1
        return True

    def _send_state(self) -> None:
        state, self._state, self._waiting = self._state, b"", False
        if self._peer is None:
            return
        self.sent_ns = now_ns()  # before sending: the answer may be there when this process runs again
        try:
            self._socket.sendto(state, self._peer)
            self.figures.states += 1
        except (BlockingIOError, ConnectionRefusedError):  # ArduPilot sends its packet again
            self.figures.lost += 1
        except OSError as error:
            raise DeviceError(f"{self.name}: cannot send the state: {error.strerror or error}; start again") from None

    def _encode_state(self, time_ns: int, truth: OdometrySample) -> bytes:
        """Return the state for ArduPilot, which simulates its own GPS, compass and pressure sensor from it.

        Horizontal position, velocity and attitude are therefore true values. Depth is that of the pressure sensor if
        the vehicle has one.
        """
        inputs = self._inputs
        inputs.expire(time_ns)
        north, east, down = truth.position
        ranges = () if inputs.range_m is None else (inputs.range_m,)
        battery = () if inputs.battery is None else (inputs.battery.voltage, inputs.battery.current)
        return encode_state(
            (time_ns - self._epoch_ns) / NS_PER_S,
            inputs.gyro,
            inputs.acceleration,
            (north, east, inputs.depth if inputs.has["pressure"] else down),
            rotate(truth.orientation, truth.nu[:3]),
            truth.orientation,
            ranges,
            battery,
        )


def _listen(address: str) -> socket.socket:
    parsed = parse_address(address)
    if parsed.kind != "udp":
        raise ConfigError(f"[autopilot] address: {address!r}: ArduPilot's JSON interface is on udp://host:port")
    family = socket.AF_INET6 if ":" in parsed.target else socket.AF_INET
    opened = socket.socket(family, socket.SOCK_DGRAM)
    try:
        opened.bind((parsed.target, parsed.port))
    except OSError as error:
        opened.close()
        raise DeviceError(
            f"{address}: cannot listen for ArduPilot: {error.strerror}; stop the other simulator of this instance, "
            "or change [autopilot] instance"
        ) from None
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    return opened


def _arrival(ancillary: Sequence[tuple[int, int, bytes]], now: int) -> int:
    """Return the kernel's time of arrival of a datagram (monotonic ns); `now` if there is none."""
    for _, kind, data in ancillary:
        if kind == SO_TIMESTAMPNS and len(data) == TIMESPEC.size:
            seconds, nanoseconds = TIMESPEC.unpack(data)
            arrived = from_wall_ns(seconds * NS_PER_S + nanoseconds)
            return arrived if now - NS_PER_S < arrived <= now else now  # the wall clock may have been changed
    return now
