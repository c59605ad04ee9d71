"""Depth limits of a survey: areas and sheets, limits of the bed, and hazards."""

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import contains, fill
from hil.charts.bounds import (
    LAND_RISE,
    deep_limit_allowance,
    limits_at,
    move_within_limits,
    raise_land,
    raise_to_soundings,
    rasterise_bounds,
    relax_shoal_limits,
)
from hil.charts.build import build
from hil.charts.grid import Grid
from hil.charts.hazards import MIN_HEIGHT, OUT_OF_WATER, place_hazards
from hil.charts.sources.survey import DepthArea, Hazard, Sheet, Survey, first_in_cell, resample, shoalest_in_cell

Array = NDArray[np.float64]


def ring(*corners: tuple[float, float]) -> Array:
    return np.array([*corners, corners[0]], float)


def box(south: float, west: float, north: float, east: float) -> Array:
    return ring((south, west), (north, west), (north, east), (south, east))


def filled(edges: tuple[Array, ...], north: Array, east: Array) -> NDArray[np.bool_]:
    mask = np.zeros((len(north), len(east)), bool)
    part, inside = fill(edges, north, east)
    mask[part] = inside
    return mask


def test_filling_an_area_agrees_with_testing_each_point() -> None:
    """The area is a star with a hole, its edges in pieces, of any order and direction; nodes lie on no edge."""
    angles = np.linspace(0.0, 2.0 * np.pi, 11)
    radius = np.where(np.arange(11) % 2, 40.0, 17.0)
    star = np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])
    star[-1] = star[0]
    edges = (star[4:][::-1], box(-6.2, -5.1, 7.3, 4.4), star[:5])
    north, east = np.linspace(-50.0, 50.0, 83), np.linspace(-45.0, 52.0, 71)
    nodes = np.column_stack([axis.ravel() for axis in np.meshgrid(north, east, indexing="ij")])
    requested = contains(edges, nodes).reshape(83, 71)
    assert (filled(edges, north, east) == requested).all()
    area = requested.mean() * 100.0 * 97.0 * (83 * 71) / (82 * 70)
    points = star[:-1]
    shoelace = 0.5 * abs(np.sum(points[:, 0] * np.roll(points[:, 1], -1) - np.roll(points[:, 0], -1) * points[:, 1]))
    assert area == pytest.approx(shoelace - 13.5 * 9.5, rel=0.03)


def test_areas_off_the_grid_contain_no_nodes() -> None:
    axis = np.arange(5.0)
    assert not filled((box(10.0, 10.0, 20.0, 20.0),), axis, axis).any()
    assert not filled((), axis, axis).any()
    assert not contains((), np.zeros((3, 2))).any()


def test_a_finer_sheet_overrides_a_coarser_one() -> None:
    whole_area = (box(-1.0, -1.0, 101.0, 101.0),)
    middle = (box(30.0, 30.0, 60.0, 60.0),)
    coarse = Sheet("coarse", whole_area, (DepthArea(whole_area, 5.0, 10.0),), (middle,))
    fine = Sheet("fine", middle, (DepthArea(whole_area, 20.0, 30.0),), (), ((box(30.0, 30.0, 40.0, 40.0),),))
    axis = np.arange(0.0, 101.0, 5.0)
    bounds = rasterise_bounds(Survey("", None, np.zeros((3, 3)), sheets=(coarse, fine)), axis, axis)
    inside = filled(middle, axis, axis)
    assert (bounds.low[inside] == 20.0).all()
    assert (bounds.high[~inside] == 10.0).all()
    assert not bounds.land.any()
    assert not bounds.known[6:8, 6:8].any()
    assert bounds.known.sum() == bounds.known.size - 4
    low, high = limits_at(
        Survey("", None, np.zeros((3, 3)), sheets=(coarse, fine)), np.array([[45.0, 45.0], [9.0, 9.0]])
    )
    assert (low.tolist(), high.tolist()) == ([20.0, 5.0], [30.0, 10.0])


def test_the_shoal_limit_is_strict_and_the_deep_limit_allows_soundings() -> None:
    axis = np.arange(0.0, 100.0, 5.0)
    low, high = np.full((20, 20), 5.0), np.full((20, 20), 10.0)
    deep = np.array([[50.0, 50.0, 13.0]])
    extra = deep_limit_allowance(deep, np.array([10.0]), axis, axis, 10.0)

    def settle_at(depth: float) -> Array:
        return move_within_limits(
            Grid(np.full((20, 20), depth, np.float32), 0.0, 0.0, 5.0), low, high + extra, deep
        ).astype(float)

    held = settle_at(20.0)
    assert held[10, 10] == 13.0
    assert held[0, 0] == 10.0
    assert (settle_at(2.0) == 5.0).all()


def largest_step(depths: Array) -> float:
    """Return the greatest step between two neighbouring nodes, m."""
    return float(max(np.abs(np.diff(depths, axis=axis)).max() for axis in (0, 1)))


