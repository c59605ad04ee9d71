"""Reading S-57 cells with their updates: geometry, attributes, and files that are damaged or hostile."""

import os
import random
import re
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely

from hil.charts.sources import s57, s57_process
from hil.charts.sources.combine import read_sources
from hil.charts.sources.s57 import Cell, read_cell
from hil.common.errors import ConfigError, HilError
from tests.support.charts.s57_encoder import Encoder, name, square
from tests.support.charts.small_cell import bay, bed
from tools.faults.decoders import mutate

COUNT = int(os.environ.get("UUV_HIL_FUZZ", "3"))  # mutated cells; 10000 by hand


def enclosed(cell: Cell, kind: str) -> float:
    """Return the square degrees inside all areas of a class, without their holes, by the shoelace formula."""
    total = 0.0
    for feature in cell.select(kind):
        twice = sum(float((e[:-1, 0] * e[1:, 1] - e[1:, 0] * e[:-1, 1]).sum()) for e in feature.lines)
        total += 0.5 * twice
    return abs(total)


def test_a_written_cell_is_read_back(tmp_path: Path) -> None:
    cell = read_cell(bay(scale=12_345).write(tmp_path / "BAY.000"))
    assert (cell.name, cell.edition, cell.update, cell.scale) == ("BAY", 1, 0, 12_345)
    kinds = [feature.kind for feature in cell.features]
    assert sorted(set(kinds)) == sorted(
        ["M_COVR", "DEPARE", "LNDARE", "DEPCNT", "COALNE", "SOUNDG", "UWTROC", "PILPNT", "OBSTRN"]
    )
    soundings = np.concatenate([feature.points for feature in cell.select("SOUNDG")])
    assert len(soundings) > 70
    truth = [bed(latitude, longitude) for longitude, latitude, _ in soundings]
    assert soundings[:, 2] == pytest.approx(truth, abs=0.051)  # decimetres
    contour = cell.select("DEPCNT")[0]
    assert contour.lines[0] == pytest.approx(np.array([[10.0, 54.008], [10.005, 54.008], [10.016, 54.008]]), abs=1e-12)
    assert contour.number("VALDCO") == 0.0
    rock = cell.select("UWTROC")[0]
    assert (rock.number("VALSOU"), rock.number("WATLEV")) == (5.5, 3.0)
    assert rock.number("DRVAL1") is None
    assert np.isnan(rock.points[0, 2])


def test_the_edges_of_an_area_form_closed_rings(tmp_path: Path) -> None:
    cell = read_cell(bay().write(tmp_path / "BAY.000"))
    assert enclosed(cell, "M_COVR") == pytest.approx(0.01 * 0.016, rel=1e-6)
    for feature in cell.select("DEPARE", "LNDARE", "M_COVR"):
        ends = np.concatenate([edge[[0, -1]] for edge in feature.lines])
        _, counts = np.unique(ends, axis=0, return_counts=True)
        assert (counts == 2).all(), "every edge begins where another ends"


def update_of(base: Encoder) -> Encoder:
    """Insert a wreck, delete the pile, move a contour's middle, take an attribute away and change one."""
    features = {fields["FRID"][0][4]: fields["FRID"][0] for fields in base.records if "FRID" in fields}
    pointer = next(fields["FSPT"][0][0] for fields in base.records if fields.get("FRID", [(0,) * 5])[0][4] == 43)
    update = Encoder(update=1)
    update.add(VRID=[(110, 900, 1, 1)], SG2D=[(540_010_000, 100_050_000)])
    update.add(FRID=[(100, 900, 1, 2, 159, 1, 1)], ATTF=[(179, "7.5")], FSPT=[(name(110, 900), 255, 255, 255)])
    update.add(FRID=[(100, features[90][1], 1, 2, 90, 2, 2)])
    update.add(
        VRID=[(130, int.from_bytes(pointer[1:], "little"), 2, 3)], SGCC=[(3, 1, 1)], SG2D=[(540_081_000, 100_060_000)]
    )
    update.add(FRID=[(100, features[153][1], 1, 2, 153, 2, 3)], ATTF=[(187, "\x7f"), (179, "4.4")])
    return update


def test_an_update_changes_objects_attributes_and_geometry(tmp_path: Path) -> None:
    base = bay()
    path = base.write(tmp_path / "BAY.000")
    update_of(base).write(tmp_path / "BAY.001")
    before, after = read_cell(path, updates=False), read_cell(path)
    assert (before.update, after.update) == (0, 1)
    assert len(before.select("PILPNT")) == 1
    assert not after.select("PILPNT")
    assert not before.select("WRECKS")
    assert after.select("WRECKS")[0].points[0, :2] == pytest.approx([10.005, 54.001])
    assert after.select("DEPCNT")[0].lines[0][1] == pytest.approx([10.006, 54.0081])
    rock = after.select("UWTROC")[0]
    assert rock.attributes == {"VALSOU": 4.4}


