"""The configuration of a receiver: values by their keys, and the older messages that set the same values.

Source: u-blox M9 SPG 4.04 interface description (UBX-21022436), chapters 3.10 and 5. A key's bits 28 to 30 are the size
of its value. What lies in RAM is lost without power; what was also set in the battery-backed or the flash layer is not.
"""

import struct
from struct import pack, unpack, unpack_from

RAM, BACKUP, FLASH = 1, 2, 4
MEASUREMENT_MS, NAVIGATION_RATE, _DYNAMIC_MODEL, BAUD = 0x30210001, 0x30210002, 0x20110021, 0x40520001
OUT_UBX, OUT_NMEA = 0x10740001, 0x10740002
_TIME_REFERENCE = 0x20210003
_MASKS = ((0x10730001, 1), (0x10730002, 2), (0x10730004, 32), (OUT_UBX, 1), (OUT_NMEA, 2), (0x10740004, 32))
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8}
_FASTEST_MS = 40  # 25 Hz
_PORTS = 5  # I2C, UART1, UART2, USB, SPI: a message has one key each, in this order
UART1 = 1
NMEA = 0xF0

# Class and number of a message -> the first of its five keys.
RATES = {
    (0x01, 0x02): 0x20910029, (0x01, 0x03): 0x2091001A, (0x01, 0x04): 0x20910038, (0x01, 0x07): 0x20910006,
    (0x01, 0x12): 0x20910042, (0x01, 0x20): 0x20910047, (0x01, 0x35): 0x20910015, (0x01, 0x61): 0x2091015F,
    (0x0A, 0x09): 0x209101B4, (0x0A, 0x0B): 0x209101B9,
    (NMEA, 0x00): 0x209100BA, (NMEA, 0x01): 0x209100C9, (NMEA, 0x02): 0x209100BF, (NMEA, 0x03): 0x209100C4,
    (NMEA, 0x04): 0x209100AB, (NMEA, 0x05): 0x209100B0, (NMEA, 0x07): 0x209100D3, (NMEA, 0x08): 0x209100D8,
}  # fmt: skip
_DEFAULT_SENTENCES = range(6)
# Groups of an M9's keys (bits 16 to 27), whose other values are kept without an effect: time pulse, navigation,
# odometer, signals, ports, messages, hardware, power. There are none for a fixed base or for corrections.
_KEPT = {0x05, 0x11, 0x22, 0x23, 0x24, 0x25, 0x31, 0x36, 0x37, 0x41, 0x51, 0x52, 0x53, 0x64, 0x65, *range(0x71, 0x7B)}
_KEPT |= {0x91, 0x92, 0x93, 0xA2, 0xA3, 0xC7, 0xD0, 0xDE}
GNSS = 0x3E
# Number of a message of the class CFG -> its record as delivered: SBAS, the protocol's version, systems, time pulse.
RECORDS = {
    0x16: pack("<4BI", 1, 7, 3, 0, 0), 0x17: pack("<4B16x", 0, 0x4B, 0, 2),
    GNSS: pack("<4B4BI", 0, 42, 42, 1, 0, 8, 16, 0, 0x00010001),
    0x31: pack("<BBHhhIIIIiI", 0, 1, 0, 50, 0, 1_000_000, 1_000_000, 0, 100_000, 0, 0xF7),
}  # fmt: skip


def defaults() -> dict[int, int]:
    """Return all keys with their values as delivered: 1 Hz, the six common sentences, no binary message."""
    values = {MEASUREMENT_MS: 1000, NAVIGATION_RATE: 1, _TIME_REFERENCE: 1, _DYNAMIC_MODEL: 0, BAUD: 38_400}
    values |= {key: 1 for key, _ in _MASKS} | {0x10740004: 0}
    for (group, number), first in RATES.items():
        rate = int(group == NMEA and number in _DEFAULT_SENTENCES)
        values |= {first + port: rate for port in range(_PORTS)}
    return values


