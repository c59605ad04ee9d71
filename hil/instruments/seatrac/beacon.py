"""One SeaTrac beacon: its settings, its periodic status, and what it answers at once."""

from math import radians
from struct import error, pack, unpack
from typing import Any

from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S
from hil.common.vectors import Quaternion
from hil.instruments.seatrac.messages import SETTINGS, SUPPLY_MV, USE_ATTITUDE, Cid, Cst, Place, Settings, attitude
from sim.rotations import from_euler

_X150, _X110 = 795, 843  # part numbers
_PERIODS_MS = (0, 1000, 400, 200, 100, 40)  # by mode of the status; 0: on request only
_REBOOT = b"\x95\x6a"
_MOST_QUEUED = 30  # bytes


class Beacon:
    """The beacon of an end. `memory` keeps its saved settings; `has_head` is true for an X150, which measures angles.

    `queue` are the data for the next request of the other.
    """

    def __init__(self, end: str, memory: dict[str, Any], number: int, has_head: bool) -> None:
        self._memory, self._default = memory, Settings(beacon=number)
        self.end, self.has_head = end, has_head
        self.queue = b""
        self.reboot(0)

    def reboot(self, now_ns: int) -> None:
        """Begin again with the saved settings."""
        self._began_ns, self.busy_until_ns = now_ns, 0
        self._apply(self._memory.get("settings", self._default), now_ns)

    def _apply(self, settings: Settings, now_ns: int) -> None:
        self.settings = settings
        self.status_due_ns = now_ns if settings.status_mode else NEVER_NS

    def is_status_due(self, now_ns: int) -> bool:
        """Return whether it is time for the status, and set the time of the next."""
        if now_ns < self.status_due_ns:
            return False
        period_ns = _PERIODS_MS[self.settings.status_mode] * NS_PER_MS
        self.status_due_ns += period_ns * (1 + (now_ns - self.status_due_ns) // period_ns)
        return True

    def assumed(self, true: Quaternion) -> Quaternion:
        """Return the attitude with which positions are computed: its own, or the one that is set."""
        values = self.settings
        if values.flags & USE_ATTITUDE:
            return true
        return from_euler(*[radians(0.1 * value) for value in (values.roll, values.pitch, values.yaw)])

    def status(self, here: Place, pressure: float, temperature: float, now_ns: int) -> bytes:
        """Return the status with the parts that are switched on; `pressure` in Pa, `temperature` in °C."""
        output = self.settings.status_output
        data = pack("<BBQ", Cid.STATUS, output, (now_ns - self._began_ns) // NS_PER_MS)
        if output & 1:
            environment = round(10.0 * temperature), round(pressure / 100.0), round(10.0 * here.depth)
            data += pack("<HhiiH", SUPPLY_MV, *environment, round(10.0 * here.sound_speed))
        if output & 2:
            data += attitude(here.attitude)
        if output & 4:
            data += pack("<BBIB", 100, 1, self._seconds(now_ns), 100)
        if output & 8:
            data += self.settings.calibration[:12]
        return data

    def _seconds(self, now_ns: int) -> int:
        return (now_ns - self._began_ns) // NS_PER_S

    def answer(self, command: int, payload: bytes, now_ns: int) -> bytes | None:
        """Return the answer to a command that needs no sound; None to others."""
        values = self.settings
        data: bytes | None = None
        if command == Cid.SYS_ALIVE:
            data = pack("<I", self._seconds(now_ns))
        elif command == Cid.SYS_INFO:
            part = _X150 if self.has_head else _X110
            data = pack("<IBHBIHH", self._seconds(now_ns), 1, part, 4, 1000 + values.beacon, 0, 0)
            data += pack("<BHBBHI", 1, 795, 2, 4, 2097, 0) * 2 + b"\1"  # firmware of both processors
        elif command == Cid.SYS_REBOOT:
            data = bytes((Cst.OK if payload == _REBOOT else Cst.PARAM_INVALID,))
            if payload == _REBOOT:
                self.reboot(now_ns)
        elif command == Cid.XCVR_STATUS:
            data = bytes((Cst.REQUESTING if now_ns < self.busy_until_ns else Cst.IDLE,))
        elif command == Cid.STATUS_CFG_GET:
            data = bytes((values.status_output, values.status_mode))
        elif command == Cid.SETTINGS_GET:
            data = SETTINGS.pack(*values)
        elif command == Cid.SETTINGS_SAVE:
            self._memory["settings"], data = values, bytes((Cst.OK,))
        elif command in (Cid.STATUS_CFG_SET, Cid.SETTINGS_SET, Cid.SETTINGS_LOAD, Cid.SETTINGS_RESET):
            data = bytes((self._change_settings(command, payload, now_ns),))
        elif command in (Cid.DAT_QUEUE_SET, Cid.DAT_QUEUE_CLR, Cid.DAT_QUEUE_STATUS):
            data = self._change_queue(command, payload)
        return None if data is None else bytes((command,)) + data

    def _change_queue(self, command: int, payload: bytes) -> bytes:
        """Carry out a command on the data that wait for the other's request; the destination is not told apart."""
        destination = payload[0] if payload else 0
        if command == Cid.DAT_QUEUE_STATUS:
            return bytes((destination, len(self.queue)))
        if command == Cid.DAT_QUEUE_CLR:
            self.queue = b""
            return bytes((Cst.OK, destination))
        if len(payload) < 2 or len(payload) < 2 + payload[1] or payload[1] > _MOST_QUEUED:
            return bytes((Cst.PARAM_INVALID, 0, 0))
        self.queue = payload[2 : 2 + payload[1]]
        return bytes((Cst.OK, destination, len(self.queue)))

    def _change_settings(self, command: int, payload: bytes, now_ns: int) -> Cst:
        wanted = self._default
        try:
            if command == Cid.STATUS_CFG_SET:
                output, mode = unpack("<BB", payload[:2])
                wanted = self.settings._replace(status_output=output, status_mode=mode)
            elif command == Cid.SETTINGS_SET:
                wanted = Settings(*SETTINGS.unpack(payload))
            elif command == Cid.SETTINGS_LOAD:
                wanted = self._memory.get("settings", wanted)
        except error:
            return Cst.PARAM_MISSING
        if not wanted.is_valid():
            return Cst.PARAM_INVALID
        self._apply(wanted, now_ns)
        return Cst.OK
