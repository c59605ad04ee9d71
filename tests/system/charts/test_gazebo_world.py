"""Import of Gazebo worlds: positions, water, meshes and height maps."""

import re
import shutil
import warnings
from array import array
from math import pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from hil.charts.imports.gazebo_world import ImportedWorld, import_world
from hil.charts.imports.meshes import MeshJob, read_meshes
from hil.cli import main
from hil.common.errors import ConfigError
from sim.environment.world import World, load_world
from sim.rays.scene import RayScene
from sim.vehicle.vehicle import load_vehicle
from tests.support.lazy import import_lazily

pytestmark = pytest.mark.usefixtures("charts_in_process")

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
    world, notes, missing = import_world(str(bay), str(tmp_path / "bay.toml"))
    assert not missing
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
        "'model://nowhere/a.dae'", "models/Moon", "cloud/v",
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
        f'<pose>0 0 -10 0 {-pi / 6} {pi / 2}</pose><link name="l"><collision name="v"><geometry><mesh><uri>'
        "plank.stl</uri></mesh></geometry></collision></link></model></world></sdf>"
    )
    world, notes, _ = import_world(str(tmp_path / "w.sdf"), str(tmp_path / "w.toml"))
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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of pycollada, under NumPy 2.5
        exported: Any = box.export(file_type="dae")
    collada = re.sub("<(unit|up_axis)[^>]*(/>|>[^<]*</up_axis>)", "", exported.decode())
    (tmp_path / "a.dae").write_text(collada.replace("</asset>", f"{unit}{up}</asset>"))
    answers = read_meshes([MeshJob(str(tmp_path / f"a.{ending}"), (1.0, 1.0, 2.0)) for ending in endings])
    for ending, result in zip(endings, answers, strict=True):
        factor = 0.5 if ending == "dae" else 1.0
        assert result["high"] == pytest.approx([0.5 * factor, 1.0 * factor, 3.0 * factor]), ending
        assert result["volume"] == pytest.approx(12.0 * factor**3)
        assert result["is_closed"]


@pytest.mark.usefixtures("own_process")
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


