"""Forms that float: draught, trim and righting levers against formulas of naval architecture, and STL files."""

import struct
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import cos, pi, radians, sin, tan
from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from sim import rotations
from sim.rotations import from_euler
from sim.vehicle.buoyancy import Hull, volume_and_centroid
from sim.vehicle.hull_form import HullForm, Triangle, box_triangles, load_stl
from sim.vehicle.vehicle import Vehicle, load_vehicle

RHO, G = 1000.0, 9.81
PLAIN, _ = load_vehicle("paper_six")
SHORT = bytes(80) + struct.pack("<I", 12) + bytes(12 * 50 - 1)


def write_stl(path: Path, triangles: Sequence[Triangle]) -> str:
    rows = [struct.pack("<12fH", 0.0, 0.0, 0.0, *triangle, 0) for triangle in triangles]
    path.write_bytes(b"solid".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows))
    return str(path)


def grid_surface(x_of: Callable[[int, int], tuple[float, float, float]], rows: int, columns: int) -> list[Triangle]:
    """Return the triangles of a grid of points; equal corners make no triangle."""
    triangles: list[Triangle] = []
    for i in range(rows):
        for j in range(columns):
            a, b, c, d = x_of(i, j), x_of(i + 1, j), x_of(i + 1, j + 1), x_of(i, j + 1)
            triangles += [(*p, *q, *r) for p, q, r in ((a, b, c), (a, c, d)) if len({p, q, r}) == 3]
    return triangles


def prism(section: Sequence[tuple[float, float]], length: float) -> list[Triangle]:
    """Return a prism along x; `section` are y and z of its corners, clockwise seen from behind."""
    ring = [*section, section[0]]
    sides = grid_surface(lambda i, j: ((j - 0.5) * length, *ring[i]), len(section), 1)
    (y, z), corners = section[0], list(pairwise(ring))[1:-1]
    half = 0.5 * length
    ends = [(half, y, z, half, *a, half, *b) for a, b in corners] + [
        (-half, y, z, -half, *b, -half, *a) for a, b in corners
    ]
    return sides + ends


def wigley(length: float, beam: float, draught: float, cells: int = 40) -> list[Triangle]:
    """Return Wigley's hull, with a flat deck at z = 0: y = B/2 (1 - (2x/L)²) (1 - (z/T)²), down to z = T."""

    def point(i: int, j: int) -> tuple[float, float, float]:
        x, z = length * (i / cells - 0.5), draught * (1.0 - abs(j / cells - 1.0))
        y = 0.5 * beam * (1.0 - (2.0 * x / length) ** 2) * (1.0 - (z / draught) ** 2)
        return x, 0.0 if i in (0, cells) or j == cells else y if j < cells else -y, z

    deck = [(point(i, 2 * cells), point(i, 0)) for i in range(cells + 1)]
    return grid_surface(point, cells, 2 * cells) + grid_surface(lambda i, j: deck[i][j], cells, 1)


def hull_of(form: HullForm, volume: float) -> Hull:
    middle = PLAIN._replace(center_of_buoyancy=(0.0, 0.0, 0.0), neutrally_buoyant=False)
    return Hull(middle._replace(hull=form, volume=volume, mass=0.5 * RHO * volume), RHO, G)


def righting_lever(hull: Hull, share: float, heel: float) -> float:
    """Return how far the lift, `share` of the full one, lies to the low side of the origin (m) at `heel` (rad)."""
    down = rotations.matrix(from_euler(heel, 0.0, 0.0))[6:]
    low, high = -hull.reach, hull.reach
    for _ in range(44):
        depth = 0.5 * (low + high)
        low, high = (depth, high) if hull.buoyancy(depth, down)[0] < share * hull.full else (low, depth)
    lift, _, y, z = hull.buoyancy(depth, down)
    return (y * cos(heel) - z * sin(heel)) / lift


@pytest.mark.parametrize(
    ("immersed", "heel"), [(0.3, 1.0), (0.3, 3.0), (0.3, 18.0), (0.5, 3.0), (0.5, 30.0), (0.7, 10.0)]
)
def test_a_box_rights_itself_as_a_wall_sided_hull(immersed: float, heel: float) -> None:
    """The lever about the middle is (GM + BM tan² / 2) sin, with the weight in the middle, until an edge immerses."""
    width, height = 1.0, 0.6
    hull, angle = hull_of(HullForm(boxes=((0.3, -0.2, 0.1, 2.0, width, height),)), 1.2), radians(heel)
    draught = immersed * height
    radius = width**2 / 12.0 / draught
    middle = 0.5 * height - 0.5 * draught  # from the centre of the immersed part up to the weight
    expected = (radius - middle + 0.5 * radius * tan(angle) ** 2) * sin(angle)
    assert righting_lever(hull, immersed, angle) == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("immersed", [0.1, 0.3, 0.5, 0.9])