def test_depth_limits_make_no_cliff_along_their_border() -> None:
    """The bed rises by a ramp, not a stair, from an oblique border of 10 m or more to a level of 6 m."""
    north, east = np.meshgrid(np.arange(60.0), np.arange(60.0), indexing="ij")
    beyond = north + 0.6 * east > 48.0
    low = np.where(beyond, 10.0, 0.0)
    bed = Grid(np.full((60, 60), 6.0, np.float32), 0.0, 0.0, 1.0)
    sounding = np.array([[5.5, 5.5, 6.0]])
    settle_at = move_within_limits(bed, low, np.full((60, 60), 50.0), sounding).astype(float)
    assert (settle_at[beyond] >= 10.0).all()
    assert settle_at[5:7, 5:7] == pytest.approx(np.full((2, 2), 6.0))
    assert largest_step(np.clip(bed.depths.astype(float), low, 50.0)) == 4.0
    assert largest_step(settle_at) < 2.0


def test_a_dredged_channel_has_sloping_sides() -> None:
    """The sides of a channel of at least 9 m in flats of at most 2 m slope, within what the chart is drawn to."""
    low = np.full((40, 40), 0.0)
    low[:, 15:25] = 9.0
    low[:, 0] = np.inf  # land
    high = np.where(low == 9.0, 12.0, 2.0)
    soft = relax_shoal_limits(low, 1.0, 1.0)
    assert (soft[:, 17:23] == 9.0).all()
    assert (soft[:, 15:17] == 0.0).all()
    assert np.isinf(soft[:, 0]).all()
    assert (relax_shoal_limits(low, 0.1, 1.0) == low).all()
    east = np.abs(np.arange(40) - 19.5)
    bed = Grid(np.tile(np.clip(11.0 - 0.9 * east, 1.0, 11.0), (40, 1)).astype(np.float32), 0.0, 0.0, 1.0)
    found = move_within_limits(bed, soft, high, np.empty((0, 3))).astype(float)[:, 1:]
    assert largest_step(found) < 0.75 * largest_step(np.clip(bed.depths.astype(float), low, high)[:, 1:])


def test_between_the_nodes_no_sounding_is_shoaler_than_the_grid() -> None:
    random = np.random.default_rng(4)
    grid = Grid(np.full((20, 30), 20.0, np.float32), -10.0, 5.0, 2.0)
    soundings = np.column_stack(
        [random.uniform(-9.0, 27.0, 60), random.uniform(6.0, 62.0, 60), random.uniform(12.0, 25.0, 60)]
    )
    limits = np.full(60, 8.0)
    raised = raise_to_soundings(grid, soundings, limits, np.full((20, 30), 8.0), passes=200)
    assert (raised.at(soundings[:, :2]) <= soundings[:, 2] + 0.01).all()
    assert raised.depths.max() == 20.0
    assert raised.depths.min() >= 8.0
    hard = raise_to_soundings(grid, soundings, np.full(60, 19.0), np.full((20, 30), 19.0))
    assert hard.depths.min() == 19.0


def test_a_shoal_smaller_than_a_cell_stays_on_the_grid() -> None:
    axis = np.arange(0.0, 101.0, 20.0)
    everywhere, knoll = (box(-1.0, -1.0, 101.0, 101.0),), (box(48.0, 48.0, 52.0, 52.0),)
    sheet = Sheet("", everywhere, (DepthArea(everywhere, 10.0, 20.0), DepthArea(knoll, 2.0, 10.0)), ())
    soundings = np.array([[50.0, 50.0, 3.0], *((n, e, 15.0) for n in axis for e in axis)])
    built = build(Survey("", None, soundings, sheets=(sheet,)), (0.0, 100.0, 0.0, 100.0), 20.0)
    grid = built.model.grid
    assert grid.at(soundings[:1, :2]) == pytest.approx([3.0], abs=0.01)
    away = np.ones((6, 6), bool)
    away[2:4, 2:4] = False
    assert grid.depths[away].min() >= 10.0


def test_land_rises_from_its_shore() -> None:
    depths = np.full((11, 11), 6.0, np.float32)
    land = np.zeros((11, 11), bool)
    land[6:] = True
    depths[5] = -4.0  # a beach
    axis = np.arange(0.0, 110.0, 10.0)
    land_to_the_north = Sheet("", (box(-9.0, -9.0, 109.0, 109.0),), (), ((box(55.0, -50.0, 200.0, 150.0),),))
    bounds = rasterise_bounds(Survey("", None, np.zeros((3, 3)), sheets=(land_to_the_north,)), axis, axis)
    assert (bounds.land == land).all()
    raised = raise_land(Grid(depths, 0.0, 0.0, 10.0), bounds, np.empty((0, 3)))
    assert (raised[:3] == depths[:3]).all()
    assert (raised[3:5] > 0.75 * depths[3:5]).all(), "the foot of the bank"
    assert (raised[5] == depths[5]).all()
    assert (raised[6:] <= -4.0).all()
    assert (np.diff(raised[7:, 3]) < 0.0).all()
    quay = raise_land(Grid(np.full((11, 11), 6.0, np.float32), 0.0, 0.0, 10.0), bounds, np.array([[20.0, 50.0, 6.0]]))
    assert (quay[:3] == 6.0).all()
    assert (quay[3:5] > 0.75 * 6.0).all(), "the foot of its bank"
    assert (quay[7:] <= -LAND_RISE).all()
    assert (quay[5] > 0.0).all(), "on either side of the water line"
    assert (quay[6] < 0.0).all()


