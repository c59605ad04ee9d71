"""Parameter files: errors with their line, and the frame's own values."""

from pathlib import Path

import pytest

from hil.autopilots.frames import map_motors
from hil.autopilots.parameters import all_parameters, format_parameters, px4_geometry, read_parameters, sensor_positions
from hil.autopilots.px4_files import decode_bson
from hil.cli import main
from hil.common.errors import ConfigError
from hil.scenario.autopilot_records import AutopilotSettings
from sim.sensors.sensor_set import read_sensors
from sim.vehicle.vehicle import load_vehicle


def test_parameter_files_are_read_and_wrong_lines_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.parm"
    path.write_text("# all\nFRAME_CONFIG 1\nPSC_POSZ_P, 3.5 # gain\n\n")
    assert read_parameters(str(path)) == {"FRAME_CONFIG": 1.0, "PSC_POSZ_P": 3.5}
    path.write_text("FRAME_CONFIG 1\nPSC_POSZ_P\n")
    with pytest.raises(ConfigError, match="line 2: expected NAME VALUE, found 'PSC_POSZ_P'"):
        read_parameters(str(path))
    path.write_text("A_NAME_THAT_IS_FAR_TOO_LONG 1\n")
    with pytest.raises(ConfigError, match="is not a parameter name"):
        read_parameters(str(path))
    with pytest.raises(ConfigError, match=r"none\.parm: cannot be read"):
        read_parameters(str(tmp_path / "none.parm"))


@pytest.mark.parametrize(("name", "frame"), [("bluerov2", 1), ("bluerov2_heavy", 2)])
def test_ardusub_gets_its_frame_and_the_installed_parameter_file(name: str, frame: int) -> None:
    vehicle, _ = load_vehicle(name)
    parameters = all_parameters(AutopilotSettings(), "ardupilot", vehicle, map_motors("auto", vehicle))
    assert parameters["FRAME_CONFIG"] == frame
    assert parameters["SIM_BARO_RND"] == 0
    assert f"FRAME_CONFIG {frame}\n" in format_parameters(parameters)


# Old name -> the name in ArduSub 4.7 and its factor: AC_PosControl::convert_parameters and AP_RangeFinder_Params. It
# converts values stored on a board, not those of a file.
RENAMED = {
    "PSC_ACCZ_P": ("PSC_D_ACC_P", 0.1), "PSC_ACCZ_I": ("PSC_D_ACC_I", 0.1), "PSC_VELZ_P": ("PSC_D_VEL_P", 1.0),
    "PSC_POSZ_P": ("PSC_D_POS_P", 1.0), "PSC_POSXY_P": ("PSC_NE_POS_P", 1.0), "PSC_VELXY_P": ("PSC_NE_VEL_P", 1.0),
    "PSC_VELXY_I": ("PSC_NE_VEL_I", 1.0), "PSC_VELXY_D": ("PSC_NE_VEL_D", 1.0),
    "RNGFND1_MAX_CM": ("RNGFND1_MAX", 0.01), "RNGFND1_MIN_CM": ("RNGFND1_MIN", 0.01),
}  # fmt: skip


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2_heavy"])
def test_renamed_parameters_have_equal_values_for_older_and_newer_ardusub(name: str) -> None:
    vehicle, _ = load_vehicle(name)
    parameters = all_parameters(AutopilotSettings(), "ardupilot", vehicle, map_motors("auto", vehicle))
    renamed = [key for key in parameters if key.startswith(("PSC_", "RNGFND1_M"))]
    assert sorted(renamed) == sorted([*RENAMED, *[new for new, _ in RENAMED.values()]])
    for old, (new, factor) in RENAMED.items():
        assert parameters[new] == pytest.approx(factor * parameters[old])


def test_px4_gets_the_vehicles_geometry() -> None:
    vehicle, _ = load_vehicle("bluerov2_heavy")
    geometry = px4_geometry(vehicle, map_motors("custom", vehicle))
    assert (geometry["CA_AIRFRAME"], geometry["CA_ROTOR_COUNT"], geometry["CA_R_REV"]) == (7, 8, 255)
    assert (geometry["CA_ROTOR0_PX"], geometry["CA_ROTOR0_PY"]) == (0.156, 0.111)
    assert geometry["CA_ROTOR0_AX"] == -geometry["CA_ROTOR0_AY"] == pytest.approx(0.70711)
    assert geometry["CA_ROTOR7_AZ"] == -1.0
    assert geometry["PWM_MAIN_FUNC8"] == 108


def test_the_parameters_of_a_board_are_written_as_qgroundcontrol_and_px4s_shell_read_them(tmp_path: Path) -> None:
    board = ["autopilot", "parameters", "px4_uuv", "--set", "autopilot.address=/dev/ttyACM0", "-o"]
    text, binary = tmp_path / "board.params", tmp_path / "board.bson"
    assert [main([*board, str(path)]) for path in (text, binary)] == [0, 0]
    parameters = decode_bson(binary.read_bytes())
    assert (parameters["HIL_ACT_FUNC8"], parameters["UUV_MGM_YAW"], parameters["EKF2_EV_CTRL"]) == (108, 0.3, 11)
    assert "1\t1\tHIL_ACT_FUNC8\t108\t6\n" in text.read_text()
    assert read_parameters(str(text)) == parameters


@pytest.mark.parametrize(
    ("controller", "positions", "expected"),
    [
        ("ardupilot", "simulated", {"INS_POS1_": (0.1, 0, 0), "INS_POS3_": (0.1, 0, 0), "RNGFND1_POS_": (0, 0, 0.2)}),
        ("ardupilot", "dvl", {"VISO_POS_": (-0.3, 0.05, 0.15), "INS_POS2_": (0.1, 0, 0)}),
        ("ardupilot", "gps", {"GPS1_POS_": (0, 0, -0.4)}),
        ("px4", "simulated", {"EKF2_IMU_POS_": (0.1, 0, 0), "EKF2_GPS_POS_": (0, 0, -0.4)}),
        ("px4", "simulated", {"SENS_GPS0_OFF": (0, 0, -0.4)}),
    ],
)
def test_parameters_give_the_positions_of_the_sensors(
    controller: str, positions: str, expected: dict[str, tuple[float, float, float]]
) -> None:
    mounted = {
        "imu": {"position": [0.1, 0, 0]},
        "dvl": {"position": [-0.3, 0.05, 0.15]},
        "gps": {"position": [0, 0, -0.4]},
        "altimeter": {"position": [0, 0, 0.2]},
    }
    settings = AutopilotSettings(positions=positions)  # type: ignore[arg-type]
    found = sensor_positions(settings, controller, read_sensors(mounted, "test"))
    for prefix, place in expected.items():
        assert tuple(found[f"{prefix}{axis}"] for axis in "XYZ") == place
    assert any(name.startswith("VISO") for name in found) == (positions == "dvl")
    assert not sensor_positions(settings, controller, read_sensors({name: {} for name in mounted}, "test"))