def test_a_cylinder_does_not_right_itself(tmp_path: Path, immersed: float) -> None:
    """Its lift always passes through the axis; the depth of its axis follows from the area of a circle's segment."""
    circle = [(0.2 * cos(pi * i / 90), 0.2 * sin(pi * i / 90)) for i in range(180)]
    hull = hull_of(HullForm(write_stl(tmp_path / "c.stl", prism(circle, 1.5))), pi * 0.04 * 1.5)
    for heel in (0.1, 1.0, 2.5):
        assert righting_lever(hull, immersed, heel) == pytest.approx(0.0, abs=2e-4)
    half_angle = radians(60.0)  # between the axis' vertical and the water line
    depth, share = -0.2 * cos(half_angle), (half_angle - sin(half_angle) * cos(half_angle)) / pi
    assert hull.buoyancy(depth, (0.0, 0.0, 1.0))[0] / hull.full == pytest.approx(share, rel=2e-3)


def test_a_wedge_floats_by_the_root_of_its_weight(tmp_path: Path) -> None:
    """A wedge, edge down, displaces the square of its draught; its metacentre is b² / (6 T) above the lift's centre."""
    width, height = 0.8, 0.6
    wedge = prism([(-0.5 * width, 0.0), (0.5 * width, 0.0), (0.0, height)], 2.0)
    hull = hull_of(HullForm(write_stl(tmp_path / "w.stl", wedge)), 0.5 * width * height * 2.0)
    edge = 2.0 / 3.0 * height  # below the centroid, which is the origin
    for share in (0.25, 0.5, 0.81):
        draught = height * share**0.5
        lift, _, _, z = hull.buoyancy(draught - edge, (0.0, 0.0, 1.0))
        assert lift == pytest.approx(share * hull.full, rel=1e-6)
        assert z / lift == pytest.approx(edge - 2.0 / 3.0 * draught, rel=1e-6)
        breadth = width * draught / height
        metacentre = breadth**2 / (6.0 * draught) - z / lift  # above the origin
        assert righting_lever(hull, share, 1e-4) / 1e-4 == pytest.approx(metacentre, rel=1e-3)


def test_a_ship_shaped_hull_has_its_volume_and_metacentres(tmp_path: Path) -> None:
    """Wigley's hull at its full draught: V = 4/9 L B T, KB = 5/8 T, and the second moments of its parabolic plane."""
    length, beam, draught = 4.0, 0.5, 0.25
    form = wigley(length, beam, draught)
    hull = hull_of(HullForm(write_stl(tmp_path / "s.stl", form)), 1.0)
    volume, centroid = volume_and_centroid(form)
    assert abs(volume) == pytest.approx(4.0 / 9.0 * length * beam * draught, rel=2e-3)
    assert centroid == pytest.approx((0.0, 0.0, 3.0 / 8.0 * draught), abs=2e-3 * draught)
    deck = -3.0 / 8.0 * draught  # of the origin, which is the centroid
    depth = -deck - 0.3 * draught  # 0.3 of the hull is out of the water
    z = 0.3 * draught
    share = 1.0 - 1.5 * (z / draught - z**3 / (3.0 * draught**3))
    assert hull.buoyancy(depth, (0.0, 0.0, 1.0))[0] / hull.full == pytest.approx(share, rel=3e-3)
    narrow = 1.0 - (z / draught) ** 2  # of the water plane
    second = (beam * narrow) ** 3 * length * 4.0 / 105.0
    lift, _, _, moment = hull.buoyancy(depth, (0.0, 0.0, 1.0))
    expected = second / (share * abs(volume)) - moment / lift
    assert righting_lever(hull, share, 1e-3) / 1e-3 == pytest.approx(expected, rel=0.01)


def test_text_and_binary_files_are_equal(tmp_path: Path) -> None:
    box = box_triangles((0.1, 0.0, 0.0, 2.0, 1.0, 0.5))
    text = tmp_path / "text.stl"
    corner = "vertex {} {} {}\n"
    facets = [f"facet normal 0 0 0\nouter loop\n{(3 * corner).format(*t)}endloop\nendfacet\n" for t in box]
    text.write_text("solid box\n" + "".join(facets) + "endsolid\n")
    binary = load_stl(write_stl(tmp_path / "binary.stl", box), 0.5)
    assert [list(t) for t in binary] == [pytest.approx(list(t)) for t in load_stl(str(text), 0.5)]


@pytest.mark.parametrize("content", [b"", b"solid x facet vertex a b c", bytes(84), b"PK" * 99, SHORT])
def test_what_is_no_closed_surface_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.stl"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"bad\.stl: no STL file"):
        load_stl(str(path))
    write_stl(path, box_triangles((0.0, 0.0, 0.0, 1.0, 1.0, 1.0))[1:])
    with pytest.raises(ConfigError, match="not closed"):
        load_stl(str(path))
    with pytest.raises(ConfigError, match="cannot be read"):
        load_stl(str(tmp_path / "none.stl"))


def test_a_vehicle_file_names_its_form(tmp_path: Path) -> None:
    write_stl(tmp_path / "hull.stl", box_triangles((0.0, 0.0, 0.0, 1.0, 0.5, 0.5)))
    plain = Path("sim/vehicles/paper_six.toml").read_text()
    (tmp_path / "own.toml").write_text(plain + '\n[hull]\nfile = "hull.stl"\n')
    vehicle: Vehicle = load_vehicle(str(tmp_path / "own.toml"))[0]
    assert len(Hull(vehicle, RHO, G).triangles) == 12
    (tmp_path / "own.toml").write_text(plain + "\n[hull]\nscale = 2.0\n")
    with pytest.raises(ConfigError, match="hull: give either file or boxes"):
        load_vehicle(str(tmp_path / "own.toml"))
