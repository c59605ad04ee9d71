"""Edges of land and of raised areas that lie askew to the grid: the bed between the nodes is straight, not jagged."""

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from hil.autonomy.paths.polygons import edge_distance, fill, segments
from hil.charts.bounds import BEND, FOOT_CELLS, LAND_RISE, raise_with_slope
from hil.charts.build import build
from hil.charts.grid import Grid
from hil.charts.hazards import OUT_OF_WATER, SeabedModel, place_hazards
from hil.charts.sources.survey import DepthArea, Hazard, Sheet, Survey
from sim.environment.obstacles import Box

Array = NDArray[np.float64]
CELL, DEPTH, HALF = 5.0, 6.0, 15.0  # m; half the width of the moles
ANGLE = np.radians(30.0)
ALONG, ACROSS = np.array([np.cos(ANGLE), np.sin(ANGLE)]), np.array([-np.sin(ANGLE), np.cos(ANGLE)])
MIDDLE = np.array([101.3, 98.9])


def mole(half: float = HALF, start: float = -70.0, end: float = 70.0) -> Array:
    """Return the corners of a rectangle along ALONG through MIDDLE, the first corner repeated at the end."""
    sides = ((start, -half), (end, -half), (end, half), (start, half), (start, -half))
    return np.array([MIDDLE + a * ALONG + b * ACROSS for a, b in sides])


def build_grid(*land: Array) -> Grid:
    """Return the grid of a survey of 200 m x 200 m, level except for this land."""
    return build_model((), *land).grid


def build_model(hazards: tuple[Hazard, ...], *land: Array, away: float = 0.0) -> SeabedModel:
    """Return the seabed of the same survey with these hazards, and no soundings up to `away` m from land."""
    everywhere = (np.array([(-9.0, -9.0), (-9.0, 209.0), (209.0, 209.0), (209.0, -9.0), (-9.0, -9.0)]),)
    soundings = np.array([(n, e, DEPTH) for n in range(0, 201, 40) for e in range(0, 201, 40)], float)
    if away:
        soundings = soundings[shapely.distance(shapely.points(soundings[:, :2]), shapely.linestrings(land[0])) > away]
    sheet = Sheet("", everywhere, (DepthArea(everywhere, 0.0, 10.0),), tuple((ring,) for ring in land))
    survey = Survey("", None, soundings, sheets=(sheet,), hazards=hazards)
    return build(survey, (0.0, 200.0, 0.0, 200.0), CELL).model


def offsets(grid: Grid, level: float, half: float = HALF) -> Array:
    """Return how far outside of the mole's eastern side the bed goes below `level`, in cells, along 100 m."""
    out = np.linspace(-2.0, 2.0, 401)
    places = [MIDDLE + a * ALONG + (half + CELL * out[:, None]) * ACROSS for a in np.linspace(-50.0, 50.0, 101)]
    return np.array([out[np.argmax(grid.at(line) > level)] for line in places])


def bed_of_mask(top: float) -> Grid:
    """Return the bed for nodes that are either inside the mole or not."""
    grid = Grid(np.full((41, 41), DEPTH, np.float32), 0.0, 0.0, CELL)
    part, inside = fill((mole(),), grid.north, grid.east)
    grid.depths[part][inside] = top
    return grid


def raised(top: float) -> Grid:
    grid = Grid(np.full((41, 41), DEPTH, np.float32), 0.0, 0.0, CELL)
    hazard = Hazard("SLCONS", mole(), 1.0, top, (mole(),))
    return place_hazards((hazard,), grid, np.full((41, 41), 5.0)).grid


