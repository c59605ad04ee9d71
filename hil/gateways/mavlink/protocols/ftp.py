"""MAVFTP server: parameters as one file, and the folder of logs, to read only. What it does not do gets a NAK at once.

The layout of a payload: mavlink.io, services/ftp. `@PARAM/param.pck` is packed as ArduPilot packs it
(AP_Filesystem_Param); logs are below `/logs`.
"""

import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.gateways.mavlink.parameter_table import INT8, INT16, INT32, REAL32, ParameterTable

HEADER = struct.Struct("<HBBBBBxI")  # sequence, session, opcode, size, requested opcode, burst complete, offset
PAYLOAD = 251
MAX_DATA = PAYLOAD - HEADER.size
(TERMINATE, RESET, LIST, OPEN_READ, READ, CREATE, WRITE, REMOVE, MAKE_FOLDER, REMOVE_FOLDER, OPEN_WRITE, TRUNCATE,
 RENAME, CRC32, BURST) = range(1, 16)  # fmt: skip
ACK, NAK = 128, 129
FAIL, BAD_SIZE, BAD_SESSION, END_OF_FILE, UNKNOWN, PROTECTED, NOT_FOUND = 1, 3, 4, 6, 7, 9, 10
WRITING = (CREATE, WRITE, REMOVE, MAKE_FOLDER, REMOVE_FOLDER, OPEN_WRITE, TRUNCATE, RENAME)
MAX_SESSIONS = 8  # of a peer, whatever names its clients give themselves; its oldest one makes room for another
MOST_SESSIONS = 128  # of all peers, also of those that have gone
BURST_AT_ONCE = 40  # packets of one burst; the client asks for the next
LARGEST = 0xFFFF_FFFF  # bytes of a file that an answer can name; the rest of a larger one cannot be read
PARAMETERS = "@PARAM/param.pck"
STANDARD_LOGS = "@MAV_LOG"  # the standard's name of /logs
ONLY_A_FILE: int = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)  # Linux and macOS; Windows
PACK_MAGIC = 0x671B
PACK_TYPES = {INT8: (1, "<b"), INT16: (2, "<h"), INT32: (3, "<i"), REAL32: (4, "<f")}

Partner = tuple[int, int, int]  # peer, system, component


class _Request(NamedTuple):
    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes


class _Session(NamedTuple):
    """A file that a client reads: its path, or its contents."""

    path: str
    content: bytes = b""

    def read(self, offset: int, size: int) -> bytes:
        """Return up to `size` bytes from `offset` on. Raises OSError."""
        if not self.path:
            return self.content[offset : offset + size]
        with open(os.open(self.path, os.O_RDONLY | ONLY_A_FILE), "rb") as file:
            file.seek(offset)
            return file.read(size)


