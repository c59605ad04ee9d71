"""One SeaTrac beacon: its settings, its periodic status, and what it answers at once."""

from struct import error, pack, unpack_from
from typing import Any

from hil.common.clock import NEVER_NS, NS_PER_MS, NS_PER_S
from hil.common.vectors import Quaternion
from hil.instruments.seatrac.messages import SETTINGS, USE_ATTITUDE, Cid, Cst, Place, Settings, attitude
from sim.rotations import from_euler

_X150, _X110 = 795, 843  # part numbers
_PERIODS_MS = (0, 1000, 400, 200, 100, 40)  # by mode of the status
_REBOOT = 0x6A95
_SUPPLY_MV = 12_000
_DECIDEGREE = 0.0017453292519943296


class Beacon:
    """A beacon. `memory` keeps its saved settings; `has_head` is true for an X150, which measures angles."""

    def __init__(self, memory: dict[str, Any], number: int, has_head: bool, now_ns: int) -> None:
        self._memory, self._default = memory, Settings(beacon=number)
        self.has_head = has_head
        self.queue = b""  # of data for the next request of the other
        self.reboot(now_ns)

    def reboot(self, now_ns: int) -> None:
        """Begin anew with the saved settings."""
        self.settings: Settings = self._memory.get("settings", self._default)
        self._began_ns = now_ns
        self.status_due_ns = now_ns
        self.busy_until_ns = 0

    @property
    def period_ns(self) -> int:
        """Period of the status; 0 if it comes on request only."""
        return _PERIODS_MS[self.settings.status_mode] * NS_PER_MS

    def is_status_due(self, now_ns: int) -> bool:
        """Return whether it is time for the status, and set the time of the next."""
        if not self.period_ns or now_ns < self.status_due_ns:
            return False
        self.status_due_ns += self.period_ns * (1 + (now_ns - self.status_due_ns) // self.period_ns)
        return True

    @property
    def next_ns(self) -> int:
        """Time of the next status."""
        return self.status_due_ns if self.period_ns else NEVER_NS

    def assumed(self, true: Quaternion) -> Quaternion:
        """Return the attitude with which positions are computed: its own, or the one that is set."""
        values = self.settings
        if values.flags & USE_ATTITUDE:
            return true
        return from_euler(*[_DECIDEGREE * value for value in (values.roll, values.pitch, values.yaw)])

    def status(self, here: Place, pressure: float, temperature: float, now_ns: int) -> bytes:
        """Return the status with the parts that are switched on; `pressure` in Pa, `temperature` in °C."""
        output = self.settings.status_output
        data = pack("<BBQ", Cid.STATUS, output, (now_ns - self._began_ns) // NS_PER_MS)
        if output & 1:
            environment = round(10.0 * temperature), round(pressure / 100.0), round(10.0 * here.depth)
            data += pack("<HhiiH", _SUPPLY_MV, *environment, round(10.0 * here.sound_speed))
        if output & 2:
            data += attitude(here.attitude)
        if output & 4:
            data += pack("<BBIB", 100, 1, (now_ns - self._began_ns) // NS_PER_S, 100)
        if output & 8:
            data += self.settings.calibration[:12]
        return data

    def answer(self, command: int, payload: bytes, now_ns: int) -> bytes | None:
        """Return the answer to a command that needs no sound; None to others."""
        if command == Cid.SYS_ALIVE:
            return pack("<BI", command, (now_ns - self._began_ns) // NS_PER_S)
        if command == Cid.SYS_INFO:
            firmware = pack("<BHBBHI", 1, 795, 2, 4, 2097, 0)
            hardware = pack("<HBIHH", _X150 if self.has_head else _X110, 4, 1000 + self.settings.beacon, 0, 0)
            seconds = (now_ns - self._began_ns) // NS_PER_S
            return pack("<BIB", command, seconds, 1) + hardware + firmware * 2 + b"\1"
        if command == Cid.SYS_REBOOT:
            is_right = payload == pack("<H", _REBOOT)
            if is_right:
                self.reboot(now_ns)
            return bytes((command, Cst.OK if is_right else Cst.PARAM_INVALID))
        if command == Cid.XCVR_STATUS:
            return bytes((command, Cst.REQUESTING if now_ns < self.busy_until_ns else Cst.IDLE))
        if command in (Cid.DAT_QUEUE_SET, Cid.DAT_QUEUE_CLR, Cid.DAT_QUEUE_STATUS):
            return self._change_queue(command, payload)
        return self._change_settings(command, payload, now_ns)

    def _change_queue(self, command: int, payload: bytes) -> bytes | None:
        """Carry out a command on the data that wait for the other's request; the destination is not told apart."""
        if command == Cid.DAT_QUEUE_SET:
            if len(payload) < 2 or len(payload) < 2 + payload[1] or payload[1] > 30:
                return bytes((command, Cst.PARAM_INVALID, 0, 0))
            self.queue = payload[2 : 2 + payload[1]]
            return bytes((command, Cst.OK, payload[0], len(self.queue)))
        destination = payload[0] if payload else 0
        if command == Cid.DAT_QUEUE_CLR:
            self.queue = b""
            return bytes((command, Cst.OK, destination))
        return bytes((command, destination, len(self.queue)))

    def _change_settings(self, command: int, payload: bytes, now_ns: int) -> bytes | None:
        values = self.settings
        if command == Cid.STATUS_CFG_GET:
            return bytes((command, values.status_output, values.status_mode))
        if command == Cid.SETTINGS_GET:
            return bytes((command,)) + SETTINGS.pack(*values)
        if command == Cid.SETTINGS_SAVE:
            self._memory["settings"] = values
            return bytes((command, Cst.OK))
        try:
            if command == Cid.STATUS_CFG_SET:
                output, mode = unpack_from("<BB", payload)
                wanted = values._replace(status_output=output, status_mode=mode)
            elif command == Cid.SETTINGS_SET:
                wanted = Settings(*SETTINGS.unpack(payload))
            elif command == Cid.SETTINGS_LOAD:
                wanted = self._memory.get("settings", self._default)
            elif command == Cid.SETTINGS_RESET:
                wanted = self._default
            else:
                return None
        except error:
            return bytes((command, Cst.PARAM_MISSING))
        if not wanted.is_valid():
            return bytes((command, Cst.PARAM_INVALID))
        self.settings, self.status_due_ns = wanted, now_ns
        return bytes((command, Cst.OK))
