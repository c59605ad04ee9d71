"""STL meshes: binary and text files, a vehicle's meshes from URDF, and its picture."""

import struct
from pathlib import Path

import pytest

from hil.commands.vehicle.import_urdf import to_toml
from hil.plots import vehicle_picture
from hil.plots.stl import read_stl
from sim.rotations import from_euler, rotate
from sim.vehicle.meshes import Mesh
from sim.vehicle.urdf.importer import read_urdf
from sim.vehicle.vehicle import load_vehicle

CORNERS = [((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, 0.0)), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 3.0))]
HYDRA = Path(__file__).parents[2] / "vectors" / "hydra.urdf"


def binary() -> bytes:
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *(x for corner in t for x in corner), 0) for t in CORNERS)
    return bytes(80) + struct.pack("<I", len(CORNERS)) + rows


def text() -> bytes:
    facets = ["".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle) for triangle in CORNERS]
    return "".join(["solid a\n", *(f"facet normal 0 0 0\nouter loop\n{f}endloop\nendfacet\n" for f in facets)]).encode()


@pytest.mark.parametrize("data", [binary(), text()], ids=["binary", "text"])
def test_binary_and_text_files_have_the_same_triangles(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(data)
    assert read_stl(str(path)).tolist() == [[list(corner) for corner in triangle] for triangle in CORNERS]


def test_a_mesh_is_imported_with_its_urdf(tmp_path: Path) -> None:
    """The mesh is on a turned link; its corners in FRD are those of FLU with two signs changed, also through TOML."""
    (tmp_path / "pack" / "meshes").mkdir(parents=True)
    stl = tmp_path / "pack" / "meshes" / "hull.stl"
    stl.write_bytes(binary())
    visual = (
        '<visual><origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/><geometry>'
        '<mesh filename="package://pack/meshes/hull.stl" scale="0.1 0.1 0.1"/></geometry></visual>'
    )
    urdf = tmp_path / "pack" / "urdf" / "hydra.urdf"
    urdf.parent.mkdir()
    urdf.write_text(
        HYDRA.read_text().replace('<link name="hydra/base_link">', f'<link name="hydra/base_link">{visual}', 1)
    )
    vehicle, notes = read_urdf(str(urdf))
    (mesh,) = vehicle.meshes
    assert mesh.file == str(stl)
    flu = rotate(from_euler(0.4, -0.5, 0.6), (1.0, 2.0, 3.0))  # the same angles as URDF's, fixed axes or moving ones
    frd = rotate(from_euler(*mesh.orientation), (1.0, 2.0, 3.0))
    assert frd == pytest.approx((flu[0], -flu[1], -flu[2]))
    assert mesh.position == pytest.approx((0.1, -0.2, -0.3))
    toml = tmp_path / "hydra.toml"
    toml.write_text(to_toml(vehicle, notes))
    (again,) = load_vehicle(str(toml))[0].meshes
    assert again.orientation == pytest.approx(mesh.orientation)
    assert again._replace(orientation=mesh.orientation) == mesh


def test_the_vehicle_picture_shows_its_mesh(tmp_path: Path) -> None:
    stl = tmp_path / "hull.stl"
    stl.write_bytes(binary())
    vehicle, _ = load_vehicle("paper_six")
    plain_picture, dressed = tmp_path / "plain.png", tmp_path / "dressed.png"
    vehicle_picture.draw(vehicle, (), str(plain_picture))
    meshes = (Mesh(str(tmp_path / "hull.dae"), scale=(0.1, 0.1, 0.1)), Mesh("nowhere.stl"))  # the .stl beside the .dae
    vehicle_picture.draw(vehicle._replace(meshes=meshes), (), str(dressed))
    assert dressed.read_bytes() != plain_picture.read_bytes()