def test_the_distance_to_an_edge_is_that_to_its_nearest_segment() -> None:
    """The area is a star, part of it off the grid, one of its segments of zero length."""
    angles = np.linspace(0.0, 2.0 * np.pi, 11)
    radius = np.where(np.arange(11) % 2, 40.0, 17.0)
    star = np.column_stack([30.0 + radius * np.cos(angles), 20.0 + radius * np.sin(angles)])
    start, end = segments([np.vstack([star[:1], star])])
    north, east = np.arange(-10.0, 44.0, 3.0), np.arange(5.0, 74.0, 3.0)
    part, found = edge_distance(start, end, north, east)
    distances = np.full((18, 23), np.inf)
    distances[part] = found
    nodes = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1)
    true = np.full((18, 23), np.inf)
    for one, other in zip(start, end, strict=True):
        places = one + np.linspace(0.0, 1.0, 1001)[:, None, None, None] * (other - one)
        true = np.minimum(true, np.hypot(*np.moveaxis(nodes - places, -1, 0)).min(axis=0) / 3.0)
    near = true < 2.49
    assert 100 < near.sum() < near.size - 50
    assert distances[near] == pytest.approx(true[near], abs=0.01)
    assert (distances[~near] > 2.48).all()
    (rows, columns), nothing = edge_distance(start + 1e3, end + 1e3, north, east)
    assert (rows, columns, nothing.size) == (slice(0, 0), slice(0, 0), 0)


@pytest.mark.parametrize("kind", ["land", "hazard"])
def test_the_water_line_of_a_mole_is_straight_as_charted(kind: str) -> None:
    """The bed leaves the edge by so many cells at most; its line of half the depth runs along it to 0.1 of a cell."""
    grid, max_offset = (build_grid(mole()), 0.1) if kind == "land" else (raised(OUT_OF_WATER), 0.25)
    assert abs(offsets(grid, 0.0)).max() < max_offset
    assert np.ptp(offsets(grid, 0.5 * DEPTH)) < 0.1
    teeth = bed_of_mask(-LAND_RISE)
    assert abs(offsets(teeth, 0.0)).max() > 0.5, "without partly covered nodes the edge is jagged"
    assert np.ptp(offsets(teeth, 0.5 * DEPTH)) > 0.8
    along = MIDDLE + np.linspace(-50.0, 50.0, 101)[:, None] * ALONG
    beyond = grid.at(along + (HALF + (FOOT_CELLS + 1.0) * CELL) * ACROSS)
    assert beyond == pytest.approx(np.full(101, DEPTH), abs=1e-3), "beyond the foot of its bank the bed is unchanged"


def test_a_bank_runs_out_without_a_bend() -> None:
    """The slopes of neighbouring cells differ by BEND at most, also across the waterline; a low bank is narrow."""
    out = np.arange(-10.0, 1.01, 0.01)  # cells
    for depth, foot in ((6.0, FOOT_CELLS), (0.4, 2.1)):
        bed = raise_with_slope(np.full(len(out), depth), np.full(len(out), -2.0), out, foot=FOOT_CELLS)
        assert bed[np.argmin(np.abs(out))] == pytest.approx(0.0, abs=1e-6)
        assert bed[out < -foot] == pytest.approx(depth)
        assert (np.diff(bed) <= 1e-6).all(), "nowhere deeper towards the edge"
        assert np.abs(np.diff(bed, 2)).max() < 1.1 * BEND * 0.01**2


def test_a_submerged_area_has_its_full_height_up_to_its_edge() -> None:
    grid = raised(2.0)
    part, inside = fill((mole(),), grid.north, grid.east)
    assert (grid.depths[part][inside] == 2.0).all()
    assert grid.depths.min() == 2.0
    assert np.ptp(offsets(grid, 4.0)) < 0.1


def test_a_mole_narrower_than_a_cell_has_no_gaps() -> None:
    """The mole is 0.8 of a cell wide: many nodes along it are beside it, and the water over them was 6 m deep."""
    crest = build_grid(mole(2.0)).at(MIDDLE + np.linspace(-60.0, 60.0, 400)[:, None] * ALONG)
    assert crest.max() < 0.5


def test_there_is_no_shore_where_two_land_areas_meet() -> None:
    """No bank is made where land ends with its chart, either."""
    whole, halves = build_grid(mole()), build_grid(mole(end=10.0), mole(start=10.0))
    assert halves.depths == pytest.approx(whole.depths, abs=1e-6)
    beyond = build_grid(np.array([(-50.0, -50.0), (-50.0, 300.0), (48.0, 300.0), (48.0, -50.0), (-50.0, -50.0)]))
    assert (beyond.depths[:8] <= -LAND_RISE).all()
    at_limit = build_grid(np.array([(-4.0, -4.0), (-4.0, 204.0), (48.0, 204.0), (48.0, -4.0), (-4.0, -4.0)]))
    assert (at_limit.depths[:8] == beyond.depths[:8]).all()


