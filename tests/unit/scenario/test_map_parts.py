"""The part of a large world that a planner's map shows."""

from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.paths.occupancy import Extent
from hil.scenario.map_parts import MAX_CELLS, MAX_GROWN, MIN_MARGIN_CELLS, MapPart, map_parts
from tests.support.examples import examples

WIDE = Extent(-25_000.0, -25_000.0, 25_000.0, 25_000.0)


def cells(map_part: MapPart) -> float:
    extent = map_part.extent
    return (extent.north - extent.south) * (extent.east - extent.west) / map_part.resolution**2


def test_a_small_world_or_one_without_points_is_shown_completely() -> None:
    small = Extent(-3.0, -3.0, 60.0, 60.0)
    assert map_parts(small, 0.25, [(0.0, 0.0)]) == [(small, 0.25)]
    assert map_parts(WIDE, 2.0, []) == [(WIDE, 32.0)], "in cells whose number is within the limit"


def test_the_margin_doubles_until_the_map_is_too_large() -> None:
    *parts, last = map_parts(WIDE, 2.0, [(0.0, 0.0), (1000.0, 400.0)])
    assert [part.extent.north - 1000.0 for part in parts] == [250.0 * 2**k for k in range(len(parts))]
    assert {part.resolution for part in parts} == {2.0}
    assert cells(parts[-1]) <= MAX_GROWN < 4.5 * cells(parts[-1])
    assert last == (WIDE, 32.0)
    assert map_parts(WIDE, 40.0, [(0.0, 0.0)])[-1] == (WIDE, 40.0), "the whole map is within the limit"


def test_distant_points_are_shown_in_larger_cells() -> None:
    first, last = map_parts(WIDE, 1.0, [(-4500.0, -4500.0), (4500.0, 4500.0)])
    assert first.resolution == 16.0
    assert cells(first) <= MAX_GROWN < 4.5 * cells(first)
    assert last == (WIDE, 32.0)


@examples(200)
@given(
    st.lists(st.tuples(st.floats(-25e3, 25e3), st.floats(-25e3, 25e3)), min_size=1, max_size=4),
    st.sampled_from([0.3, 1.0, 2.5, 7.0]),
)
def test_every_part_contains_the_points_and_the_cells_of_the_whole_map(
    points: list[tuple[float, float]], resolution: float
) -> None:
    before = None
    for map_part in map_parts(WIDE, resolution, points):
        extent, size = map_part
        assert size / resolution in {2.0**k for k in range(12)}
        assert cells(map_part) <= MAX_GROWN
        margin = MIN_MARGIN_CELLS * resolution
        for north, east in points:
            assert extent.south <= max(north - margin + 1e-6, WIDE.south)
            assert extent.north >= min(north + margin - 1e-6, WIDE.north)
            assert extent.west <= max(east - margin + 1e-6, WIDE.west)
            assert extent.east >= min(east + margin - 1e-6, WIDE.east)
        for low, first in ((extent.south, WIDE.south), (extent.west, WIDE.west)):
            whole = (low - first) / size
            assert abs(whole - round(whole)) < 1e-6
        assert WIDE.south <= extent.south < extent.north <= WIDE.north
        assert before is None or extent.north - extent.south >= before.north - before.south - 1e-6
        before = extent
    assert extent == WIDE
    assert cells(MapPart(WIDE, resolution)) > MAX_CELLS
