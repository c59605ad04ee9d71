"""Meshes of a world: axes and scale of a file, rays, contact and sensors on them, and invalid files."""

import struct
from array import array
from math import cos, inf, nan, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.common.errors import ConfigError
from hil.scenario.world_map import map_at
from sim.dynamics import Dynamics, State
from sim.environment.collision import Contact, starts_inside
from sim.environment.contact import nearest
from sim.environment.contact.meshes import MeshContact
from sim.environment.contact.nearest import distance_to_mesh
from sim.environment.mesh import MeshKeys, load_obstacle, place_triangles
from sim.environment.obstacles import Box
from sim.environment.world import World, load_world
from sim.rays.scene import RayScene
from sim.rotations import from_euler, matrix, normalise
from sim.sensors.imaging.scenery import Scenery
from sim.vehicle.collision_shape import Collision, make_shape
from sim.vehicle.vehicle import load_vehicle
from tests.support.lazy import import_lazily

trimesh = import_lazily("trimesh")

VEHICLE, _ = load_vehicle("paper_six")
EMPTY = World("sea", "test", (-50.0, 50.0, -50.0, 50.0), 30.0)
SIZES = (4.0, 2.0, 1.0)  # m forward, to the side, up


def block(folder: Path, name: str = "block.stl", scale: float = 1.0) -> str:
    """Return a block of SIZES with a mast of 1 m on its front left top corner, which no mirror image of it has."""
    parts = [trimesh.creation.box(SIZES), trimesh.creation.box((0.2, 0.2, 1.0))]
    parts[1].apply_translation((1.9, 0.9, 1.0))
    combined: Any = trimesh.util.concatenate(parts)
    if name.endswith(".glb"):  # its axes: x left, y up, z forward
        combined.apply_transform(np.array([[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]]))
    combined.apply_scale(scale / 2.0 if name.endswith(".dae") else scale)
    combined.export(str(folder / name))
    if name.endswith(".dae"):  # its unit is 2 m
        text = (folder / name).read_text()
        (folder / name).write_text(text.replace("<asset>", '<asset><unit meter="2.0"/>'))
    return name


def world_with(folder: Path, file: str = "block.stl", **keys: object) -> World:
    mesh = load_obstacle(MeshKeys(**{"file": file, "north": 10.0, "east": 0.0, "depth": 8.0, **keys}), str(folder))  # type: ignore[arg-type]
    return EMPTY._replace(mesh=(mesh,))


@pytest.mark.parametrize("name", ["block.stl", "block.obj", "block.glb", "block.dae"])
def test_every_file_format_gives_the_same_orientation(tmp_path: Path, name: str) -> None:
    """The mast is at the front, to the left and up: north-west and above of a block that is not turned."""
    block(tmp_path, name, 1000.0)
    mesh = world_with(tmp_path, name, scale=0.001).mesh[0]
    corners = np.array(mesh.placed).reshape(-1, 3)
    np.testing.assert_allclose(corners.min(axis=0), (8.0, -1.0, 6.5), atol=1e-6)
    np.testing.assert_allclose(corners.max(axis=0), (12.0, 1.0, 8.5), atol=1e-6)
    highest = corners[corners[:, 2] < 6.6]
    np.testing.assert_allclose(highest.mean(axis=0), (11.9, -0.9, 6.5), atol=0.05)
    assert (mesh.top, mesh.bottom) == pytest.approx((6.5, 8.5))


MTL = "newmtl red\nKd 0.6 0.1 0.05\nnewmtl painted\nKd 0.5 1 1\nmap_Kd paint.png\n"
OBJ = """mtllib plates.mtl
v 0 0 0
v 1 0 0
v 1 0 3
v 0 0 3
v 1 0 4
v 0 0 4
vt 0.25 0.9
vt 0.3 0.8
vt 0.5 0
usemtl red
f 1 2 3
f 1 3 4
"""


def test_an_obj_has_the_mean_colour_of_its_materials(tmp_path: Path) -> None:
    """The mean is weighted by area: a painted square meter counts a third of three red ones."""
    from PIL import Image

    (tmp_path / "plates.mtl").write_text(MTL)
    (tmp_path / "red.obj").write_text(OBJ)
    assert world_with(tmp_path, "red.obj").mesh[0].keys.colour == pytest.approx((0.6, 0.1, 0.05), abs=0.003)
    picture = np.zeros((10, 20, 3), np.uint8)
    picture[1, 5] = picture[9, 10] = (188, 255, 0)  # at the middle of each triangle; of sRGB 188, 0.503 is reflected
    Image.fromarray(picture).save(tmp_path / "paint.png")
    (tmp_path / "both.obj").write_text(OBJ + "usemtl painted\nf 4/1 3/2 5/1\nf 4/3 5/3 6/3\n")
    mean = (0.75 * 0.6 + 0.25 * 0.5 * 0.503, 0.75 * 0.1 + 0.25, 0.75 * 0.05)
    assert world_with(tmp_path, "both.obj").mesh[0].keys.colour == pytest.approx(mean, abs=0.003)
    assert world_with(tmp_path, "both.obj", colour=(0.1, 0.2, 0.3)).mesh[0].keys.colour == (0.1, 0.2, 0.3)
    assert [look[1] for look in world_with(tmp_path, "red.obj").appearances()] == [
        pytest.approx((0.6, 0.1, 0.05), abs=0.003)
    ]