def hazard(kind: str, positions: list[tuple[float, float]], top: float | None, edges: tuple[Array, ...] = ()) -> Hazard:
    return Hazard(kind, np.array(positions, float), 2.0, top, edges)


def test_hazards_become_piles_boxes_or_raised_areas() -> None:
    grid = Grid(np.full((21, 21), 12.0, np.float32), 0.0, 0.0, 5.0)
    grid.depths[:, 15:] = -3.0  # land
    area = box(8.0, 8.0, 32.0, 32.0)
    placed = place_hazards((
        hazard("UWTROC", [(50.0, 20.0)], 4.0),
        hazard("UWTROC", [(50.0, 90.0)], 4.0),  # on land
        hazard("UWTROC", [(50.0, 30.0)], 12.5),  # below the bed
        hazard("OBSTRN", [(60.0, 20.0)], None),  # no depth: up to the shoal limit
        hazard("PILPNT", [(70.0, 20.0)], OUT_OF_WATER),
        hazard("OBSTRN", [(80.0, 10.0), (80.0, 30.0), (95.0, 30.0)], 3.0),
        hazard("OBSTRN", [(20.0, 20.0)], 7.0, (area,)),
        hazard("OBSTRN", [(41.0, 41.0), (42.0, 42.0)], 6.0, (box(41.0, 41.0, 42.0, 42.0),)),  # smaller than a cell
        hazard("WRECKS", [(500.0, 20.0)], 3.0),  # off the grid
    ), grid, np.full((21, 21), 9.0))  # fmt: skip
    tops = [(pile.north, pile.east, pile.top) for pile in placed.cylinders]
    assert tops == [(50.0, 20.0, 4.0), (60.0, 20.0, 9.0), (70.0, 20.0, OUT_OF_WATER), (41.5, 41.5, 6.0)]
    assert [(b.north, b.east, b.size_north, round(b.heading, 3)) for b in placed.boxes] == [
        (80.0, 20.0, 24.0, 1.571), (87.5, 30.0, 19.0, 0.0)
    ]  # fmt: skip
    inside = filled((area,), grid.north, grid.east)
    assert (placed.grid.depths[inside] == 7.0).all()
    away = ~filled((box(-4.5, -4.5, 44.5, 44.5),), grid.north, grid.east)
    assert (placed.grid.depths[away] == grid.depths[away]).all()
    assert (grid.depths[:, :15] == 12.0).all()


def test_a_hazard_of_unknown_depth_has_the_least_height() -> None:
    grid = Grid(np.full((5, 5), 9.0, np.float32), 0.0, 0.0, 5.0)
    placed = place_hazards((hazard("WRECKS", [(10.0, 10.0)], None),), grid, np.full((5, 5), 9.0))
    assert placed.cylinders[0].top == 9.0 - MIN_HEIGHT


def test_lines_are_resampled_and_points_thinned_to_the_shoalest() -> None:
    line = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]])
    resampled = resample(line, 8.0)
    assert (resampled[0] == line[0]).all()
    assert (resampled[-1] == line[-1]).all()
    assert np.hypot(*np.diff(resampled, axis=0).T).max() <= 8.0
    points = np.array([[1.0, 1.0, 5.0], [3.0, 1.0, 7.0], [11.0, 1.0, 1.0]])
    assert shoalest_in_cell(points[::-1], 10.0).tolist() == [[11.0, 1.0, 1.0], [1.0, 1.0, 5.0]]
    assert first_in_cell(points, 10.0).tolist() == [0, 2]


def test_the_grid_stays_within_its_areas_and_uses_the_shoaler_sounding() -> None:
    edges = (box(-5.0, -5.0, 205.0, 205.0),)
    slope = np.array([(n, e, 5.0 + 0.1 * n) for n in range(0, 201, 20) for e in range(0, 201, 20)], float)
    twice = np.array([[100.0, 100.0, 9.0]])
    sheet = Sheet("x", edges, (DepthArea(edges, 7.0, 20.0),), ())
    built = build(Survey("x", None, np.vstack([slope, twice]), sheets=(sheet,)), (0.0, 200.0, 0.0, 200.0), 10.0)
    depths = built.model.grid.depths
    assert depths.min() == 7.0
    assert depths[10, 10] == pytest.approx(9.0, abs=1e-3)
    assert built.report.off_limits == 33
    assert depths[20, 10] == pytest.approx(25.0, abs=1e-3)
    assert built.report.clamped > 0.1