class Configuration:
    """Values by key; `memory` keeps those of the layers that outlive the power."""

    def __init__(self, memory: dict[int, int]) -> None:
        self._memory = memory
        self.values = defaults() | memory
        self._records = dict(RECORDS)

    def rate(self, group: int, number: int) -> int:
        """Return in how many epochs a message is sent once; 0 for never."""
        return self.values[RATES[group, number] + UART1]

    def set_values(self, layers: int, pairs: dict[int, int]) -> bool:
        """Set values; none at all if one is of no known group or out of range."""
        if any(key not in self.values and key >> 16 & 0xFFF not in _KEPT for key in pairs) or not layers & 7:
            return False
        if pairs.get(MEASUREMENT_MS, _FASTEST_MS) < _FASTEST_MS or pairs.get(NAVIGATION_RATE, 1) < 1:
            return False
        if layers & RAM:
            self.values |= pairs
        if layers & (BACKUP | FLASH):
            self._memory |= pairs
        return True

    def valset(self, payload: bytes) -> bool:
        """Carry out CFG-VALSET."""
        pairs, at = {}, 4
        try:
            while at < len(payload):
                (key,) = unpack_from("<I", payload, at)
                size = _SIZES[key >> 28 & 7]
                if at + 4 + size > len(payload):
                    return False
                pairs[key] = int.from_bytes(payload[at + 4 : at + 4 + size], "little")
                at += 4 + size
        except (struct.error, KeyError):
            return False
        return bool(pairs) and self.set_values(payload[1], pairs)

    def valget(self, payload: bytes) -> bytes | None:
        """Return the answer to CFG-VALGET; None if it asks for a key that there is not."""
        if len(payload) < 8 or len(payload) % 4:
            return None
        layer, position = payload[1], int.from_bytes(payload[2:4], "little")
        source = {0: self.values, 1: self._memory, 2: self._memory, 7: defaults()}.get(layer)
        if source is None:
            return None
        keys: list[int] = []
        for asked in unpack(f"<{len(payload) // 4 - 1}I", payload[4:]):
            group = asked & 0x0FFF0000
            is_group = asked & 0xFFFF == 0xFFFF
            found = [key for key in source if key == asked or (is_group and group in (key & 0x0FFF0000, 0x0FFF0000))]
            if not found:
                return None
            keys += found
        keys = keys[position : position + 64]
        pairs = [pack("<I", key) + source[key].to_bytes(_SIZES[key >> 28 & 7], "little") for key in keys]
        return bytes((1,)) + payload[1:4] + b"".join(pairs)

    def message_rate(self, payload: bytes) -> bytes | bool:
        """Carry out CFG-MSG; return the rates if it asks for them."""
        first = RATES.get((payload[0], payload[1])) if len(payload) in (2, 3, 8) else None
        if first is None:
            return False
        if len(payload) == 2:
            return payload + bytes([self.values[first + port] for port in range(_PORTS)]) + b"\0"
        if len(payload) == 3:
            return self.set_values(RAM, {first + UART1: payload[2]})
        return self.set_values(RAM, {first + port: payload[2 + port] for port in range(_PORTS)})

    def rates(self, payload: bytes) -> bytes | bool:
        """Carry out CFG-RATE; return the rate if it asks for it."""
        keys = (MEASUREMENT_MS, NAVIGATION_RATE, _TIME_REFERENCE)
        if not payload:
            return pack("<3H", *[self.values[key] for key in keys])
        return len(payload) == 6 and self.set_values(RAM, dict(zip(keys, unpack("<3H", payload), strict=True)))

    def port(self, payload: bytes) -> bytes | bool:
        """Carry out CFG-PRT of the port in use; return its record if it asks for it."""
        if len(payload) < 2:
            masks = [sum(bit for key, bit in half if self.values[key]) for half in (_MASKS[:3], _MASKS[3:])]
            return pack("<BxHIIHHHxx", UART1, 0, 0x8C0, self.values[BAUD], *masks, 0)
        if len(payload) != 20:
            return False
        return self._set_port(*unpack_from("<IHH", payload, 8))

    def proprietary(self, fields: bytes) -> bool:
        """Carry out PUBX,41: port, masks of what it takes and gives (hexadecimal), baud rate."""
        try:
            _, taken, given, baud, *_ = fields.split(b",")
            return self._set_port(int(baud), int(taken, 16), int(given, 16))
        except ValueError:
            return False

    def _set_port(self, baud: int, taken: int, given: int) -> bool:
        if not 4800 <= baud <= 921_600:
            return False
        pairs = {key: int(bool(taken & bit)) for key, bit in _MASKS[:3]}
        return self.set_values(RAM, pairs | {key: int(bool(given & bit)) for key, bit in _MASKS[3:]} | {BAUD: baud})

    def navigation(self, payload: bytes) -> bytes | bool:
        """Carry out CFG-NAV5, of which the dynamic model is kept; return the record if it asks for it."""
        if not payload:
            return pack("<HBBiIbBHHHHBBBB2xHB5x", 0xFFFF, self.values[_DYNAMIC_MODEL], 3, 0, 10_000, 5, 0, 250, 250,
                        100, 350, 0, 60, 0, 0, 0, 0)  # fmt: skip
        return len(payload) == 36 and (not payload[0] & 1 or self.set_values(RAM, {_DYNAMIC_MODEL: payload[2]}))

    def record(self, number: int, payload: bytes) -> bytes | bool:
        """Keep or return a record without an effect here: GPS alone is simulated, without a pulse or SBAS."""
        if len(payload) < 2:
            return self._records[number]
        size = 4 + 8 * payload[3] if number == GNSS and len(payload) > 3 else len(self._records[number])
        is_sized = len(payload) == size
        if is_sized:
            self._records[number] = payload
        return is_sized

    def store(self, payload: bytes) -> bool:
        """Carry out CFG-CFG: forget what was kept, keep the present values, or take the kept ones."""
        if len(payload) not in (12, 13):
            return False
        clear, save, load = unpack_from("<3I", payload)
        if clear:
            self._memory.clear()
        if save:
            self._memory |= self.values
        if load:
            self.values = defaults() | self._memory
        return True
