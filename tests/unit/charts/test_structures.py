"""Structures and floating objects of a chart: which are in the world, in which shape, and how deep they reach."""

import numpy as np
import pytest

from hil.charts.grid import Grid
from hil.charts.hazards import OUT_OF_WATER, SeabedModel, hazards_of, place_hazards
from hil.charts.sources.s57 import Feature
from sim.environment.obstacles import STANDING, Box

Lines = tuple[tuple[tuple[float, float], ...], ...]


def place_structures(kind: str, lines: Lines = (), is_area: bool = False, **attributes: float) -> SeabedModel:
    """Return a chart's structures in water 8 m deep up to the shore, on a grid of 5 m."""
    depths = np.full((21, 21), 8.0, np.float32)
    depths[13:] = -1.0
    grid = Grid(depths, 0.0, 0.0, 5.0)
    edges = tuple(np.array(line) for line in lines)
    points = np.empty((0, 2))
    if not lines:
        points = np.array([[20.0, 30.0]])
    hazards = hazards_of(Feature(kind, attributes, points, edges, is_area), points, edges)
    return place_hazards(tuple(hazards), grid, np.full((21, 21), 3.0))


def ring(*corners: tuple[float, float]) -> Lines:
    return ((*corners, corners[0]),)


def test_a_pier_stands_in_the_water_and_a_quay_at_its_edge() -> None:
    """The pier reaches from the shore 40 m to the south; what is along the shore has water on one side alone.

    There a wall is an obstacle if the water before it is deep, a slope of rocks or a dam is the edge of the land.
    """
    pier, quay = ((58.0, 50.0), (20.0, 50.0)), ((59.0, 10.0), (59.0, 90.0))
    (_, wall) = place_structures("SLCONS", (pier, quay), WATLEV=2.0, CATSLC=6.0).boxes
    assert (wall.north, wall.east, wall.size_north, wall.top) == (59.0, 50.0, 82.0, OUT_OF_WATER)
    for kind, keys in (("SLCONS", {"CATSLC": 8.0}), ("CAUSWY", {}), ("DAMCON", {})):
        (box,) = place_structures(kind, (pier, quay), False, WATLEV=2.0, **keys).boxes
        assert (box.north, box.east) == (39.0, 50.0)
        assert box.size_north == pytest.approx(38.0 + box.size_east)
        assert (box.top, box.bottom) == (OUT_OF_WATER, STANDING)
        assert abs(np.sin(box.heading)) < 1e-3


def test_structures_that_cover_or_stay_submerged_have_their_tops() -> None:
    pier: Lines = (((50.0, 50.0), (20.0, 50.0)),)
    assert place_structures("SLCONS", pier, WATLEV=4.0).boxes[0].top == 0.0
    assert place_structures("SLCONS", pier, WATLEV=3.0).boxes[0].top == 3.0, "up to the shoal limit, as of a wreck"
    assert place_structures("SLCONS", pier).boxes[0].top == OUT_OF_WATER


def test_a_pontoon_floats_above_the_bed() -> None:
    for kind, draught in (("PONTON", 1.0), ("HULKES", 4.0), ("FLODOC", 5.0)):
        result = place_structures(kind, ring((20.0, 20.0), (20.0, 50.0), (28.0, 50.0), (28.0, 20.0)), True)
        (box,) = result.boxes
        assert sorted((box.size_north, box.size_east)) == [8.0, 30.0]
        assert (box.north, box.east, box.bottom) == (24.0, 35.0, draught)
        assert result.grid.depths.max() == result.grid.at(np.array([[24.0, 35.0]]))[0] == 8.0, "the bed is unchanged"
    (point,) = place_structures("OBSTRN", WATLEV=7.0).cylinders
    assert (point.top, point.bottom) == (OUT_OF_WATER, 1.0)


def test_beacons_and_platforms_stand_and_buoys_float() -> None:
    """A beacon and a platform reach from the bed into the air, a buoy, and a mooring that is one, a metre down."""
    for kind in ("BCNLAT", "BCNSPP", "OFSPLF", "FSHFAC", "LNDMRK", "BUISGL"):
        (mark,) = place_structures(kind).cylinders
        assert (mark.top, mark.bottom) == (OUT_OF_WATER, STANDING)
    for kind in ("BOYLAT", "BOYSPP", "BOYINB"):
        (buoy,) = place_structures(kind).cylinders
        assert (buoy.radius, buoy.top, buoy.bottom) == (1.0, OUT_OF_WATER, 1.0)
    assert place_structures("MORFAC", CATMOR=7.0).cylinders[0].bottom == 1.0
    assert place_structures("MORFAC", CATMOR=1.0, WATLEV=2.0).cylinders[0].bottom == STANDING
    booms = place_structures("LOGPON", ring((20.0, 20.0), (20.0, 50.0), (28.0, 50.0), (28.0, 20.0)), True)
    assert booms.boxes[0].bottom == 1.0
    fishery = place_structures("FSHFAC", ring((20.0, 20.0), (20.0, 50.0), (28.0, 50.0), (28.0, 20.0)), True)
    assert not fishery.boxes
    assert fishery.grid.depths.max() == 8.0, "an area with stakes in it is a zone, not land"


def test_an_area_that_is_not_a_rectangle_retains_its_outline() -> None:
    """Two fingers of 2 m on a stem have water between them."""
    comb = ring(
        (10.0, 10.0), (40.0, 10.0), (40.0, 12.0), (12.0, 12.0), (12.0, 40.0), (40.0, 40.0), (40.0, 42.0), (10.0, 42.0)
    )  # fmt: skip
    boxes = place_structures("PONTON", comb, True).boxes
    assert len(boxes) == 8

    def distance_to(north: float, east: float) -> float:
        return min(box.separation(north, east)[0] for box in boxes)

    assert distance_to(30.0, 26.0) > 10.0
    assert all(distance_to(north, 11.0) <= 0.0 for north in (11.0, 25.0, 39.0))
    assert distance_to(11.0, 25.0) <= 0.0


def test_a_line_with_many_corners_is_simplified() -> None:
    """An arc of 10 degrees in 50 pieces is within half a metre of its chord."""
    angles = np.linspace(0.0, np.radians(10.0), 51)
    arc = tuple(
        zip((10.0 + 100.0 * np.sin(angles)).tolist(), (30.0 + 100.0 * (1.0 - np.cos(angles))).tolist(), strict=True)
    )
    boxes: tuple[Box, ...] = place_structures("PONTON", (arc,)).boxes
    assert len(boxes) <= 3
    assert max(min(box.separation(*point)[0] for box in boxes) for point in arc) <= 0.0
