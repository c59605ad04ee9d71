"""Part of a large world that a planner's map shows."""

from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.paths.occupancy import Extent
from hil.scenario.map_parts import LEAST_MARGIN_CELLS, MOST_CELLS, MOST_GROWN, map_parts
from tests.support.examples import examples

WIDE = Extent(-25_000.0, -25_000.0, 25_000.0, 25_000.0)


def cells(part: Extent, resolution: float) -> float:
    return (part.north - part.south) * (part.east - part.west) / resolution**2


def test_a_small_world_is_shown_whole_and_so_is_one_without_places() -> None:
    small = Extent(-3.0, -3.0, 60.0, 60.0)
    assert map_parts(small, 0.25, [(0.0, 0.0)]) == [small]
    assert map_parts(WIDE, 2.0, []) == [WIDE]


def test_parts_double_their_margin_and_end_before_the_map_is_too_large() -> None:
    parts = map_parts(WIDE, 2.0, [(0.0, 0.0), (1000.0, 400.0)])
    assert [part.north - 1000.0 for part in parts] == [250.0 * 2**k for k in range(len(parts))]
    assert cells(parts[-1], 2.0) <= MOST_GROWN < 4.0 * cells(parts[-1], 2.0)
    assert map_parts(WIDE, 40.0, [(0.0, 0.0)])[-1] == WIDE, "the whole of it is no more than they may grow to"


@examples(200)
@given(
    st.lists(st.tuples(st.floats(-25e3, 25e3), st.floats(-25e3, 25e3)), min_size=1, max_size=4),
    st.sampled_from([0.3, 1.0, 2.5, 7.0]),
)
def test_every_part_holds_the_places_and_has_the_cells_of_the_whole_map(
    places: list[tuple[float, float]], resolution: float
) -> None:
    before = None
    for part in map_parts(WIDE, resolution, places):
        margin = LEAST_MARGIN_CELLS * resolution
        for north, east in places:
            assert part.south <= max(north - margin + 1e-6, WIDE.south)
            assert part.north >= min(north + margin - 1e-6, WIDE.north)
            assert part.west <= max(east - margin + 1e-6, WIDE.west)
            assert part.east >= min(east + margin - 1e-6, WIDE.east)
        for low, first in ((part.south, WIDE.south), (part.west, WIDE.west)):
            whole = (low - first) / resolution
            assert abs(whole - round(whole)) < 1e-6
        assert WIDE.south <= part.south < part.north <= WIDE.north
        assert before is None or cells(part, resolution) >= cells(before, resolution) - 1e-6
        before = part
    assert cells(WIDE, resolution) > MOST_CELLS
