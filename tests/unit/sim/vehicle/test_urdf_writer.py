"""Written URDF is read by independent parsers, and imported again by our own importer."""

import io
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
from urdf_parser_py.urdf import URDF

from hil.common.schema import preset_names
from sim.vehicle.meshes import Mesh
from sim.vehicle.urdf.importer import read_urdf
from sim.vehicle.urdf.writer import urdf_of
from sim.vehicle.vehicle import Vehicle, load_vehicle
from tests.support.lazy import import_lazily

yourdfpy = import_lazily("yourdfpy")

PRESETS = preset_names("sim/vehicles")
SAME = (
    "mass", "volume", "dimensions", "inertia", "center_of_gravity", "center_of_buoyancy", "added_mass",
    "linear_damping", "quadratic_damping", "neutrally_buoyant",
)  # fmt: skip


def imported(vehicle: Vehicle, prefix: str = "") -> Vehicle:
    return read_urdf("written.urdf", {}, urdf_of(vehicle, prefix).encode())[0]


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("prefix", ["", "uuv1/"])
def test_our_importer_reads_the_same_vehicle(name: str, prefix: str) -> None:
    vehicle, _ = load_vehicle(name)
    written = imported(vehicle, prefix)
    assert {key: getattr(written, key) for key in SAME} == {key: getattr(vehicle, key) for key in SAME}
    for thruster, copy in zip(vehicle.thrusters, written.thrusters, strict=True):
        assert (copy.name, copy.position) == (thruster.name, thruster.position)
        assert copy.unit_direction == pytest.approx(thruster.unit_direction, abs=1e-12)
        limits = thruster.max_forward, thruster.max_reverse, thruster.time_constant
        assert (copy.max_forward, copy.max_reverse, copy.time_constant) == limits
    assert len(written.fins) == len(vehicle.fins)
    for fin, written_fin in zip(vehicle.fins, written.fins, strict=True):
        assert written_fin._asdict().keys() == fin._asdict().keys()
        assert written_fin._replace(chord=fin.chord, axis=fin.axis) == fin
        for one, other in zip(fin.frame, written_fin.frame, strict=True):
            assert other == pytest.approx(one, abs=1e-12)


@pytest.mark.parametrize("name", PRESETS)
def test_independent_parsers_read_it(name: str) -> None:
    vehicle, _ = load_vehicle(name)
    text = urdf_of(vehicle, "uuv1/").encode()
    names = [thruster.name for thruster in vehicle.thrusters] + [fin.name for fin in vehicle.fins]
    links = {"uuv1/base_link", *[f"uuv1/{part}_link" for part in names]}
    robot = yourdfpy.URDF.load(io.BytesIO(text), load_meshes=False)
    assert robot.validate()
    assert set(robot.link_map) == links
    assert set(robot.joint_map) == set(names)
    assert {link.name for link in URDF.from_xml_string(text).links} == links


def test_thrusters_push_along_x_and_fins_turn_with_their_deflection() -> None:
    vehicle, _ = load_vehicle("remus100")
    robot = yourdfpy.URDF.load(io.BytesIO(urdf_of(vehicle).encode()), load_meshes=False)
    propeller = robot.get_transform("propeller_link", "base_link")
    assert propeller[:3, 0] == pytest.approx([1.0, 0.0, 0.0])
    rudder = next(fin for fin in vehicle.fins if fin.name == "rudder")
    robot.update_cfg({"rudder": 0.2})
    chord, normal = (np.array([x, -y, -z]) for x, y, z in rudder.frame)  # to FLU
    turned = robot.get_transform("rudder_link", "base_link")[:3, :3] @ chord
    assert turned == pytest.approx(cos(0.2) * chord + sin(0.2) * normal)


def test_a_full_inertia_matrix_is_written_in_turned_axes() -> None:
    vehicle = load_vehicle("paper_six")[0]._replace(inertia=(0.2, 0.01, -0.02, 0.01, 0.3, 0.03, -0.02, 0.03, 0.4))
    assert imported(vehicle).inertia == vehicle.inertia
    tensor = URDF.from_xml_string(urdf_of(vehicle).encode()).links[0].inertial.inertia
    assert (tensor.ixy, tensor.ixz, tensor.iyz) == (-0.01, 0.02, 0.03)  # products with x change their sign


def test_a_mesh_retains_its_position_and_orientation(tmp_path: Path) -> None:
    mesh = Mesh(str(tmp_path / "hull.stl"), (0.1, 0.2, 0.3), (0.4, -0.5, 2.6), (0.001, 0.001, 0.002))
    (back,) = imported(load_vehicle("paper_six")[0]._replace(meshes=(mesh,))).meshes
    assert (back.file, back.position, back.scale) == (mesh.file, mesh.position, mesh.scale)
    assert back.orientation == pytest.approx(mesh.orientation)


def test_names_with_xml_characters_are_escaped() -> None:
    vehicle = load_vehicle("paper_six")[0]
    thruster = vehicle.thrusters[0]._replace(name='<a> & "b"', direction=(0.0, 0.0, 2.0))
    back = imported(vehicle._replace(name="<&>", thrusters=(thruster,)))
    assert (back.name, back.thrusters[0].name) == ("<&>", '<a> & "b"')
    assert back.thrusters[0].unit_direction == pytest.approx((0.0, 0.0, 1.0))
