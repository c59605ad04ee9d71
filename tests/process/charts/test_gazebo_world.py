"""Import of Gazebo worlds: positions, water, meshes; and a round trip of an exported world."""

import re
import shutil
from math import pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.charts.imports.gazebo_world import import_world
from hil.charts.imports.meshes import MeshJob, read_meshes
from hil.cli import main
from hil.common.errors import ConfigError
from sim.environment.world import World, load_world
from sim.vehicle.vehicle import load_vehicle
from tests.support.lazy import import_lazily

trimesh = import_lazily("trimesh")

OTTER = Path(__file__).parents[2] / "vectors" / "otter"


@pytest.fixture
def bay(tmp_path: Path) -> Path:
    """Return the bay of the vectors with its wreck: a block of 2 x 1 x 1 m that the world doubles along its x."""
    folder = tmp_path / "gazebo"
    shutil.copytree(OTTER, folder)
    trimesh.creation.box((2.0, 1.0, 1.0)).export(str(folder / "wreck.stl"))
    return folder / "bay.sdf"


def test_an_imported_world_keeps_its_positions_and_water(bay: Path, tmp_path: Path) -> None:
    """The file has east, north, up with the water at 2 m: north is y, east is x, depth is 2 - z."""
    world, notes = import_world(str(bay), str(tmp_path / "bay.toml"))
    assert (world.name, world.depth, world.density, world.gravity) == ("bay", 10.0, 1010.0, 9.8)
    assert world.origin == (54.1, 12.1)
    assert world.current == (0.0, 0.5, 0.0)
    strength, down, east = world.magnetic_field or (0.0, 0.0, 0.0)
    assert strength == pytest.approx(np.hypot(np.hypot(2e-6, 2e-5), 4e-5), abs=1e-9)
    assert down > 1.0
    assert east == pytest.approx(np.arctan2(2e-6, 2e-5))
    (pile,) = world.cylinder
    assert (pile.north, pile.east, pile.radius, pile.top, pile.bottom) == (20.0, 10.0, 0.5, -13.0, 17.0)
    (block,) = world.box
    assert (block.north, block.east, block.size_north, block.size_east) == (5.0, -10.0, 4.0, 2.0)
    assert (block.heading, block.top, block.bottom) == pytest.approx((radians(60.0), 6.5, 9.5))
    ball, wreck = world.mesh
    assert (ball.north, ball.east, ball.keys.colour) == (-12.0, 0.0, (0.8, 0.1, 0.1))
    assert (ball.top, ball.bottom) == pytest.approx((4.5, 7.5))
    assert _corners(world, 1) == pytest.approx(np.array([[-5.5, 13.0, 8.5], [-4.5, 17.0, 9.5]]))
    assert (wreck.north, wreck.east) == (-5.0, 15.0)
    for message in (
        "that can move: drifter, swimmer", "sea/surface, which shows the water", "sea/water_volume, which shows",
        "'model://nowhere/a.dae'", "models/Sun", "cloud/v",
    ):  # fmt: skip
        assert any(message in note for note in notes), message


def _corners(world: World, number: int) -> np.ndarray:
    places = np.array(world.mesh[number].placed).reshape(-1, 3)
    return np.array([places.min(axis=0), places.max(axis=0)])


def test_a_rotated_mesh_stays_rotated(tmp_path: Path) -> None:
    """A plank of 4 m along x is turned to the north by its yaw and raised at its end by its pitch."""
    trimesh.creation.box((4.0, 0.1, 0.1)).export(str(tmp_path / "plank.stl"))
    (tmp_path / "w.sdf").write_text(
        '<sdf version="1.9"><world name="w"><model name="plank"><static>true</static>'
        f'<pose>0 0 -10 0 {-pi / 6} {pi / 2}</pose><link name="l"><visual name="v"><geometry><mesh><uri>plank.stl</uri>'
        "</mesh></geometry></visual></link></model></world></sdf>"
    )
    world, notes = import_world(str(tmp_path / "w.sdf"), str(tmp_path / "w.toml"))
    places = np.array(world.mesh[0].placed).reshape(-1, 3)
    north = places[np.argmax(places[:, 0])]
    assert north == pytest.approx((2.0 * np.cos(pi / 6), 0.0, 9.0), abs=0.1)
    assert any("The file gives no depth" in note for note in notes)


def test_meshes_of_every_format_have_their_size(tmp_path: Path) -> None:
    """Gazebo reads the unit of a COLLADA file, and its axes as they are."""
    box, endings = trimesh.creation.box((1.0, 2.0, 3.0)), ("stl", "obj", "glb", "dae")
    for ending in endings[:-1]:
        box.export(str(tmp_path / f"a.{ending}"))
    unit, up = '<unit name="half" meter="0.5"/>', "<up_axis>Y_UP</up_axis>"
    exported: Any = box.export(file_type="dae")
    collada = re.sub("<(unit|up_axis)[^>]*(/>|>[^<]*</up_axis>)", "", exported.decode())
    (tmp_path / "a.dae").write_text(collada.replace("</asset>", f"{unit}{up}</asset>"))
    answers = read_meshes([MeshJob(str(tmp_path / f"a.{ending}"), (1.0, 1.0, 2.0)) for ending in endings])
    for ending, result in zip(endings, answers, strict=True):
        factor = 0.5 if ending == "dae" else 1.0
        assert result["high"] == pytest.approx([0.5 * factor, 1.0 * factor, 3.0 * factor]), ending
        assert result["volume"] == pytest.approx(12.0 * factor**3)
        assert result["is_closed"]


