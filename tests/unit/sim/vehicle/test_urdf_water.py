"""uuv_simulator's shapes, thrusters, fins and sensors in a URDF, against its formulas written out here."""

from math import log, pi, sqrt
from pathlib import Path
from typing import Any

import pytest

from hil.common.errors import ConfigError
from sim.vehicle.urdf.importer import Imported, read_robot
from sim.vehicle.urdf.text import read_xml

HYDRA = (Path(__file__).parents[3] / "vectors" / "hydra.urdf").read_text()
START, END = HYDRA.index("<hydrodynamic_model>"), HYDRA.index("</hydrodynamic_model>")


def imported(model: str = "", extra_xml: str = "", **extra: Any) -> Imported:
    """Return the vehicle of the vectors with another hydrodynamic model, and with more in its robot."""
    text = HYDRA[:START] + f"<hydrodynamic_model>{model}" + HYDRA[END:] if model else HYDRA
    text = text.replace("</robot>", f"{extra_xml}</robot>")
    return read_robot(read_xml("hydra.urdf", text.encode()), "hydra.urdf", extra)


def test_a_sphere_has_its_added_mass_and_drag() -> None:
    vehicle = imported("<type>sphere</type><radius>0.2</radius><fluid_density>1000</fluid_density>").vehicle
    added, drag = 2.0 / 3.0 * pi * 1000.0 * 0.2**3, 0.5 * 0.5 * 1000.0 * pi * 0.2**2
    assert vehicle.added_mass == pytest.approx((added, added, added, 0.0, 0.0, 0.0))
    assert vehicle.quadratic_damping == pytest.approx((drag, drag, drag, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(("axis", "index"), [("i", 0), ("j", 1), ("k", 2)])
def test_a_cylinder_has_its_added_mass_and_drag(axis: str, index: int) -> None:
    """The cylinder is five diameters long: end 0.99, side 0.74. Additional values of the file are added."""
    vehicle = imported(
        f"<type>cylinder</type><radius>0.1</radius><length>1</length><axis>{axis}</axis>"
        "<linear_damping>-1 -2 -3 0 0 0</linear_damping>"
    )
    disc = 1028.0 * pi * 0.1**2
    along = [disc if n == index else disc * 1.0 for n in range(3)]
    turning = [0.0 if n == index else disc / 12.0 for n in range(3)]
    drag = [0.5 * 0.99 * disc if n == index else 0.5 * 0.74 * 1028.0 * 0.1 for n in range(3)]
    assert vehicle.vehicle.added_mass == pytest.approx((*along, *turning))
    assert vehicle.vehicle.quadratic_damping == pytest.approx((*drag, 0.0, 0.0, 0.0))
    assert vehicle.vehicle.linear_damping == (1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    assert any("lacks a length" in note for note in vehicle.notes)


@pytest.mark.parametrize("kind", ["spheroid", "ellipsoid"])
def test_a_spheroid_has_lambs_added_mass(kind: str) -> None:
    """The spheroid, four times as long as wide, has k1 = 0.082 and k2 = 0.860 (Lamb's table, Hydrodynamics, 115)."""
    vehicle = imported(f"<type>{kind}</type><radius>0.1</radius><length>0.4</length>").vehicle
    mass = 4.0 / 3.0 * pi * 1028.0 * 0.4 * 0.1**2
    assert vehicle.added_mass[0] / mass == pytest.approx(0.082, abs=5e-4)
    assert vehicle.added_mass[1] / mass == pytest.approx(0.860, abs=5e-4)
    inertia = 0.2 * mass * (0.4**2 + 0.1**2)
    assert vehicle.added_mass[4] / inertia == pytest.approx(0.608, abs=2e-3)
    e = sqrt(1.0 - 0.25**2)
    alpha = 2.0 * 0.25**2 / e**3 * (0.5 * log((1.0 + e) / (1.0 - e)) - e)
    assert vehicle.added_mass[0] == pytest.approx(mass * alpha / (2.0 - alpha))


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("<type>torus</type>", "no type 'torus'; there are: fossen, sphere, cylinder"),
        ("<type>sphere</type><radius>-1</radius>", "<radius> must be above 0, at most 100, found -1"),
        ("<type>sphere</type><radius>1e300</radius>", "at most 100, found 1e+60"),
        ("<type>cylinder</type><radius>1</radius><length>1</length><axis>x</axis>", "'x' is none of i, j, k"),
    ],
)
def test_wrong_shapes_are_reported(model: str, message: str) -> None:
    with pytest.raises(ConfigError, match=r"hydra\.urdf") as caught:
        imported(model)
    assert message in str(caught.value)


NOISE = """<gazebo reference="hydra/base_link"><sensor type="altimeter"><pose>1 2 3</pose><vertical_position><noise>
<mean>-0.2</mean><stddev>-0.1</stddev><bias_stddev>0.3</bias_stddev><dynamic_bias_stddev>-0.01</dynamic_bias_stddev>
<dynamic_bias_correlation_time>-50</dynamic_bias_correlation_time></noise></vertical_position></sensor>
<sensor type="depth" name="eye"/><plugin filename="ros_imu"><gyroscope_random_walk>1</gyroscope_random_walk></plugin>
<plugin name="sound" filename="usbl"/><sensor type="lidar" name="scan"/></gazebo>
<gazebo reference="nowhere"><sensor type="imu" name="lost"/></gazebo>"""


def test_sensors_have_the_errors_of_their_simulator() -> None:
    """A metre of water is 9810 Pa; a walk of 0.01 settles at that times the root of half of 50 s, if it settles."""
    found, endless = imported(extra_xml=NOISE), imported(extra_xml=NOISE.replace("correlation_time", "none"))
    error = {"offset": -0.2 * 9810.0, "noise": 981.0, "turn_on": 2943.0}
    settled = error | {"bias": 0.05 * 9810.0, "bias_time": 50.0}
    assert found.sensors["pressure"].pop("error") == pytest.approx(settled)
    here = {"position": [0.0] * 3}
    others = {"camera": here | {"depth": True}, "laser": here, "imu": here}
    assert found.sensors == {"pressure": {"position": [1.0, -2.0, -3.0]}, **others}
    assert endless.sensors["pressure"]["error"] == pytest.approx(error)
    for kind, depth in (("camera", {}), ("rgbd_camera", {"depth": True})):
        assert imported(extra_xml=NOISE.replace('"depth"', f'"{kind}"')).sensors["camera"] == here | depth
    assert found.notes == [
        f"Left out: the sensor {label}, of a kind that there is not." for label in ("'lost' (imu)", "sound")
    ]


def thruster(inside: str) -> str:
    return (
        '<link name="t_link"/><joint name="t" type="continuous"><parent link="hydra/base_link"/><child link="t_link"/>'
        '<axis xyz="1 0 0"/></joint><gazebo><plugin filename="libuuv_thruster_ros_plugin.so">'
        f"{inside}</plugin></gazebo>"
    )


@pytest.mark.parametrize(
    ("conversion", "limits"),
    [
        ("<clampMin>-20</clampMin><clampMax>30</clampMax><thrustMax>85</thrustMax><conversion><type>Basic</type>"
         "<rotorConstant>0.1</rotorConstant></conversion>", (85.0, 40.0)),
        ("<clampMin>-20</clampMin><clampMax>30</clampMax><thrustMin>-25</thrustMin><thrustMax>80</thrustMax>"
         "<thrust_efficiency>0.5</thrust_efficiency><conversion><type>Basic</type>"
         "<rotorConstant>0.1</rotorConstant></conversion>", (40.0, 12.5)),
        ("<clampMin>-10</clampMin><clampMax>10</clampMax><gain>2</gain><conversion><type>Bessa</type>"
         "<rotorConstantL>0.1</rotorConstantL><rotorConstantR>0.2</rotorConstantR><deltaL>-100</deltaL>"
         "<deltaR>100</deltaR></conversion>", (60.0, 30.0)),
        ("<conversion><type>LinearInterp</type><inputValues>-1 0 1</inputValues>"
         "<outputValues>-30 0 50</outputValues></conversion>", (50.0, 30.0)),
    ],
)  # fmt: skip
def test_thruster_conversions_become_limits(conversion: str, limits: tuple[float, float]) -> None:
    dynamics = "<dynamics><type>FirstOrder</type><timeConstant>0.2</timeConstant></dynamics>"
    found = imported(extra_xml=thruster(f"<jointName>t</jointName>{dynamics}{conversion}")).vehicle.thrusters[-1]
    assert (found.max_forward, found.max_reverse, found.time_constant) == pytest.approx((*limits, 0.2))


@pytest.mark.parametrize(
    ("inside", "limits"),
    [
        ("<gain>-1</gain>{basic}0.1</rotorConstant></conversion>", (90.0, 40.0, -1.0)),
        ("{basic}-0.1</rotorConstant></conversion>", (90.0, 40.0, -1.0)),
        ("<gain>-2</gain>{basic}-0.1</rotorConstant></conversion>", (360.0, 160.0, 1.0)),
        ("<gain>-1</gain><thrustMin>-30</thrustMin><thrustMax>80</thrustMax>{basic}0.1</rotorConstant></conversion>",
         (30.0, 40.0, -1.0)),
        ("<conversion><type>LinearInterp</type><inputValues>-40 0 40</inputValues>"
         "<outputValues>60 0 -100</outputValues></conversion>", (75.0, 30.0, -1.0)),
        ("<use_angvel_cmd>true</use_angvel_cmd><thrust_coefficient>-0.01</thrust_coefficient><propeller_diameter>0.1"
         "</propeller_diameter><max_thrust_cmd>200</max_thrust_cmd><min_thrust_cmd>-100</min_thrust_cmd>",
         (40.0, 10.0, -1.0)),
        ("<control><jointName>t</jointName><multiplier>-100</multiplier><offset>-0.5</offset></control>",
         (50.0, 50.0, -1.0)),
    ],
)  # fmt: skip
def test_a_negative_gain_turns_the_thruster_around(inside: str, limits: tuple[float, float, float]) -> None:
    """The direction is that of the thrust for a positive command, which may be the stronger or the weaker one."""
    clamps = "<clampMin>-20</clampMin><clampMax>30</clampMax>"
    text = inside.format(basic=f"{clamps}<conversion><type>Basic</type><rotorConstant>")
    text = clamps + text if "LinearInterp" in text else text
    found = imported(extra_xml=thruster(f"<jointName>t</jointName>{text}")).vehicle.thrusters[-1]
    assert (found.max_forward, found.max_reverse, found.direction[0]) == pytest.approx(limits)