def test_a_glb_has_its_base_colour_or_that_of_its_corners(tmp_path: Path) -> None:
    plate: Any = trimesh.creation.box((0.3, 0.2, 0.1))
    plate.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[51, 102, 204, 255])
    )
    plate.export(str(tmp_path / "base.glb"))
    assert world_with(tmp_path, "base.glb").mesh[0].keys.colour == pytest.approx((0.2, 0.4, 0.8), abs=0.003)
    corners: Any = trimesh.creation.box(SIZES)
    corners.visual.vertex_colors = [188, 5, 255, 255]
    corners.export(str(tmp_path / "corners.glb"))  # linear in glTF
    corners.export(str(tmp_path / "corners.ply"))  # sRGB in others
    assert world_with(tmp_path, "corners.glb").mesh[0].keys.colour == pytest.approx((0.737, 0.0196, 1.0), abs=0.003)
    assert world_with(tmp_path, "corners.ply").mesh[0].keys.colour == pytest.approx((0.503, 0.0015, 1.0), abs=0.001)


def test_files_without_or_with_unreadable_colours_have_the_common_paint(tmp_path: Path) -> None:
    """A texture outside the folder is not read, and one that is missing or damaged leaves the mesh usable."""
    folder = tmp_path / "inner"
    folder.mkdir()
    (folder / "plates.mtl").write_text("newmtl red\nmap_Kd ../outside.png\n")
    (tmp_path / "outside.png").write_bytes(b"no picture")
    (folder / "red.obj").write_text(OBJ)
    (folder / "bare.obj").write_text(OBJ.replace("plates", "missing"))
    block(folder)
    for name in ("red.obj", "bare.obj", "block.stl"):
        mesh = world_with(folder, name).mesh[0]
        assert len(mesh.triangles) >= 2 * 9
        assert mesh.keys.colour is None, name


def test_yaw_turns_a_mesh_clockwise_and_pitch_raises_its_front(tmp_path: Path) -> None:
    block(tmp_path)
    corners = np.array(world_with(tmp_path, orientation=(0.0, 0.0, 0.5 * pi)).mesh[0].placed).reshape(-1, 3)
    np.testing.assert_allclose(corners[corners[:, 2] < 6.6].mean(axis=0), (10.9, 1.9, 6.5), atol=0.05)
    pitched = np.array(world_with(tmp_path, orientation=(0.0, 0.3, 0.0)).mesh[0].placed).reshape(-1, 3)
    front = pitched[pitched[:, 0] > 10.0]
    assert front[:, 2].mean() < pitched[pitched[:, 0] < 10.0][:, 2].mean() - 0.5


def test_rays_hit_a_mesh_like_a_block(tmp_path: Path) -> None:
    """Rays hit it as a block of the same outline, from all around; object numbers follow piles and blocks."""
    trimesh.creation.box(SIZES).export(str(tmp_path / "plain.stl"))
    meshed = world_with(tmp_path, "plain.stl", orientation=(0.0, 0.0, 0.4))
    boxed = EMPTY._replace(box=(Box(10.0, 0.0, 4.0, 2.0, 0.4, 7.5, bottom=8.5),))
    directions = [
        (cos(a) * cos(b), sin(a) * cos(b), sin(b)) for a in np.arange(0.0, 6.28, 0.05) for b in (-0.2, 0.0, 0.25)
    ]
    rays = np.array(directions).ravel()
    for origin in ((4.0, 1.0, 8.1), (12.5, -3.0, 7.0), (10.0, 0.0, 3.0)):
        one, other = (RayScene(world).hits(origin, rays, 20.0) for world in (meshed, boxed))
        np.testing.assert_allclose(np.array(one.distances), np.array(other.distances), atol=1e-6)
        np.testing.assert_allclose(np.array(one.normals), np.array(other.normals), atol=1e-6)
    both = meshed._replace(box=(Box(-20.0, 0.0, 1.0, 1.0),))
    assert RayScene(both).hits((4.0, 0.0, 8.0), np.array([1.0, 0.0, 0.0]), 20.0).objects[0] == 2