@pytest.mark.parametrize(("instruction", "index", "count", "new", "expected"), [
    (1, 2, 1, [5.0], [1.0, 5.0, 2.0, 3.0]),
    (1, 4, 2, [5.0, 6.0], [1.0, 2.0, 3.0, 5.0, 6.0]),
    (2, 1, 2, [], [3.0]),
    (3, 2, 2, [8.0, 9.0], [1.0, 8.0, 9.0]),
])  # fmt: skip
def test_soundings_are_inserted_deleted_and_replaced(
    tmp_path: Path, instruction: int, index: int, count: int, new: list[float], expected: list[float]
) -> None:
    base = Encoder()
    base.soundings([(54.0, 10.0 + 0.001 * depth, depth) for depth in (1.0, 2.0, 3.0)])
    path = base.write(tmp_path / "C.000")
    update = Encoder(update=1)
    rows = [(540_000_000, 100_000_000, round(10 * depth)) for depth in new]
    fields = {"SG3D": rows} if rows else {}
    update.add(VRID=[(110, 1, 2, 3)], SGCC=[(instruction, index, count)], **fields)
    update.write(tmp_path / "C.001")
    assert read_cell(path).select("SOUNDG")[0].points[:, 2].tolist() == expected


def test_updates_are_applied_in_order_after_those_in_a_reissued_cell(tmp_path: Path) -> None:
    base = Encoder(update=0)
    base.records[0]["DSID"] = [(*base.records[0]["DSID"][0][:6], 2, *base.records[0]["DSID"][0][7:])]
    base.soundings([(54.0, 10.0, 1.0)])
    path = base.write(tmp_path / "C.000")
    (tmp_path / "C.001").write_bytes(b"an old one, in the cell already")
    for number, depth in ((3, 30), (4, 40)):
        update = Encoder(update=number)
        update.add(VRID=[(110, 1, number - 1, 3)], SGCC=[(3, 1, 1)], SG3D=[(540_000_000, 100_000_000, depth)])
        update.write(tmp_path / f"C.{number:03d}")
    cell = read_cell(path)
    assert cell.update == 4
    assert cell.select("SOUNDG")[0].points[0, 2] == 4.0
    os.remove(tmp_path / "C.003")
    with pytest.raises(ConfigError, match=r"C\.003: this update is missing.*--no-updates"):
        read_cell(path)
    assert read_cell(path, updates=False).select("SOUNDG")[0].points[0, 2] == 1.0


def test_an_update_of_another_edition_or_a_withdrawal_is_refused(tmp_path: Path) -> None:
    path = bay().write(tmp_path / "BAY.000")
    Encoder(edition=2, update=1).write(tmp_path / "BAY.001")
    for edition in (2, 0):
        Encoder(edition=edition, update=1).write(tmp_path / "BAY.001")
        with pytest.raises(ConfigError, match=r"BAY\.00[01]: .*does not fit .* withdraws the chart.*--no-updates"):
            read_cell(path)
        assert read_cell(path, updates=False).update == 0


def test_a_missing_file_and_a_file_that_is_no_chart_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "C.000"
    with pytest.raises(
        ConfigError,
        match=r"cannot be read: No such file; NOAA's charts are free at https://charts\.noaa\.gov/ENCs/ENCs\.shtml",
    ):
        read_cell(str(path))
    for content in (b"", b"<html>not found</html>" * 9, os.urandom(400)):
        path.write_bytes(content)
        with pytest.raises(ConfigError, match="not an ISO 8211 file"):
            read_cell(str(path))


@pytest.mark.usefixtures("own_process")
def test_a_chart_that_ends_too_early_is_refused(tmp_path: Path) -> None:
    """The chart is cut at any byte; `test_mutated_cells_are_read_or_refused` has what else can be wrong with one."""
    cell_bytes = bay().data()
    path = tmp_path / "C.000"
    for size in (*np.random.default_rng(1).integers(24, len(cell_bytes), 1), len(cell_bytes) - 10):
        path.write_bytes(cell_bytes[:size])
        with pytest.raises(ConfigError, match=r"damaged or cut off .*; copy it again"):
            read_cell(str(path))


@pytest.mark.parametrize("damage", ["a directory that does not advance", "entries that overlap", "a huge count"])
@pytest.mark.usefixtures("own_process")
def test_hostile_charts_are_refused_within_limits(tmp_path: Path, damage: str) -> None:
    """These charts made a reader of our own hang, take gigabytes, or raise a MemoryError."""
    cell_bytes = bay().data()
    if damage == "a directory that does not advance":  # a record of 24 bytes whose entries have no width
        data = cell_bytes + b"00024 D     00024   0000"
    elif damage == "entries that overlap":  # 9,000 entries of one field, each the whole rest of the file
        entries = b"SG2D" + b"99999" + b"00000"
        base = 24 + 6900 * len(entries) + 1
        data = cell_bytes + b"00000 D     " + b"%05d" % base + b"   5504" + entries * 6900 + b"\x1e" + b"\x00" * 99_999
    else:
        data = cell_bytes.replace(b"(3b11,8b14)", b"(999999999b11)"[:11])
    path = tmp_path / "C.000"
    path.write_bytes(data)
    with suppress(ConfigError):
        assert read_cell(str(path)).features


