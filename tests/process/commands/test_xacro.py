"""A vehicle from a xacro file with macros, arguments and packages, without ROS."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from hil.cli import main
from hil.commands.vehicle import xacro_expand
from hil.commands.vehicle.xacro_expand import expand, is_xacro
from hil.common.errors import ConfigError
from sim.vehicle.urdf.importer import read_urdf
from sim.vehicle.urdf.text import find_mesh

HYDRA = Path(__file__).parents[2] / "vectors" / "hydra.urdf"
NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


@pytest.fixture
def hydra(tmp_path: Path) -> Path:
    """Return the URDF of the vectors as an author would have it: two packages, a property, an argument, an include."""
    body = HYDRA.read_text().split('<robot name="hydra">')[1]
    links, _, water = body.partition("<gazebo>")
    for name, folder in (("hydra_description", "anywhere"), ("hydra_water", "hydra_water")):
        (tmp_path / folder / "urdf").mkdir(parents=True)
        (tmp_path / folder / "package.xml").write_text(f"<package><name> {name} </name></package>")
    (tmp_path / "hydra_water" / "urdf" / "water.xacro").write_text(
        f"<robot {NAMESPACE}><gazebo>" + water.replace("1028.0", "${rho}")
    )
    main_file = tmp_path / "anywhere" / "urdf" / "hydra.urdf.xacro"
    main_file.write_text(
        f'<?xml version="1.0"?><robot name="hydra" {NAMESPACE}><xacro:arg name="mass" default="24.0"/>'
        '<xacro:property name="rho" value="${1000.0 + 28.0}"/>'
        + links.replace('"24.0"', '"$(arg mass)"')
        + '<xacro:include filename="$(find hydra_water)/urdf/water.xacro"/></robot>'
    )
    return main_file


def test_an_expanded_xacro_is_the_vehicle_of_its_urdf(hydra: Path) -> None:
    vehicle, _ = read_urdf(str(hydra), text=expand(str(hydra)))
    assert vehicle._replace(source="") == read_urdf(str(HYDRA))[0]._replace(source="")
    heavier, _ = read_urdf(str(hydra), text=expand(str(hydra), ["mass:=34"]))
    assert heavier.mass == pytest.approx(vehicle.mass + 10.0)


@pytest.fixture
def far_folder() -> Iterator[Path]:
    """Provide a folder outside those of pytest."""
    with TemporaryDirectory() as folder:
        yield Path(folder)


@pytest.mark.parametrize("package_location", ["near", "AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH"])
def test_packages_are_found_near_the_file_and_by_ros_variables(
    package_location: str, hydra: Path, far_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Packages are found at any depth near the file, and elsewhere by ROS's variables, as are their meshes."""
    package = hydra.parents[2] / "hydra_water"
    package_folder = hydra.parents[2] if package_location == "near" else far_folder
    inside = {"near": "src/vehicles/hydra/hydra_water", "AMENT_PREFIX_PATH": "share/AMENT_PREFIX_PATH_water"}
    new_folder = package_folder / inside.get(package_location, "a/b/c/water")
    new_folder.parent.mkdir(parents=True, exist_ok=True)
    (package / "hull.stl").touch()
    (package / "package.xml").write_text(f"<package><name>{package_location}_water</name></package>")
    hydra.write_text(hydra.read_text().replace("hydra_water", f"{package_location}_water"))
    package.rename(new_folder)
    if package_location != "near":
        with pytest.raises(ConfigError, match=f"no package '{package_location}_water'"):
            expand(str(hydra))
        monkeypatch.setenv(package_location, f"{package_folder / 'nowhere'}:{package_folder}")
    vehicle, _ = read_urdf(str(hydra), text=expand(str(hydra)))
    assert vehicle.volume == 0.0301
    assert find_mesh(f"package://{package_location}_water/hull.stl", str(hydra)) == str(new_folder / "hull.stl")


def test_the_command_imports_a_xacro_with_arguments(
    hydra: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "hydra.toml"
    assert main(["vehicle", "--import", str(hydra), "--xacro", "mass=25", "-o", str(out)]) == 0
    assert "mass = 31" in out.read_text()
    assert "hydra, 31 kg" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        ('<xacro:include filename="$(find moon)/x.xacro"/>', [], "no package 'moon' by AMENT_PREFIX_PATH, by ROS"),
        ("<a b='${1/0}'/>", [], "division by zero"),
        ('<xacro:include filename="part.xacro"/>', [], "nowhere.xacro' (in "),
        (
            '<xacro:macro name="rov" params="name mass:=3 *origin"><link name="x"/></xacro:macro>',
            [],
            "only defines macros, which another file calls: import that file, or write one that includes this one and "
            "calls <xacro:rov name *origin/>",
        ),
        ("<a b='$(arg depth)'/>", [], "depth"),
        ("<a", [], "not well-formed"),
        ("<a/>", ["depth"], "xacro argument 'depth': write NAME=VALUE"),
        ("<a/>", ["=3"], "xacro argument '=3': write NAME=VALUE"),
    ],
)
def test_an_error_in_a_xacro_is_one_line(text: str, arguments: list[str], message: str, tmp_path: Path) -> None:
    path = tmp_path / "m.xacro"
    path.write_text(f"<robot {NAMESPACE}>{text}</robot>")
    (tmp_path / "part.xacro").write_text(f'<robot {NAMESPACE}><xacro:include filename="nowhere.xacro"/></robot>')
    with pytest.raises(ConfigError) as caught:
        expand(str(path), arguments)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("expression", ["9**9**9**9", "'a' * 10**10"])
def test_an_endless_expression_is_stopped(expression: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The time and memory of an expansion are bounded."""
    monkeypatch.setattr(xacro_expand, "LIMITS", xacro_expand.LIMITS._replace(processor=1))
    path = tmp_path / "m.xacro"
    path.write_text(f'<robot {NAMESPACE}><a b="${{{expression}}}"/></robot>')
    with pytest.raises(ConfigError, match=r"cannot be expanded: (one of its expressions takes too long|MemoryError)"):
        expand(str(path))


def test_xacro_files_are_recognised(hydra: Path, tmp_path: Path) -> None:
    assert is_xacro(str(hydra))
    assert not is_xacro(str(HYDRA))
    assert not is_xacro(str(tmp_path / "nowhere.urdf"))
    plain = tmp_path / "robot.urdf"
    plain.write_text(f"<robot {NAMESPACE}/>")
    assert is_xacro(str(plain))
