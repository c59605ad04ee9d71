"""The configuration of a receiver: values by their keys, and the older messages that set the same values.

A key's bits 28 to 30 are the size of its value. What lies in RAM is lost without power; what was also set in the
battery-backed or the flash layer is not.
"""

import struct
from struct import pack, unpack, unpack_from
from typing import Any

from hil.instruments.layout import read_device

DEVICE = read_device("ublox_m9")
RAM, BACKUP, FLASH = 1, 2, 4
MEASUREMENT_MS, NAVIGATION_RATE, _TIME_REFERENCE, BAUD = 0x30210001, 0x30210002, 0x20210003, 0x40520001
_RATE_KEYS = (MEASUREMENT_MS, NAVIGATION_RATE, _TIME_REFERENCE)
OUT_UBX, OUT_NMEA = 0x10740001, 0x10740002
# What UART1 takes and what it gives: UBX, NMEA and RTCM 3, by key with the bits of the masks of the older messages.
_TAKEN = {0x10730001: 1, 0x10730002: 2, 0x10730004: 32}
_GIVEN = {OUT_UBX: 1, OUT_NMEA: 2, 0x10740004: 32}
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8}
_FASTEST_MS = 40  # 25 Hz
_PORTS = 5  # I2C, UART1, UART2, USB, SPI: a message has one key each, in this order
UART1 = 1
NMEA = 0xF0
_ENGINE, _SYSTEMS = 0x24, 0x3E


def by_message(table: dict[str, Any]) -> dict[tuple[int, int], Any]:
    """Return a table of the device's file by group and number of a message, in place of their hexadecimal digits."""
    return {(int(name[:2], 16), int(name[2:], 16)): value for name, value in table.items()}


RATES: dict[tuple[int, int], int] = by_message(DEVICE["rates"])


def defaults() -> dict[int, int]:
    """Return all keys with their values as delivered: 1 Hz, the six common sentences, no binary message."""
    values: dict[int, int] = {int(key, 16): value for key, value in DEVICE["values"].items()}
    for (group, number), first in RATES.items():
        values |= {first + port: int(group == NMEA and number < 6) for port in range(_PORTS)}
    return values


def _size(key: int) -> int:
    """Return the bytes of a key's value. Raises KeyError."""
    return _SIZES[key >> 28 & 7]


class Configuration:
    """Values by key; `memory` keeps those of the layers that outlive the power.

    Each message of the class CFG is carried out by a method, which returns what the message asks for, or whether it is
    accepted.
    """

    def __init__(self, memory: dict[int, int]) -> None:
        self._memory = memory
        self.values = defaults() | memory
        self._records = {int(name, 16): bytes.fromhex(text) for name, text in DEVICE["records"].items()}

    def carry_out(self, number: int, payload: bytes) -> bytes | bool:
        """Carry out a message of the class CFG by its number."""
        methods = {
            0x00: self._port, 0x01: self._message_rate, 0x08: self._rates, 0x09: self._store, 0x8A: self._valset,
            0x8B: self._valget,
        }  # fmt: skip
        if number in self._records:
            return self._record(number, payload)
        return methods[number](payload) if number in methods else False

    def proprietary(self, fields: bytes) -> bool:
        """Carry out PUBX,41: port, masks of what it takes and gives (hexadecimal), baud rate."""
        try:
            _, taken, given, baud, *_ = fields.split(b",")
            return self._set_port(int(baud), int(taken, 16), int(given, 16))
        except ValueError:
            return False

    def _set(self, layers: int, pairs: dict[int, int]) -> bool:
        """Set values; none at all if one is of no known group or out of range."""
        is_known = all(key in self.values or key >> 16 & 0xFFF in DEVICE["kept"]["groups"] for key in pairs)
        is_right = (
            pairs.get(MEASUREMENT_MS, _FASTEST_MS) >= _FASTEST_MS
            and pairs.get(NAVIGATION_RATE, 1) >= 1
            and 4800 <= pairs.get(BAUD, 4800) <= 921_600
            and not any(value >> 8 * _size(key) for key, value in pairs.items())
        )
        if not (is_known and layers & 7 and is_right):
            return False
        if layers & RAM:
            self.values |= pairs
        if layers & (BACKUP | FLASH):
            self._memory |= pairs
        return True

    def _valset(self, payload: bytes) -> bool:
        pairs, at = {}, 4
        try:
            while at < len(payload):
                (key,) = unpack_from("<I", payload, at)
                end = at + 4 + _size(key)
                if end > len(payload):
                    return False
                pairs[key], at = int.from_bytes(payload[at + 4 : end], "little"), end
        except (struct.error, KeyError):
            return False
        return bool(pairs) and self._set(payload[1], pairs)

    def _valget(self, payload: bytes) -> bytes | bool:
        if len(payload) < 8 or len(payload) % 4:
            return False
        _, layer, position = unpack_from("<BBH", payload)
        source = {0: self.values, 1: self._memory, 2: self._memory, 7: defaults()}.get(layer, {})
        keys: list[int] = []
        for asked in unpack(f"<{len(payload) // 4 - 1}I", payload[4:]):
            groups = (asked & 0x0FFF0000, 0x0FFF0000) if asked & 0xFFFF == 0xFFFF else ()
            found = [key for key in source if key == asked or (groups and groups[0] in (key & 0x0FFF0000, groups[1]))]
            if not found:
                return False
            keys += found
        keys = keys[position : position + 64]
        pairs = [pack("<I", key) + source[key].to_bytes(_size(key), "little") for key in keys]
        return b"\1" + payload[1:4] + b"".join(pairs)

    def _message_rate(self, payload: bytes) -> bytes | bool:
        first = RATES.get((payload[0], payload[1])) if len(payload) in (2, 3, 8) else None
        if first is None:
            return False
        if len(payload) == 2:
            return payload + bytes([self.values[first + port] for port in range(_PORTS)]) + b"\0"
        if len(payload) == 3:
            return self._set(RAM, {first + UART1: payload[2]})
        return self._set(RAM, {first + port: payload[2 + port] for port in range(_PORTS)})

    def _rates(self, payload: bytes) -> bytes | bool:
        if not payload:
            return pack("<3H", *[self.values[key] for key in _RATE_KEYS])
        return len(payload) == 6 and self._set(RAM, dict(zip(_RATE_KEYS, unpack("<3H", payload), strict=True)))

    def _port(self, payload: bytes) -> bytes | bool:
        if len(payload) < 2:
            masks = [sum(bit for key, bit in half.items() if self.values[key]) for half in (_TAKEN, _GIVEN)]
            return pack("<B3xIIHH4x", UART1, 0x8C0, self.values[BAUD], *masks)
        return len(payload) == 20 and self._set_port(*unpack_from("<IHH", payload, 8))

    def _set_port(self, baud: int, taken: int, given: int) -> bool:
        halves = ((_TAKEN, taken), (_GIVEN, given))
        pairs = {key: int(bool(mask & bit)) for keys, mask in halves for key, bit in keys.items()}
        return self._set(RAM, pairs | {BAUD: baud})

    def _record(self, number: int, payload: bytes) -> bytes | bool:
        kept = self._records[number]
        if len(payload) < 2:
            return kept
        size = 4 + 8 * payload[3] if number == _SYSTEMS and len(payload) > 3 else len(kept)
        if len(payload) != size:
            return False
        if number == _ENGINE:  # of which only the dynamic model can be changed
            payload = kept[:2] + (payload if payload[0] & 1 else kept)[2:3] + kept[3:]
        self._records[number] = payload
        return True

    def _store(self, payload: bytes) -> bool:
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
