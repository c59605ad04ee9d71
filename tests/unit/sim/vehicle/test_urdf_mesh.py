"""A vehicle's meshes from URDF."""

import struct
from pathlib import Path

import pytest

from hil.commands.vehicle.import_urdf import to_toml
from sim.rotations import from_euler, rotate
from sim.vehicle.urdf.importer import read_urdf
from sim.vehicle.vehicle import load_vehicle

CORNERS = [((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, 0.0)), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 3.0))]
HYDRA = Path(__file__).parents[3] / "vectors" / "hydra.urdf"


def binary() -> bytes:
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *(x for corner in t for x in corner), 0) for t in CORNERS)
    return bytes(80) + struct.pack("<I", len(CORNERS)) + rows


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