class FtpServer:
    """Serves `folder` as /logs, and parameters, to read only. Never raises. No file stays open."""

    def __init__(self, folder: str, parameters: ParameterTable) -> None:
        self._folder = os.path.realpath(folder) if folder else ""
        self._parameters = parameters
        self._sessions: dict[tuple[Partner, int], _Session] = {}  # each client numbers its own, as ArduPilot lets it

    def handle(self, payload: bytes, partner: Partner) -> list[bytes]:
        """Return the payloads that answer one; nothing for what is no request."""
        data = bytes(payload).ljust(PAYLOAD, b"\0")[:PAYLOAD]
        sequence, session, opcode, size, _, _, offset = HEADER.unpack_from(data)
        if opcode in (0, ACK, NAK):
            return []
        request = _Request(sequence, session, opcode, size, offset, data[HEADER.size : HEADER.size + size])
        try:
            return list(self._answer(request, partner))
        except OSError:
            return [_nak(request, FAIL)]

    def _answer(self, request: _Request, partner: Partner) -> Iterator[bytes]:
        if request.size > MAX_DATA:
            yield _nak(request, BAD_SIZE)
        elif request.opcode == TERMINATE:
            self._sessions.pop((partner, request.session), None)  # there is none if its answer was lost
            yield _ack(request)
        elif request.opcode == RESET:
            self._sessions = {key: session for key, session in self._sessions.items() if key[0] != partner}
            yield _ack(request)
        elif request.opcode == LIST:
            yield self._list(request)
        elif request.opcode == OPEN_READ:
            yield self._open(request, partner)
        elif request.opcode in (READ, BURST):
            yield from self._read(request, partner)
        else:
            yield _nak(request, PROTECTED if request.opcode in WRITING else UNKNOWN)

    def _list(self, request: _Request) -> bytes:
        path = _path(request)
        if path in ("", "/"):
            entries = ["D@PARAM", "Dlogs"]
        elif path.strip("/") == "@PARAM":
            entries = [f"Fparam.pck\t{len(pack_parameters(self._parameters))}"]
        else:
            real = self._real(path)
            if real is None or not os.path.isdir(real):
                return _nak(request, NOT_FOUND)
            entries = [_entry(real, name) for name in sorted(os.listdir(real))]
        text = b""
        for entry in entries[request.offset :]:
            encoded = entry.encode("utf-8", "replace") + b"\0"
            if len(text) + len(encoded) > MAX_DATA:
                break
            text += encoded
        return _ack(request, text) if text else _nak(request, END_OF_FILE)

    def _open(self, request: _Request, partner: Partner) -> bytes:
        path = _path(request)
        self._sessions.pop((partner, request.session), None)
        if path.split("?")[0].strip("/") == PARAMETERS:
            session = _Session("", pack_parameters(self._parameters))
            size = len(session.content)
        else:
            real = self._real(path)
            if real is None or not os.path.isfile(real):
                return _nak(request, NOT_FOUND)
            session, size = _Session(real), os.path.getsize(real)
        before = [key for key in self._sessions if key[0][0] == partner[0]]
        if len(before) >= MAX_SESSIONS:
            self._sessions.pop(before[0])
        elif len(self._sessions) >= MOST_SESSIONS:
            self._sessions.pop(next(iter(self._sessions)))
        self._sessions[partner, request.session] = session
        return _ack(request, min(size, LARGEST).to_bytes(4, "little"))

    def _read(self, request: _Request, partner: Partner) -> Iterator[bytes]:
        session = self._sessions.get((partner, request.session))
        if session is None:
            yield _nak(request, BAD_SESSION)
            return
        size = min(request.size or MAX_DATA, MAX_DATA)
        if request.opcode == READ:
            data = session.read(request.offset, size)
            yield _ack(request, data, offset=request.offset) if data else _nak(request, END_OF_FILE)
            return
        whole = session.read(request.offset, size * BURST_AT_ONCE)
        starts = range(0, len(whole), size)
        for number, start in enumerate(starts):
            step = request._replace(sequence=request.sequence + number & 0xFFFF)
            is_last = number == BURST_AT_ONCE - 1
            yield _ack(step, whole[start : start + size], request.offset + start, is_last)
        if len(starts) < BURST_AT_ONCE:
            yield _nak(request._replace(sequence=request.sequence + len(starts) & 0xFFFF), END_OF_FILE)

    def _real(self, path: str) -> str | None:
        """Return the file below the folder of logs that a path names, None for one outside it."""
        plain = path.strip("/").replace(STANDARD_LOGS, "logs", 1)
        if not self._folder or "\0" in plain or not (plain == "logs" or plain.startswith("logs/")):
            return None
        real = os.path.realpath(os.path.join(self._folder, plain[5:]))
        inside = real == self._folder or real.startswith(self._folder + os.sep)
        return real if inside else None


def pack_parameters(table: ParameterTable) -> bytes:
    """Return all parameters as the file param.pck: names share their beginnings with the one before."""
    names = table.names()
    parts, last = [struct.pack("<HHH", PACK_MAGIC, len(names), len(names))], ""
    for name in names:
        kind, form = PACK_TYPES[table.kind(name)]
        common = next(
            (i for i, (a, b) in enumerate(zip(name, last, strict=False)) if a != b), min(len(name), len(last))
        )
        common = min(common, 15, len(name) - 1)
        rest = name[common:].encode()
        value = table.value(name) or 0.0
        number = value if form == "<f" else round(value)
        parts.append(bytes((kind, common | len(rest) - 1 << 4)) + rest + struct.pack(form, number))
        last = name
    return b"".join(parts)


def ftp_message(payload: bytes, system: int, component: int) -> Any:
    """Return FILE_TRANSFER_PROTOCOL with a payload."""
    return dialect.MAVLink_file_transfer_protocol_message(0, system, component, list(payload.ljust(PAYLOAD, b"\0")))


def _path(request: _Request) -> str:
    return request.data.split(b"\0", 1)[0].decode("utf-8", "replace")


def _entry(folder: str, name: str) -> str:
    path = os.path.join(folder, name)
    with suppress(OSError):
        if os.path.isdir(path):
            return f"D{name}"
        if os.path.isfile(path):
            return f"F{name}\t{os.path.getsize(path)}"
    return "S"


def _ack(request: _Request, data: bytes = b"", offset: int | None = None, complete: bool = False) -> bytes:
    where = request.offset if offset is None else offset
    head = HEADER.pack(request.sequence + 1 & 0xFFFF, request.session, ACK, len(data), request.opcode, complete, where)
    return head + data


def _nak(request: _Request, reason: int) -> bytes:
    sequence = request.sequence + 1 & 0xFFFF
    return HEADER.pack(sequence, request.session, NAK, 1, request.opcode, 0, request.offset) + bytes((reason,))