def test_a_vehicle_stops_at_a_mesh_slides_below_it_and_cannot_start_in_it(tmp_path: Path) -> None:
    world = world_with(tmp_path, block(tmp_path), name="the wreck")
    inverse = Dynamics(VEHICLE, 1025.0, 9.8).inverse_mass
    contact, front, below = (Contact(VEHICLE, world, inverse), 0.5 * VEHICLE.dimensions[0], 0.5 * VEHICLE.dimensions[2])
    state = State((8.0 - front - 0.005, 0.0, 8.0))
    assert not contact.resolve(state)
    for _ in range(40):  # ahead by 5 mm a step
        state.nu = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        state.position = [state.position[0] + 0.005, *state.position[1:]]
        contact.resolve(state)
    assert contact.what == "the wreck"
    assert state.position[0] == pytest.approx(8.0 - front, abs=0.006)
    assert state.nu[0] <= 1e-4
    under = (10.0, 0.0, 8.5 + below + 0.05)
    assert not contact.resolve(State(under))
    assert not starts_inside(VEHICLE, world, under)
    assert starts_inside(VEHICLE, world, (10.0, 1.1, 8.0))
    assert not starts_inside(VEHICLE, world, (10.0, 2.0, 8.0))
    assert contact.clearance()[2] == 0.0
    far = Contact(VEHICLE, world, inverse)
    far.resolve(State((-20.0, 0.0, 8.0)))
    assert 30.0 - 3.0 < far.clearance()[2] < 30.0


@pytest.mark.parametrize("name", ["paper_six", "remus100"])
def test_each_point_of_a_hull_in_a_mesh_has_its_own_penetration(name: str) -> None:
    """A triangle faces the vehicle, 3 cm nearer than the hull reaches in that direction, or 2 cm from its origin."""
    shape, chance = make_shape(Collision(), load_vehicle(name)[0].dimensions), np.random.default_rng(3)
    out, radius = -np.array(matrix(from_euler(0.3, 0.4, 0.6)))[::3], shape.points[0][3]
    for number, attitude in enumerate(chance.normal(0.0, 1.0, (40, 4)).tolist()):
        rotation = matrix(normalise(attitude))
        inward = -out @ np.array(rotation).reshape(3, 3)  # along body axes
        reach = max(inward @ np.array(point[:3]) + point[3] for point in shape.points)
        gap = reach - 0.03 if number % 2 else 0.02
        keys = [MeshKeys("", 5.0 - a, 1.0, 10.0, (0.3, 0.4, 0.6), name=str(a)) for a in (99.0, 0.0)]
        plates = [place_triangles(each, array("d", [0, -9, -9, 0, 9, -9, 0, 0, 9])) for each in keys]
        contact = MeshContact(EMPTY._replace(mesh=tuple(plates)), shape)
        found = list(contact.touches((np.array([5.0, 1.0, 10.0]) + gap * out).tolist(), rotation))
        assert max(depth for depth, *_ in found) == pytest.approx(reach - gap, abs=0.2 * radius + 1e-9)
        for depth, normal, point, label in found:
            assert normal == pytest.approx(out, abs=1e-9)
            assert label == "0.0"
            assert depth == pytest.approx(-out @ point - gap, abs=1e-6)
            at = np.abs(point @ np.array(rotation).reshape(3, 3))
            size = np.linalg.norm(at - np.minimum(at, (shape.points[0][0], 0, 0))) - radius if radius else 0.0
            assert size <= 1e-9, "on the hull, or on the axis within a capsule's ends"


def test_a_mesh_is_on_the_map_at_its_depths(tmp_path: Path) -> None:
    world = world_with(tmp_path, block(tmp_path))
    level = map_at(world, 8.0, 0.3, 0.25)
    assert not level.is_free((8.1, 0.9))
    assert not level.line_is_free((10.0, -3.0), (10.0, 0.0)), "its sides have no gap; it has no inside"
    assert level.is_free((7.5, 0.0))
    mast = map_at(world, 6.9, 0.3, 0.25)
    assert not mast.is_free((11.9, -0.9))
    assert mast.is_free((10.0, 0.0))
    assert map_at(world, 9.5, 0.3, 0.25).is_free((10.0, 0.0))
    assert world.clearance(10.0, 3.0, 8.0, height=0.5) == pytest.approx(2.0)
    assert world.clearance(10.0, 0.0, 6.9, height=0.3) == pytest.approx(2.0, abs=0.2), "to the mast"
    assert world.clearance(10.0, 0.0, 5.0, height=0.3) == inf


def test_a_camera_shows_the_colour_of_a_mesh(tmp_path: Path) -> None:
    world = world_with(tmp_path, block(tmp_path), colour=(0.9, 0.1, 0.2))
    assert Scenery(world, 2).colours[1] == pytest.approx((0.9, 0.1, 0.2))
    assert Scenery(world_with(tmp_path), 2).colours[1] != pytest.approx((0.9, 0.1, 0.2))