def test_a_height_map_and_upright_solids_are_imported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A bed from 8 m in the south to 11.2 m in the north, to the rounding of 16 bits; a pile, and a turned block."""
    rows = np.linspace(0.0, 65535.0, 33)  # the first row is the north, the deepest
    Image.fromarray(np.repeat(np.rint(rows)[:, None], 33, axis=1).astype(np.uint16)).save(tmp_path / "h.png")
    bed = "<heightmap><uri>h.png</uri><size>32 32 3.2</size><pos>16 16 -11.2</pos></heightmap>"
    pile, block = "<cylinder><radius>1</radius><length>7</length></cylinder>", "<box><size>4 2 7</size></box>"
    models = (
        _model("bed", "0 0 0 0 0 0", _solid(bed))
        + _model("pile", "5 10 -5.5 0 0 0", _solid(pile))
        + _model("block", f"8 20 -6.5 0 0 {pi / 2 - 0.5}", _solid(block))
    )
    (tmp_path / "w.sdf").write_text(f'<sdf version="1.9"><world name="w">{models}</world></sdf>')
    assert main(["world", "import", str(tmp_path / "w.sdf"), "-o", str(tmp_path / "w")]) == 0
    assert "1 piles, 1 blocks, 0 meshes" in capsys.readouterr().out
    world = load_world(str(tmp_path / "w.toml"))
    for north, east in ((1.0, 1.0), (16.0, 3.3), (31.0, 30.0)):
        assert world.seabed(north, east) == pytest.approx(8.0 + 0.1 * north, abs=1e-3)
    assert world.cylinder[0][:3] == pytest.approx((10.0, 5.0, 1.0))
    assert world.box[0][:5] == pytest.approx((20.0, 8.0, 4.0, 2.0, 0.5), abs=1e-5)
    assert (world.cylinder[0].top, world.box[0].top) == pytest.approx((2.0, 3.0), abs=1e-3)


def _model(name: str, pose: str, shapes: str) -> str:
    return f'<model name="{name}"><static>1</static><pose>{pose}</pose><link name="l">{shapes}</link></model>'


def _solid(shape: str) -> str:
    return f'<collision name="c"><geometry>{shape}</geometry></collision>'


def _imported(tmp_path: Path, content: str) -> ImportedWorld:
    file = tmp_path / "a" / "b" / "w.sdf"  # four folders above it are searched
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f'<sdf version="1.6"><world name="w">{content}</world></sdf>')
    return import_world(str(file), str(tmp_path / "w.toml"))


@pytest.mark.parametrize(
    ("floor", "extent"),
    [
        (_solid('<box><size>2000 1200 1</size></box>'), (-600, 600, -1000, 1000)),
        (_solid('<plane><size>300 80</size></plane>'), (-40, 40, -150, 150)),
        (_solid('<plane/>'), (-47.8, 52.2, -48.2, 51.8)),
        (_solid('<plane><size>1e9 1e9</size></plane>'), (-5e3, 5e3, -5e3, 5e3)),
    ],
)  # fmt: skip
def test_a_world_is_as_large_as_its_floor(tmp_path: Path, floor: str, extent: tuple[float, ...]) -> None:
    """A pile of 1 m stands on the floor, which is not an obstacle; a plane without a size gives 100 m."""
    pile = _solid("<cylinder><radius>0.5</radius><length>4</length></cylinder>")
    world = _imported(tmp_path, _model("bed", "0 0 -20 0 0 0", floor) + _model("pile", "3 4 -18 0 0 0", pile)).world
    assert world.extent == extent
    assert world.depth == pytest.approx(20.0, abs=0.5)
    assert len(world.cylinder) == 1


def test_a_shape_without_collision_is_seen_but_not_hit(tmp_path: Path) -> None:
    """Axes are drawn at the origin: a camera sees them; contact, maps and sonars do not."""
    axis = "<geometry><box><size>2 0.1 0.1</size></box></geometry>"
    solid = f'<visual name="v">{axis}</visual><collision name="c">{axis}</collision>'
    world = _imported(
        tmp_path,
        _model("axes", "0 0 -2 0 0 0", f'<visual name="v">{axis}</visual>') + _model("rail", "9 0 -2 0 0 0", solid),
    ).world
    assert [box.name for box in world.box] == ["rail/v"]
    assert not world.mesh
    (axes,) = world.visual
    assert axes.label == "axes/v"
    ahead = array("d", (0.0, 1.0, 0.0))
    assert RayScene(world).ranges((0.0, -5.0, 2.0), ahead, 50.0)[0] == pytest.approx(13.0)
    assert RayScene(world.as_seen()).ranges((0.0, -5.0, 2.0), ahead, 50.0)[0] == pytest.approx(4.0)
    assert world.clearance(0.0, 0.0, 3.0) == pytest.approx(8.0)


def test_a_saved_world_has_the_poses_of_its_links_and_nested_models(tmp_path: Path) -> None:
    """All poses of a `<state>` are in the world: a nested link without one of its own moves with its nested model."""
    box = _solid("<box><size>1 1 1</size></box>")
    links = "".join(f'<link name="{name}"><pose>0 0 {up} 0 0 0</pose>{box}</link>' for name, up in (("a", 0), ("b", 4)))
    inner = f'<model name="in"><pose>3 0 0 0 0 0</pose>{links}</model>'
    model = f'<model name="rig"><static>1</static><pose>1 2 -9 0 0 0</pose>{links}{inner}</model>'
    state = (
        '<state world_name="w"><model name="rig"><pose>10 20 -9 0 0 1.5707963267948966</pose>'
        '<link name="a"><pose>10 20 -8.5 0 0 1.5707963267948966</pose></link>'
        '<model name="in"><pose>30 40 -7 0 0 3.141592653589793</pose><link name="a"><pose>31 40 -7 0 0 0</pose></link>'
        "</model></model></state>"
    )
    boxes = _imported(tmp_path, model + state).world.box
    found = sorted((box.north, box.east, box.top, box.bottom) for box in boxes)
    expected = [(20, 10, 4.5, 5.5), (20, 10, 8, 9), (40, 30, 2.5, 3.5), (40, 31, 6.5, 7.5)]
    assert found == [pytest.approx(place) for place in expected]


def test_a_saved_world_has_inserted_and_scaled_models_and_lacks_deleted_ones(tmp_path: Path) -> None:
    box = _solid("<box><size>1 1 1</size></box>")
    models = [
        f'<model name="{name}"><static>1</static><pose>{x} 0 -9 0 0 0</pose><link name="l">{box}</link></model>'
        for name, x in (("large", 1), ("gone", 9), ("new", 30))
    ]
    state = (
        f'<state world_name="w"><insertions>{models[2]}</insertions><deletions><name>gone</name></deletions>'
        '<model name="large"><pose>1 0 -9 0 0 0</pose><scale>2 3 4</scale></model></state>'
    )
    boxes = _imported(tmp_path, models[0] + models[1] + state).world.box
    found = sorted((box.east, box.size_north, box.size_east, box.top, box.bottom) for box in boxes)
    assert found == [pytest.approx(place) for place in ((1, 2, 3, 7, 11), (30, 1, 1, 8.5, 9.5))]


def test_missing_ground_is_an_error_and_other_missing_models_are_notes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sun and ground plane need no files. The message names what is missing, and where it was searched."""
    uris = ("model://sun", "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Ground%20Plane", "boat", "boat")
    includes = "".join(f"<include><uri>{uri}</uri></include>" for uri in uris)
    buoyancy = (
        '<plugin filename="b"><graded_buoyancy><density_change><above_depth>30</above_depth></density_change>'
        "</graded_buoyancy></plugin>"
    )
    world, notes, missing = _imported(tmp_path, buoyancy + includes)
    assert (world.extent, world.depth, missing) == ((-50.0, 50.0, -50.0, 50.0), 30.0, "")
    assert [note.split(":")[0] for note in notes] == ["Left out"]
    assert "'boat'" in notes[0]
    for content in (
        "<include><uri>model://missing_heightmap</uri></include>",
        _model(
            "m", "0 0 0 0 0 0", '<visual name="terrain"><geometry><mesh><uri>a/b.obj</uri></mesh></geometry></visual>'
        ),
        _model(
            "m",
            "0 0 0 0 0 0",
            _solid("<heightmap><uri>h.png</uri></heightmap>"),
        ),
    ):
        _imported(tmp_path, content)
        assert main(["world", "import", str(tmp_path / "a/b/w.sdf"), "-o", str(tmp_path / "out")]) == 1
        error = capsys.readouterr().err
        assert "lacks its ground" in error
        assert str(tmp_path) in error


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