def test_a_hostile_mesh_gives_an_error_and_the_next_is_read(tmp_path: Path) -> None:
    """A mesh is damaged, expands entities, or is none; the next one is read all the same."""
    (tmp_path / "bad.stl").write_bytes(b"\0" * 200)
    (tmp_path / "bomb.dae").write_text('<!DOCTYPE c [<!ENTITY a "ha">]><COLLADA>&a;</COLLADA>')
    (tmp_path / "notes.txt").write_text("no mesh")
    trimesh.creation.box((1.0, 1.0, 1.0)).export(str(tmp_path / "good.stl"))
    names = ("bad.stl", "bomb.dae", "notes.txt", "nowhere.stl", "good.stl")
    *bad, valid_mesh = read_meshes([MeshJob(str(tmp_path / name)) for name in names])
    assert all("error" in answer for answer in bad)
    assert "declares the XML entity 'a'" in bad[1]["error"]
    assert valid_mesh["triangles"] == 12


def test_an_exported_world_is_imported_unchanged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Depths come back to the rounding of 16 bits, and so does every pile and block."""
    (tmp_path / "w.toml").write_text(
        'name = "w"\nsource = "test"\nextent = [0.0, 32.0, 0.0, 32.0]\ndepth = 12.0\norigin = [10.0, 20.0]\n'
        '[terrain]\nkind = "slope"\ndepth = 8.0\nslope = 0.1\nresolution = 1.0\n'
        "[[cylinder]]\nnorth = 10.0\neast = 5.0\nradius = 1.0\ntop = 2.0\n"
        "[[box]]\nnorth = 20.0\neast = 8.0\nsize_north = 4.0\nsize_east = 2.0\nheading = 0.5\ntop = 3.0\n"
    )
    before = load_world(str(tmp_path / "w.toml"))
    assert main(["world", "export", str(tmp_path / "w.toml"), str(tmp_path / "w.sdf")]) == 0
    assert main(["world", "import", str(tmp_path / "w.sdf"), "-o", str(tmp_path / "back")]) == 0
    assert "1 piles, 1 blocks, 0 meshes" in capsys.readouterr().out
    after = load_world(str(tmp_path / "back.toml"))
    assert after.origin == before.origin
    for place in ((1.0, 1.0), (16.0, 3.3), (31.0, 30.0)):
        assert after.seabed(*place) == pytest.approx(before.seabed(*place), abs=1e-3)
    for ours, theirs in ((before.cylinder[0], after.cylinder[0]), (before.box[0], after.box[0])):
        assert theirs[:4] == pytest.approx(ours[:4])
        assert theirs.top == pytest.approx(ours.top, abs=1e-3)
    assert after.box[0].heading == pytest.approx(0.5, abs=1e-5)


def test_a_file_without_a_usable_world_is_refused(tmp_path: Path) -> None:
    model, floor = tmp_path / "m.sdf", tmp_path / "f.sdf"
    model.write_text('<sdf version="1.9"><model name="m"><link name="l"/></model></sdf>')
    floor.write_text(
        '<sdf version="1.9"><world name="w"><model name="g"><static>1</static><link name="l"><collision name="c">'
        "<geometry><plane/></geometry></collision></link></model></world></sdf>"
    )
    far_world = tmp_path / "far.sdf"
    far_world.write_text(floor.read_text().replace("<plane/>", "<box><size>1 1 1</size></box>").replace(
        '<link name="l">', '<pose>1e8 0 -3 0 0 0</pose><link name="l">'
    ))  # fmt: skip
    assert import_world(str(far_world), str(tmp_path / "x.toml")).notes[0].startswith("Left out: more than 90000 m")
    with pytest.raises(ConfigError, match=r"has no <world>: import a vehicle with .* an <include> of it"):
        import_world(str(model), str(tmp_path / "x.toml"))
    with pytest.raises(ConfigError, match="give --surface M"):
        import_world(str(floor), str(tmp_path / "x.toml"))
    assert import_world(str(floor), str(tmp_path / "x.toml"), 5.0).world.depth == 5.0


def test_an_imported_vehicle_and_its_scenario_are_valid(
    bay: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command writes the vehicle and a scenario with its sensors; both are read again."""
    out, flight = tmp_path / "otter.toml", tmp_path / "flight.toml"
    command = ["vehicle", "--import", str(bay), "-o", str(out), "--flight", str(flight)]
    assert main(command) == 0
    output = capsys.readouterr().out
    assert "swimmer, 20.5 kg, 1 thrusters, 1 fins" in output
    assert "a scenario with it, with imu, laser, dvl" in output
    assert load_vehicle(str(out))[0].channels == ("propeller", "rudder")
    assert main(["scenario", "check", str(flight)]) == 0
    assert main(command[:-2]) == 0
    assert "--flight FILE.toml writes one" in capsys.readouterr().out
    assert main([*command[:3], "--flight", str(flight)]) == 2
    assert "give --output FILE.toml too" in capsys.readouterr().err