HEAD = 'name = "w"\nsource = ""\nextent = [-50, 50, -50, 50]\ndepth = 30\n'


def test_a_world_file_names_mesh_files_relative_to_itself(tmp_path: Path) -> None:
    block(tmp_path)
    (tmp_path / "w.toml").write_text(
        HEAD + '[[mesh]]\nfile = "block.stl"\nnorth = 10\neast = 0\ndepth = "8 m"\norientation = [0, 0, "90 deg"]\n'
    )
    (mesh,) = load_world(str(tmp_path / "w.toml")).mesh
    assert len(mesh.triangles) == 24 * 9
    assert mesh.label == "the mesh at (10, 0)"
    assert load_world(str(tmp_path / "w.toml")).obstacles() == (mesh,)


@pytest.mark.parametrize(
    ("text", "output"),
    [
        ('[[mesh]]\nfile = "none.stl"\nnorth = 0\neast = 0\n', "none.stl: no such file"),
        ('[[mesh]]\nfile = "broken.stl"\nnorth = 0\neast = 0\n', r"mesh\[0\]: file: .*broken.stl: no"),
        ('[[mesh]]\nfile = "text.glb"\nnorth = 0\neast = 0\n', r"text.glb: no mesh that .*: damaged, or no .glb"),
        ('[[mesh]]\nfile = "block.stl"\nnorth = 0\neast = 0\nscale = 1e-6\n', "block.stl: is .* large, .*: set scale"),
        ('[[mesh]]\nfile = "nan.stl"\nnorth = 0\neast = 0\n', r"nan.stl: no triangles, or corners that are no numbers"),
        ('[[mesh]]\nfile = "block.xyz"\nnorth = 0\neast = 0\n', r"block.xyz: its ending is that of no mesh .* .stl"),
        ('[[mesh]]\nfile = "large.stl"\nnorth = 0\neast = 0\n', r"5200000 triangles are more than 5000000: simplify"),
        ('[[mesh]]\nfile = "block.stl"\nnorth = 0\neast = 0\nup = "x"\n', "'x' is not one of"),
        ('[[mesh]]\nfile = "block.stl"\nnorth = 90\neast = 0\n', r"the mesh at \(90, 0\) is outside the extent"),
        (
            '[[mesh]]\nfile = "block.stl"\nnorth = 0\neast = 0\nscale = 1000.0\n',
            r"the mesh at \(0, 0\) reaches .* m from its place, far out of the world: if its file is in millimetres",
        ),
        ('[[mesh]]\nfile = "block.stl"\nnorth = 0\neast = 0\ndepth = 90\n', r"the mesh at \(0, 0\) has its top in the"),
        ('mesh = "block.stl"\n', r"mesh: expected tables, each under \[\[mesh\]\]"),
    ],
)
def test_invalid_meshes_are_refused(tmp_path: Path, text: str, output: str) -> None:
    block(tmp_path)
    (tmp_path / "broken.stl").write_bytes(b"solid nothing\n" + bytes(range(256)))
    (tmp_path / "text.glb").write_text("no mesh")
    first_corner = 84 + 12
    whole = (tmp_path / "block.stl").read_bytes()
    (tmp_path / "nan.stl").write_bytes(whole[:first_corner] + struct.pack("<f", nan) + whole[first_corner + 4 :])
    (tmp_path / "block.xyz").write_bytes((tmp_path / "block.stl").read_bytes())
    with (tmp_path / "large.stl").open("wb") as large:
        large.write(bytes(80) + (5_200_000).to_bytes(4, "little"))
        large.truncate(84 + 50 * 5_200_000)
    (tmp_path / "w.toml").write_text(HEAD + text)
    with pytest.raises(ConfigError, match=output):
        load_world(str(tmp_path / "w.toml"))


def test_a_large_mesh_has_the_distance_of_its_nearest_triangle(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search in the tree gives what all triangles between two depths give; numpy places them to the last bit."""
    rng = np.random.default_rng(1)
    corners = rng.uniform(-20.0, 20.0, (300, 1, 3)) + rng.normal(0.0, 1.0, (300, 3, 3))
    keys = MeshKeys("", 3.0, -4.0, 25.0, (0.3, -0.2, 1.0))
    mesh = place_triangles(keys, array("d", corners.ravel()))
    for north, east, low in rng.uniform(0.0, 40.0, (40, 3)):
        expected = min(nearest._to_triangle(north, east, each) for each in mesh.between(low, low + 3.0))
        assert distance_to_mesh(mesh, north, east, low, low + 3.0) == pytest.approx(expected, abs=1e-9)
    monkeypatch.setattr("sim.environment.mesh._numpy", lambda: None)
    assert place_triangles(keys, mesh.triangles) == mesh
    assert place_triangles(keys, mesh.triangles).placed == mesh.placed