def directions(degrees: float) -> tuple[Array, Array]:
    """Return the unit vectors along and across (to the right of) a line of this heading."""
    along, across = (np.array([np.cos(a), np.sin(a)]) for a in np.radians([degrees, degrees + 90.0]))
    return along, across


def quay(degrees: float, length: float, width: float) -> tuple[Array, Array, SeabedModel]:
    """Return directions along and across a quay (to the land), and the seabed; the corners of `mole` are around it."""
    along, across = directions(degrees)
    sides = ((-length, 0.0), (length, 0.0), (length, width), (-length, width), (-length, 0.0))
    ring = np.array([MIDDLE + a * along + b * across for a, b in sides])
    wall = Hazard("SLCONS", ring, 1.0, OUT_OF_WATER, needs_water_both_sides=True, is_wall=True)
    return along, across, build_model((wall,), ring)


@pytest.mark.parametrize("degrees", [20.0, 30.0, 45.0])
def test_a_profile_along_an_oblique_quay_has_no_ripple(degrees: float) -> None:
    """The bed has its full depth up to the wall, which hides where it ends. As a bank it had ripples of 0.3 m."""
    along, across, model = quay(degrees, 400.0, 400.0)
    places = MIDDLE + np.linspace(-80.0, 80.0, 801)[:, None] * along
    for away in np.arange(0.0, 30.0, 1.0):
        profile = model.grid.at(places - away * across)
        assert np.ptp(profile) < 0.01
        assert profile.mean() == pytest.approx(DEPTH, abs=0.01)
    assert (model.grid.at(places + 20.0 * across) < 0.0).all(), "land"
    (wall,) = (box for box in model.boxes if abs(box.north - MIDDLE[0]) + abs(box.east - MIDDLE[1]) < 1.0)
    assert (wall.size_north, wall.size_east, wall.top) == (802.0, 2.0, OUT_OF_WATER)
    assert wall.heading == pytest.approx(np.radians(degrees), abs=1e-3)


def offsets_in(box: Box, places: Array) -> NDArray[np.bool_]:
    """Return which places (n, 2) are in the outline of a block."""
    sides = np.abs((places - (box.north, box.east)) @ np.column_stack(directions(np.degrees(box.heading))))
    return np.asarray((sides <= (0.5 * box.size_north + 0.01, 0.5 * box.size_east + 0.01)).all(axis=1))


@pytest.mark.parametrize("degrees", [0.0, 30.0, 45.0])
@pytest.mark.parametrize("cells", [1.0, 2.0, 3.0, 4.0])
def test_the_bed_beside_a_narrow_mole_has_no_ripple(degrees: float, cells: float) -> None:
    """The mole has walls around it and stands on the bed as blocks. As a bank it had ripples of up to 0.6 m."""
    along, across, model = quay(degrees, 60.0, cells * CELL)
    places = MIDDLE + np.linspace(-55.0, 55.0, 221)[:, None] * along
    for away in np.arange(0.0, 40.0, 1.0):
        profile = model.grid.at(places - away * across)
        assert np.ptp(profile) < 0.01
        assert profile.mean() == pytest.approx(DEPTH, abs=0.01)
    for inside in np.linspace(0.0, cells * CELL, 9):
        covered = [offsets_in(box, places + inside * across) for box in model.boxes]
        assert np.any(covered, axis=0).all(), "no water is left inside of the mole"


def test_a_structure_charted_as_an_area_is_a_block_on_the_bed() -> None:
    """The bed is not raised, so it has no bank. A slope of rubble, which is no wall, is a bank."""
    pier = Hazard("SLCONS", mole(), 1.0, OUT_OF_WATER, (mole(),), needs_water_both_sides=True, is_wall=True)
    model = build_model((pier,))
    assert model.grid.depths == pytest.approx(np.full((41, 41), DEPTH), abs=0.01)
    assert sorted((model.boxes[0].size_north, model.boxes[0].size_east)) == pytest.approx([2.0 * HALF, 140.0])
    assert build_model((pier._replace(is_wall=False),)).grid.at(MIDDLE[None]) < 0.0
    assert not build_model((pier,), mole(start=-10.0, end=10.0)).boxes, "its middle is on land"


