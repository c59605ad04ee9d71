"""Damage that would take all memory to grid is told and refused, and a build stays within limits, whatever it reads."""

import re
from pathlib import Path
from typing import Any

import pytest

from hil.charts import build_process, limited
from hil.charts.build import MAX_OWN_NODES
from hil.charts.build_process import read_and_build
from hil.charts.sources.combine import read_sources
from hil.common.children import python_command
from hil.common.errors import ConfigError
from tests.support.charts.s57_encoder import Encoder
from tests.support.charts.small_cell import EAST, NORTH, SOUTH, WEST, bay


def far_contour(cell: Encoder) -> None:
    """One position of a contour is off by 45 degrees: 160,000 points of 3 km each way to interpolate."""
    cell.line(43, [(54.004, WEST), (54.004, 55.0), (54.004, EAST)], VALDCO=10)


def far_corner(cell: Encoder) -> None:
    """One corner of the coverage is off by a degree: 60 times as many nodes."""
    cell.records = [fields for fields in cell.records if fields.get("FRID", [(0,) * 7])[0][4] != 302]
    cell.area(302, [(SOUTH, WEST), (NORTH, WEST), (NORTH, EAST + 1.0), (SOUTH, EAST)], CATCOV=1)


def large_denominator(cell: Encoder) -> None:
    header = cell.records[1]["DSPM"][0]
    cell.records[1]["DSPM"] = [(*header[:5], 2_000_000, *header[6:])]


def odd_factor(cell: Encoder) -> None:
    header = cell.records[1]["DSPM"][0]
    cell.records[1]["DSPM"] = [(*header[:10], 9_000_000, *header[11:])]


def far_vertex(cell: Encoder) -> None:
    """One position of a contour is off by less than the size of the chart."""
    cell.line(43, [(54.004, WEST), (54.004, 10.002), (54.016, 10.003), (54.004, 10.004), (54.004, EAST)], VALDCO=10)


@pytest.mark.parametrize(("damage", "told"), [
    (far_vertex, "an object DEPCNT has a corner far from its neighbours"),
    (lambda cell: cell.feature(42, 3, [], DRVAL1=1, DRVAL2=2), "an area DEPARE has no edges"),
    (far_contour, r"an object DEPCNT reaches to 54\.0040 N, 55\.0000 E, far outside of its coverage"),
    (far_corner, r"one corner of its coverage, at longitude 11\.0160, is far from all other objects"),
    (large_denominator, r"states a scale of 1:2000000, but covers 1\.78 km"),
    (odd_factor, r"positions and depths count in parts of 9000000, no power of ten"),
    (lambda cell: cell.soundings([(54.001, 10.001, 1.6e6)]), r"an object SOUNDG has a depth of 1\.6e\+06 m"),
])  # fmt: skip
def test_a_damaged_chart_is_refused_with_what_is_wrong(tmp_path: Path, damage: Any, told: str) -> None:
    cell = bay()
    damage(cell)
    with pytest.raises(ConfigError, match=rf"BAD.*: .*{told}: .*damaged"):
        read_and_build([cell.write(tmp_path / "BAD.000")])


def test_a_scale_too_large_for_the_objects_makes_no_finer_grid(tmp_path: Path) -> None:
    cell = bay(scale=2000)
    assert read_sources([cell.write(tmp_path / "BAY.000")], None)[0].detail == pytest.approx(0.0005 * 3000)
    for step in (29_999, 44_999, 59_999):
        cell.point(17, (54.006, 10.010), SCAMIN=step)
    survey, _ = read_sources([cell.write(tmp_path / "BAY.000")], None)
    assert survey.detail == pytest.approx(0.0005 * 22_000)
    assert "states a scale of 1:2000, too large for its objects or purpose: read as 1:22000" in survey.notes[0]


def test_a_chart_across_the_180th_meridian_is_sound(tmp_path: Path) -> None:
    cell = Encoder()
    around = [(0.0, 179.99), (0.02, 179.99), (0.02, -179.99), (0.0, -179.99)]
    cell.area(302, around, CATCOV=1)
    cell.area(42, around, DRVAL1=0, DRVAL2=20)
    cell.soundings([(0.01, 179.995, 5.0), (0.012, -179.995, 6.0), (0.015, 180.0, 9.0)])
    assert len(read_sources([cell.write(tmp_path / "DATE.000")], None)[0].soundings) == 3


def test_a_build_is_limited_to_what_its_nodes_and_points_need(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limits: list[tuple[int, int]] = []
    monkeypatch.setattr(build_process, "limit_self", lambda *limit: limits.append(limit))
    path = bay().write(tmp_path / "BAY.000")
    survey, extent = read_sources([path], None)
    for resolution in (None, 20.0, 0.001):
        build_process._limit(survey, extent, resolution)
    own, coarse, finest = limits
    assert coarse[0] < own[0] < 1 << 30
    assert coarse[1] < own[1] < 200
    assert finest[0] < 10 << 30
    build_process._limit(survey, (0.0, 1e5, 0.0, 1e5), None)
    assert limits[-1][0] < build_process._memory(MAX_OWN_NODES, 10_000)


@pytest.mark.usefixtures("own_process")
@pytest.mark.parametrize(
    "end",
    ["os.kill(os.getpid(), 9)", "sys.stdin.buffer.read(); sys.stdout.buffer.write(pickle.dumps(('', 1))[:-3])"],
    ids=["at once", "at last"],
)
def test_a_build_that_was_ended_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str) -> None:
    """It has exceeded a limit, before or while it wrote its result."""
    command = python_command("-c", f"import os, pickle, sys; {end}")
    monkeypatch.setattr(limited, "module_command", lambda *_: command)
    path = bay().write(tmp_path / "BAY.000")
    with pytest.raises(ConfigError, match=re.escape(f"{path}: gridding was ended, as it took too much time or memory")):
        read_and_build([path])
