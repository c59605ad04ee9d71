"""S-57 files for tests, written field by field: the reverse of what hil.charts reads, and independent of it."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

UT, FT = b"\x1f", b"\x1e"
COMF, SOMF = 10_000_000, 10

# tag: labels, formats, and how one row is packed (A stands for text up to a terminator)
FIELDS = {
    "0001": ("", "(b12)", "H"),
    "DSID": (
        "RCNM!RCID!EXPP!INTU!DSNM!EDTN!UPDN!UADT!ISDT!STED!PRSP!PSDN!PRED!PROF!AGEN!COMT",
        "(b11,b14,2b11,3A,2A(8),R(4),b11,2A,b11,b12,A)", "BIBBAAA8s8s4sBAABHA",
    ),
    "DSSI": ("DSTR!AALL!NALL!NOMR!NOCR!NOGR!NOLR!NOIN!NOCN!NOED!NOFA", "(3b11,8b14)", "BBBIIIIIIII"),
    "DSPM": (
        "RCNM!RCID!HDAT!VDAT!SDAT!CSCL!DUNI!HUNI!PUNI!COUN!COMF!SOMF!COMT", "(b11,b14,3b11,b14,4b11,2b14,A)",
        "BIBBBIBBBBIIA",
    ),
    "FRID": ("RCNM!RCID!PRIM!GRUP!OBJL!RVER!RUIN", "(b11,b14,2b11,2b12,b11)", "BIBBHHB"),
    "ATTF": ("*ATTL!ATVL", "(b12,A)", "HA"),
    "FSPC": ("FSUI!FSIX!NSPT", "(b11,2b12)", "BHH"),
    "FSPT": ("*NAME!ORNT!USAG!MASK", "(B(40),3b11)", "5sBBB"),
    "VRID": ("RCNM!RCID!RVER!RUIN", "(b11,b14,b12,b11)", "BIHB"),
    "VRPC": ("VPUI!VPIX!NVPT", "(b11,2b12)", "BHH"),
    "VRPT": ("*NAME!ORNT!USAG!TOPI!MASK", "(B(40),4b11)", "5sBBBB"),
    "SGCC": ("CCUI!CCIX!CCNC", "(b11,2b12)", "BHH"),
    "SG2D": ("*YCOO!XCOO", "(2b24)", "ii"),
    "SG3D": ("*YCOO!XCOO!VE3D", "(3b24)", "iii"),
}  # fmt: skip

Row = tuple[Any, ...]
Fields = dict[str, list[Row]]
Position = tuple[float, float]  # latitude, longitude


def name(kind: int, number: int) -> bytes:
    return struct.pack("<BI", kind, number)


def pack(tag: str, rows: Sequence[Row]) -> bytes:
    form = FIELDS[tag][2].replace("8s", "8").replace("4s", "4").replace("5s", "5")
    data = b""
    for row in rows:
        for code, value in zip(form, row, strict=True):
            if code == "A":
                data += str(value).encode("latin-1") + UT
            elif code.isdigit():
                data += value if isinstance(value, bytes) else str(value).encode().ljust(int(code))
            else:
                data += struct.pack("<" + code, value)
    return data + FT


def record(fields: list[tuple[str, bytes]], leader: str) -> bytes:
    area = b"".join(data for _, data in fields)
    directory, offset = b"", 0
    for tag, data in fields:
        directory += f"{tag}{len(data):05d}{offset:05d}".encode()
        offset += len(data)
    directory += FT
    base = 24 + len(directory)
    interchange = "3LE1 09" if leader == "L" else " D     "
    head = f"{base + offset:05d}{interchange}{base:05d}{' ! ' if leader == 'L' else '   '}5504".encode()
    assert len(head) == 24
    return head + directory + area


def description() -> bytes:
    fields = [("0000", b"0000;&   " + UT + FT)]
    for tag, (labels, formats, _) in FIELDS.items():
        fields.append((tag, b"1600;&   " + tag.encode() + UT + labels.encode() + UT + formats.encode() + FT))
    return record(fields, "L")


class Encoder:
    """An encoder that collects records, then writes them. Records are numbered in order of creation."""

    def __init__(self, edition: int = 1, update: int = 0, scale: int = 10_000) -> None:
        self.records: list[Fields] = []
        self._last = {100: 0, 110: 0, 120: 0, 130: 0}
        head = (10, 1, 1, 5, "TEST", edition, update, "20250101", "20250101", "03.1", 1, "", "2.0", 1, 550, "")
        self.records.append({"DSID": [head]})
        if update == 0:
            self.records.append({"DSPM": [(20, 1, 2, 0, 12, scale, 1, 1, 1, 1, COMF, SOMF, "")]})

    def add(self, **fields: list[Row]) -> None:
        self.records.append(fields)

    def node(self, position: Position, kind: int = 120) -> int:
        self._last[kind] += 1
        self.add(VRID=[(kind, self._last[kind], 1, 1)], SG2D=[_units(position)])
        return self._last[kind]

    def edge(self, begin: int, end: int, middle: Sequence[Position] = ()) -> int:
        self._last[130] += 1
        ends = [(name(120, begin), 255, 255, 1, 255), (name(120, end), 255, 255, 2, 255)]
        fields: Fields = {"VRID": [(130, self._last[130], 1, 1)], "VRPT": ends}
        if middle:
            fields["SG2D"] = [_units(place) for place in middle]
        self.records.append(fields)
        return self._last[130]

    def soundings(self, soundings: Sequence[tuple[float, float, float]]) -> int:
        self._last[110] += 1
        rows = [(*_units((lat, lon)), round(depth * SOMF)) for lat, lon, depth in soundings]
        self.add(VRID=[(110, self._last[110], 1, 1)], SG3D=rows)
        return self.feature(129, 1, [(name(110, self._last[110]), 255, 255, 255)])

    def feature(self, code: int, primitive: int, pointers: list[Row], **attributes: object) -> int:
        self._last[100] += 1
        numbers = {"CATCOV": 18, "DRVAL1": 87, "DRVAL2": 88, "SCAMIN": 133, "VALDCO": 174, "VALSOU": 179, "WATLEV": 187}
        rows: list[Row] = [(numbers[key], value) for key, value in attributes.items()]
        fields: Fields = {"FRID": [(100, self._last[100], primitive, 2, code, 1, 1)]}
        if rows:
            fields["ATTF"] = rows
        fields["FSPT"] = pointers
        self.records.append(fields)
        return self._last[100]

    def point(self, code: int, position: Position, **attributes: object) -> int:
        return self.feature(code, 1, [(name(110, self.node(position, 110)), 255, 255, 255)], **attributes)

    def line(self, code: int, positions: Sequence[Position], **attributes: object) -> int:
        edge = self.edge(self.node(positions[0]), self.node(positions[-1]), positions[1:-1])
        return self.feature(code, 2, [(name(130, edge), 1, 255, 255)], **attributes)

    def ring(self, positions: Sequence[Position], usage: int = 1) -> list[Row]:
        """Return the two edges of a ring, the second one recorded against its direction."""
        half = len(positions) // 2
        first, second = self.node(positions[0]), self.node(positions[half])
        out = self.edge(first, second, positions[1:half])
        back = self.edge(first, second, positions[:half:-1])
        return [(name(130, out), 1, usage, 255), (name(130, back), 2, usage, 255)]

    def area(
        self, code: int, positions: Sequence[Position], hole: Sequence[Position] = (), **attributes: object
    ) -> int:
        return self.feature(code, 3, self.ring(positions) + (self.ring(hole, 2) if hole else []), **attributes)

    def data(self) -> bytes:
        records = [description()]
        counts = [sum(fields.get("VRID", [(0,)])[0][0] == kind for fields in self.records) for kind in (110, 120, 130)]
        objects = sum("FRID" in fields for fields in self.records)
        if any("DSPM" in fields for fields in self.records):  # not in updates
            self.records[0]["DSSI"] = [(2, 1, 1, 0, 0, objects, 0, *counts, 0)]
        for number, fields in enumerate(self.records, 1):
            packed = [("0001", struct.pack("<H", number) + FT)]
            packed += [(tag, pack(tag, rows)) for tag, rows in fields.items()]
            records.append(record(packed, "D"))
        return b"".join(records)

    def write(self, path: Path) -> str:
        path.write_bytes(self.data())
        return str(path)


def _units(position: Position) -> tuple[int, int]:
    return round(position[0] * COMF), round(position[1] * COMF)


def square(south: float, west: float, north: float, east: float) -> list[Position]:
    return [(south, west), (north, west), (north, east), (south, east)]