@pytest.mark.parametrize("degrees", [0.0, 30.0, 45.0])
@pytest.mark.parametrize("cells", [1.0, 3.0])
def test_a_mole_with_a_wall_on_one_side_has_no_ripple_on_either(degrees: float, cells: float) -> None:
    """The bed has its full depth at the wall, and rises to the natural coast. As a bank it was 0.3 m deep at the wall.

    The heights are those that an altimeter measures, of the bed or of blocks on it.
    """
    along, across = directions(degrees)
    sides = ((-300.0, 0.0), (300.0, 0.0), (300.0, cells * CELL), (-300.0, cells * CELL), (-300.0, 0.0))
    ring = np.array([MIDDLE + a * along + b * across for a, b in sides])
    wall = Hazard("SLCONS", ring[:2], 1.0, OUT_OF_WATER, needs_water_both_sides=True, is_wall=True)
    model = build_model((wall,), ring, away=45.0)
    places = MIDDLE + np.linspace(-50.0, 50.0, 201)[:, None] * along

    def profile(offset: float) -> Array:
        lines = places + offset * across
        tops = [np.where(offsets_in(box, lines), box.top, np.inf) for box in model.boxes]
        return np.asarray(np.min([model.grid.at(lines), *tops], axis=0))

    for away in np.arange(1.2, 30.0, 1.0):
        assert profile(-away) == pytest.approx(DEPTH, abs=0.01)
    depths = [profile(cells * CELL + away) for away in np.arange(0.3, 30.0, 1.1)]
    assert max(np.ptp(depth) for depth in depths) < 0.03
    assert (np.diff([depth.mean() for depth in depths]) < 0.5).all(), "no step is higher"
    assert depths[1].mean() < 0.2 * DEPTH
    assert depths[-1].mean() > 0.9 * DEPTH


@pytest.mark.parametrize("degrees", [20.0, 45.0])
@pytest.mark.parametrize("slope", [0.0, 0.05, 0.125, 0.33])
def test_a_profile_along_a_natural_coast_has_no_ripple(degrees: float, slope: float) -> None:
    """The bed has this slope up to the coast, or is level and ends in a bank. It had ripples of 0.2 to 0.3 m.

    The level bed has no soundings near the coast, which would make the bank steeper.
    """
    along, across = directions(degrees)
    ring = np.array(
        [MIDDLE + a * along + b * across for a, b in ((-900, 0), (900, 0), (900, 900), (-900, 900), (-900, 0))]
    )
    north, east = (axis.ravel() for axis in np.mgrid[0:201:20, 0:201:20].astype(float))
    away = (MIDDLE - np.column_stack([north, east])) @ across
    soundings = np.column_stack([north, east, slope * away if slope else np.full(len(away), DEPTH)])
    soundings = soundings[away > (2.0 if slope else 45.0)]
    coast = np.column_stack([MIDDLE + np.linspace(-110.0, 110.0, 23)[:, None] * along, np.zeros(23)])
    everywhere = (np.array([(-9.0, -9.0), (-9.0, 209.0), (209.0, 209.0), (209.0, -9.0), (-9.0, -9.0)]),)
    sheet = Sheet("", everywhere, (DepthArea(everywhere, 0.0, 99.0),), ((ring,),))
    survey = Survey("", None, soundings, sheets=(sheet,), guides=coast if slope else np.empty((0, 3)))
    grid = build(survey, (0.0, 200.0, 0.0, 200.0), CELL).model.grid
    places = np.linspace(-60.0, 60.0, 601)
    for out in (1.0, 2.0, 5.0, 10.0):
        profile = grid.at(MIDDLE + places[:, None] * along - out * across)
        ripple = profile - np.polyval(np.polyfit(places, profile, 1), places)
        assert np.ptp(ripple) < 0.03
        assert profile.min() > 0.0
    assert (grid.at(MIDDLE + places[:, None] * along + across) < 0.0).all()