def test_other_chart_products_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "101AA00.000"
    path.write_bytes(bay().data().replace(b"TEST", b"INT.IHO.S-101.1.0", 1))
    with pytest.raises(ConfigError, match=r"S-101; use the S-57 edition"):
        read_cell(str(path))
    path.write_bytes(np.random.default_rng(3).bytes(5000))
    with pytest.raises(ConfigError, match=r"encrypted \(S-63\)"):
        read_cell(str(path))
    with path.open("wb") as file:
        file.truncate(65 << 20)
    with pytest.raises(ConfigError, match="at most 64 MiB"):
        read_cell(str(path))


@pytest.mark.usefixtures("own_process")
def test_a_reader_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(s57, "LIMITS", s57.LIMITS._replace(seconds=0.01))
    with pytest.raises(ConfigError, match="reading it not finished within"):
        read_cell(bay().write(tmp_path / "C.000"))


def test_the_edges_of_an_area_may_be_in_any_order(tmp_path: Path) -> None:
    cell = Encoder()
    pointers = cell.ring(square(54.0, 10.0, 54.1, 10.1))
    cell.feature(42, 3, pointers[::-1], DRVAL1=1, DRVAL2=2)
    found = read_cell(cell.write(tmp_path / "C.000"))
    assert enclosed(found, "DEPARE") == pytest.approx(0.01, rel=1e-6)
    assert found.select("DEPARE")[0].is_area


def test_an_area_with_edges_that_form_no_ring_is_closed_and_named(tmp_path: Path) -> None:
    """GEOS refuses it as a ring, which made the whole chart unusable."""
    cell = bay()
    nodes = [cell.node(place) for place in square(54.0, 10.0, 54.1, 10.1)]
    edges = [cell.edge(*ends) for ends in pairwise(nodes)]  # without the last side
    cell.feature(42, 3, [(name(130, edge), 1, 1, 255) for edge in edges], DRVAL1=1, DRVAL2=2)
    for updates in (True, False):
        found = read_cell(cell.write(tmp_path / "C.000"), updates)
        assert enclosed(found._replace(features=tuple(found.select("DEPARE")[-1:])), "DEPARE") == pytest.approx(0.01)
        assert "areas with edges that form no ring, closed by straight lines: 1 DEPARE" in found.notes[0]


def test_a_chart_without_a_scale_has_the_usual_one_of_its_purpose(tmp_path: Path) -> None:
    cell, found = bay(scale=0), []
    for purpose in (3, 5, 9):
        header = cell.records[0]["DSID"][0]
        cell.records[0]["DSID"] = [(*header[:3], purpose, *header[4:])]
        found.append(read_cell(cell.write(tmp_path / "C.000")))
    assert [each.scale for each in found] == [90_000, 12_000, 12_000]
    assert "states no scale: read as 1:12000" in found[-1].notes[0]


@pytest.mark.usefixtures("own_process")
def test_mutated_cells_are_read_or_refused(tmp_path: Path) -> None:
    """A mutated cell, or a mutated update of a sound one, gives at most one line of error and no other exception."""
    whole, path, errors = bay(), tmp_path / "C.000", list[str]()
    for number in range(COUNT):
        rng, data, update = random.Random(number), whole.data(), update_of(whole).data()
        of_update = rng.random() < 0.2
        path.write_bytes(data if of_update else mutate(rng, data))
        path.with_suffix(".001").write_bytes(mutate(rng, update) if of_update else update)
        try:
            read_sources([str(path)], None, resolution=50.0)
        except HilError as error:
            errors.append(str(error))
    assert 0 < len(errors) < COUNT
    assert all(re.fullmatch(f"{re.escape(str(path)[:-4])}.*", error) for error in errors), errors


def test_an_invalid_geometry_is_reported_as_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GEOS refuses it with an error that is no RuntimeError, which was a traceback in the process that reads.

    It is blamed on an update only if there is one beside the cell.
    """

    def refuse(*_: object) -> None:
        raise shapely.errors.GEOSException("Points of LinearRing do not form a closed linestring")

    monkeypatch.setattr(s57_process, "_read", refuse)
    base = bay()
    cell = base.write(tmp_path / "C.000")
    for updates in (False, True):
        with pytest.raises(ConfigError, match=r"damaged or cut off \(Points of LinearRing"):
            read_cell(cell, updates)
    update_of(base).write(tmp_path / "C.001")
    with pytest.raises(ConfigError, match=r"an update beside it does not fit the cell.*\(Points of LinearRing"):
        read_cell(cell)
