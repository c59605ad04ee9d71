"""The real ArduSub, where UUV_HIL_ARDUSUB names its SITL program: depth, parameters, guided mode, position, faults."""

from math import degrees, hypot
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autopilots.parameters import FOLDER, read_parameters
from hil.common.schema import find_preset, preset_folder
from hil.scenario.config import load_scenario
from sim.vehicle.failures import Failure
from tests.support.autopilots.ardusub_dive import ALT_HOLD, GPS, GUIDED, MANUAL, POSHOLD, PROGRAM, Dive
from tests.support.autopilots.autopilot_dive import ARM, SET_MODE, AutopilotDive
from tests.support.clients.ground_station import GroundStation, Mission, fly

pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="UUV_HIL_ARDUSUB does not name ArduSub's SITL program"),
    pytest.mark.timeout(1200),  # six minutes of simulated time, on a machine that others use too
]

# Names that ArduSub had until 4.6, and those that it has since 4.7: the installed files give both.
FORMER = {
    "RNGFND1_MAX_CM", "RNGFND1_MIN_CM", "PSC_ACCZ_P", "PSC_ACCZ_I", "PSC_VELZ_P", "PSC_POSZ_P", "PSC_POSXY_P",
    "PSC_VELXY_P", "PSC_VELXY_I", "PSC_VELXY_D",
}  # fmt: skip
PRESENT = {
    "RNGFND1_MAX", "RNGFND1_MIN", "PSC_D_ACC_P", "PSC_D_ACC_I", "PSC_D_VEL_P", "PSC_D_POS_P", "PSC_NE_POS_P",
    "PSC_NE_VEL_P", "PSC_NE_VEL_I", "PSC_NE_VEL_D",
}  # fmt: skip
DVL_WITH_POSITION = """
[sensors.dvl]
rate = 10
position = [0.5, 0.1, 0.2]
"""
BATTERY = """
[battery]
capacity_wh = 266
charge = [0, 1]
open_circuit = [12.8, 16.0]
resistance = 0.05
"""


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy"])
def test_ardusub_holds_depth_for_two_minutes_in_a_current(tmp_path: Path, vehicle: str) -> None:
    dive = Dive(tmp_path, vehicle)
    depths: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield from dive.hold(120.0, depths)
        yield from dive.command(ARM, 0)
        yield 0.5

    dive.fly(mission(), 400.0)
    print(f"{vehicle}: depth {min(depths):.3f} to {max(depths):.3f} m")
    middle = 0.5 * (max(depths) + min(depths))
    assert max(depths) - middle < 0.1
    assert middle > 2.5
    assert set(dive.run.pwm_us) == {1500}  # disarmed


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy"])
def test_ardusub_accepts_all_installed_parameters_and_sensor_positions(tmp_path: Path, vehicle: str) -> None:
    given = read_parameters(f"{preset_folder(FOLDER)}/ardupilot_{vehicle}.parm")
    given |= {"VISO_POS_X": 0.5, "VISO_POS_Y": 0.1, "VISO_POS_Z": 0.2, "EK3_SRC1_POSXY": 6.0}
    dive = Dive(tmp_path, vehicle, positions="dvl", sensors=DVL_WITH_POSITION)
    reported_values: dict[str, float] = {}

    def mission() -> Mission:
        yield lambda: dive.station.output("ArduPilot Ready")
        for name in [*given, *given]:  # an answer may come too late for the first request
            if name in reported_values:
                continue
            dive.station.send(dialect.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
            yield 0.3
            answer = dive.station.latest.get("PARAM_VALUE")
            if answer and answer.param_id == name:
                reported_values[name] = answer.param_value

    dive.fly(mission(), 100.0)
    missing = given.keys() - reported_values.keys()  # 4.7-dev took over its names in several steps
    assert missing <= FORMER | PRESENT
    assert len(missing) == len(FORMER) == len(PRESENT)
    assert reported_values == pytest.approx({name: given[name] for name in reported_values})


@pytest.mark.parametrize("seed", range(1, 6))
def test_the_estimated_attitude_stays_within_a_degree_for_five_minutes(tmp_path: Path, seed: int) -> None:
    """In ALT_HOLD, ahead and with turns, with the sensors of the installed scenario."""
    keys = {"program": PROGRAM, "instance": 3, "folder": str(tmp_path)}
    scenario = load_scenario("ardusub", {f"autopilot.{key}": value for key, value in keys.items()} | {"seed": seed})
    dive = AutopilotDive(scenario, GroundStation(("127.0.0.1", 5790)))
    station, run = dive.station, dive.run
    errors: list[float] = []

    def mission() -> Mission:
        yield lambda: station.output("is using GPS")
        yield from dive.command(ARM, 1)
        station.sticks = (0, 0, 300, 0)
        yield lambda: run.simulation.state.position[2] > 3.0
        yield from dive.command(SET_MODE, 1, ALT_HOLD)
        for i in range(3000):
            station.sticks = (300, 0, 500, 300 if i // 40 % 3 == 0 else 0)
            yield 0.1
            estimate = run.autopilot.estimate
            assert estimate
            errors.append(max(abs(degrees(angle)) for angle in estimate[:3]))

    dive.fly(mission(), 500.0)
    print(f"seed {seed}: at most {max(errors):.2f} degrees off")
    assert max(errors) < 1.0


def test_ardusub_follows_a_square_in_guided_mode(tmp_path: Path) -> None:
    dive = Dive(tmp_path)
    corners = [(0.0, 5.0), (5.0, 5.0), (5.0, 0.0), (0.0, 0.0)]
    misses: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield lambda: dive.station.output("is using GPS")
        yield from dive.command(SET_MODE, 1, GUIDED)
        yield 10.0
        first, origin = dive.position, dive.station.latest["LOCAL_POSITION_NED"]
        for north, east in corners:
            yield from dive.go(origin.x + north, origin.y + east, 3.0)
            yield 8.0
            misses.append(hypot(dive.position[0] - first[0] - north, dive.position[1] - first[1] - east))
        yield from dive.command(SET_MODE, 1, POSHOLD)
        before = dive.position
        yield 30.0
        misses.append(hypot(dive.position[0] - before[0], dive.position[1] - before[1]))

    dive.fly(mission(), 600.0)
    print(f"square: {', '.join(f'{miss:.2f}' for miss in misses)} m from the corners, and in 30 s of POSHOLD")
    assert max(misses) < 1.5


@pytest.mark.parametrize(("positions", "max_strayed"), [("odometry", 0.4), ("dvl", 0.4)])
def test_ardusub_holds_its_position_under_water_without_gps(tmp_path: Path, positions: str, max_strayed: float) -> None:
    dive = Dive(tmp_path, positions=positions)
    strayed: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield from dive.command(SET_MODE, 1, POSHOLD)
        yield 10.0
        north, east, _ = dive.position
        for _ in range(1200):
            strayed.append(hypot(dive.position[0] - north, dive.position[1] - east))
            yield 0.05

    dive.fly(mission(), 400.0)
    print(f"{positions}: {max(strayed):.2f} m off in a minute of POSHOLD, in a current of 0.3 m/s")
    assert max(strayed) < max_strayed
    assert dive.station.latest["GPS_RAW_INT"].fix_type <= 1


def test_a_turn_with_an_offset_dvl_is_not_estimated_as_sway(tmp_path: Path) -> None:
    """Half a turn would move the estimate by 1 m, twice the lever arm, without the position of the DVL."""
    dive = Dive(tmp_path, positions="dvl", sensors="[sensors.dvl]\nrate = 10\nposition = [0.5, 0, 0]")
    errors: list[tuple[float, float]] = []
    turned: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield from dive.command(SET_MODE, 1, POSHOLD)
        yield 15.0
        for stick in (300, 0, 0) * 6:
            dive.station.sticks = (0, 0, 500, stick)
            yield 2.0
            believed, (north, east, _) = dive.station.latest["LOCAL_POSITION_NED"], dive.position
            errors.append((believed.x - north, believed.y - east))
            turned.append(dive.station.latest["ATTITUDE"].yaw)

    dive.fly(mission(), 400.0)
    steady = errors[6:]  # the first turns move the estimate wherever the DVL is
    worst = max(hypot(north - steady[0][0], east - steady[0][1]) for north, east in steady)
    print(f"turned from {min(turned):.1f} to {max(turned):.1f} rad: {worst:.2f} m off")
    assert max(turned) - min(turned) > 2.5
    assert worst < 0.3


def test_gps_gives_a_position_at_the_surface_only(tmp_path: Path) -> None:
    dive = Dive(tmp_path, positions="gps", sensors=GPS)
    fixes: list[int] = []

    def mission() -> Mission:
        yield lambda: dive.station.output("is using GPS")
        fixes.append(dive.station.latest["GPS_RAW_INT"].fix_type)
        yield from dive.dive(3.0)
        fixes.append(dive.station.latest["GPS_RAW_INT"].fix_type)

    dive.fly(mission(), 400.0)
    assert fixes[0] >= 3
    assert fixes[1] <= 1


def test_ardusub_holds_depth_after_a_thruster_failure(tmp_path: Path) -> None:
    dive = Dive(tmp_path)
    depths: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        dive.run.simulation.fail(Failure("vertical_front_right", "off"))
        yield 20.0
        yield from dive.hold(60.0, depths)

    dive.fly(mission(), 400.0)
    print(f"one vertical thruster off: depth {min(depths):.3f} to {max(depths):.3f} m")
    assert max(depths) - min(depths) < 0.4


def test_ardusub_holds_depth_when_half_of_the_pressure_samples_are_lost(tmp_path: Path) -> None:
    dive = Dive(tmp_path, pressure="drop_out = 0.5")
    depths: list[float] = []

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield from dive.hold(60.0, depths)

    dive.fly(mission(), 400.0)
    assert max(depths) - min(depths) < 0.3


def test_two_vehicles_with_an_ardusub_each_dive_together(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "other")]
    for folder in folders:
        folder.mkdir()
    dives = [Dive(folder, instance=instance) for folder, instance in zip(folders, (4, 5), strict=True)]

    def mission(dive: Dive, depth: float) -> Mission:
        yield from dive.dive(depth)

    try:
        for dive, depth in zip(dives, (2.0, 4.0), strict=True):
            fly(dive.run, dive.station, mission(dive, depth), 200.0)
        assert abs(dives[0].position[2] - 2.0) < 0.5
        assert abs(dives[1].position[2] - 4.0) < 0.5
    finally:
        for dive in dives:
            dive.close()


def test_ardusub_moves_lights_camera_and_gripper_and_hears_of_a_leak(tmp_path: Path) -> None:
    camera = "width = 32\nheight = 24\nrate = 4\nwater = 'clear'\nlamps = 1000\nexposure = 0.3\nmax_range = 100"
    dive = Dive(tmp_path, "bluerov2", 7, sensors=f"[sensors.camera]\n{camera}\n[sensors.leak]\nbelow = 2.5")
    station = dive.station
    seen: list[dict[str, float]] = []
    levels: list[float] = []
    ranges: list[float] = []

    def look() -> None:
        simulation, picture = dive.run.simulation, dive.run.samples["camera"]
        assert simulation.accessories
        seen.append(simulation.accessories.positions(simulation.time_ns))
        levels.append(float(np.frombuffer(picture.rgb, np.uint8).mean()))
        ranges.append(float(np.median(np.frombuffer(picture.depth, np.float32))))

    def mission() -> Mission:
        yield from dive.dive(3.0)
        yield from dive.command(dialect.MAV_CMD_DO_MOUNT_CONTROL, -45, 0, 0, 0, 0, 0, 2)
        yield 3.0
        look()
        yield from dive.command(dialect.MAV_CMD_DO_SET_SERVO, 9, 1900)
        yield from dive.command(dialect.MAV_CMD_DO_GRIPPER, 1, dialect.GRIPPER_ACTION_RELEASE)
        yield 4.0
        look()
        yield from dive.command(dialect.MAV_CMD_DO_MOUNT_CONTROL, 45, 0, 0, 0, 0, 0, 2)
        yield from dive.command(dialect.MAV_CMD_DO_GRIPPER, 1, dialect.GRIPPER_ACTION_GRAB)
        yield 4.0
        look()
        station.set_parameter("SERVO11_FUNCTION", 0)  # the gripper hangs at another output from now on
        station.set_parameter("SERVO15_FUNCTION", 28)
        yield 2.0
        yield from dive.command(dialect.MAV_CMD_DO_GRIPPER, 1, dialect.GRIPPER_ACTION_RELEASE)
        yield 4.0
        look()

    dive.fly(mission(), 400.0)
    print(seen, levels, ranges, station.texts[-3:])
    assert [round(each["lights"], 2) for each in seen] == [0.0, 1.0, 1.0, 1.0]
    assert [each["gripper"] for each in seen] == [0.0, 1.0, 0.0, 1.0]
    assert [each["camera_tilt"] for each in seen] == pytest.approx([-1.0, -1.0, 1.0, 1.0], abs=0.15)
    assert levels[1] > levels[0] + 5.0
    assert ranges[0] == pytest.approx(ranges[1], rel=0.05)
    assert ranges[2] < 0.5 * ranges[1]  # the surface above is nearer than the seabed
    assert station.output("Leak Detected")


def test_silent_sensors_fail_in_ardusub_and_recover(tmp_path: Path) -> None:
    """Pressure is silent from 20 to 30 s, the magnetometer to 40 s, the GPS to 50 s, the battery's monitor to 60 s."""
    silent = "drop_out = 1\ndrop_out_from = {}\ndrop_out_until = {}\n"
    sensors = f"[sensors.magnetometer]\nrate = 20\n{silent.format(30, 40)}{GPS}{silent.format(40, 50)}"
    sensors += f"[sensors.battery]\n{silent.format(50, 60)}"
    installed = 'parameters = "ardupilot_bluerov2_heavy"'
    vehicle = tmp_path / "powered.toml"
    vehicle.write_text(Path(find_preset("sim/vehicles", "bluerov2_heavy_t200")).read_text() + BATTERY)
    dive = Dive(tmp_path, str(vehicle), 3, silent.format(20, 30), autopilot=installed, sensors=sensors)
    pressure, magnetometer = 1 << 3, 1 << 2  # MAV_SYS_STATUS_SENSOR
    healths: list[int] = []
    fixes: list[bool] = []
    volts: list[float] = []

    def mission() -> Mission:
        for end in range(18, 74, 10):
            yield lambda end=end: dive.station.now > end  # type: ignore[misc]
            status = dive.station.latest["SYS_STATUS"]
            healths.append(status.onboard_control_sensors_health & (pressure | magnetometer))
            fixes.append(dive.station.latest["GPS_RAW_INT"].fix_type >= 3)
            volts.append(1e-3 * status.voltage_battery)

    dive.fly(mission(), 100.0)
    print(healths, fixes, volts, dive.station.texts)
    both = pressure | magnetometer
    assert healths == [both, magnetometer, pressure, both, both, both]
    assert fixes == [True, True, True, False, True, True]
    measured = dive.run.samples["battery"].voltage
    assert volts == pytest.approx([*[measured] * 4, 0.0, measured], abs=0.2)
    assert dive.station.output("Depth sensor error!")


@pytest.mark.parametrize(
    ("lost", "settings", "text", "mode", "is_armed"),
    [
        ("all", {"FS_GCS_ENABLE": 4, "FS_PILOT_INPUT": 1}, "heartbeat lost", ALT_HOLD, True),  # after its SURFACE
        ("all", {"FS_GCS_ENABLE": 2, "FS_PILOT_INPUT": 0}, "heartbeat lost", MANUAL, False),
        ("joystick", {"FS_PILOT_INPUT": 1, "FS_PILOT_TIMEOUT": 1}, "Lost manual control", MANUAL, True),
        ("joystick", {"FS_PILOT_INPUT": 2, "FS_PILOT_TIMEOUT": 1}, "Lost manual control", MANUAL, False),
        ("channels", {"FS_PILOT_INPUT": 2, "RC_OVERRIDE_TIME": 1}, "Lost manual control", MANUAL, False),
    ],
)
def test_the_vehicle_does_what_ardusub_does_without_its_pilot(
    tmp_path: Path, lost: str, settings: dict[str, float], text: str, mode: int, is_armed: bool
) -> None:
    """It is driven ahead at 2 m depth, by MANUAL_CONTROL or by RC_CHANNELS_OVERRIDE, when the pilot falls silent."""
    dive = Dive(tmp_path)
    station = dive.station
    speeds: list[float] = []
    pulses: list[tuple[int, ...]] = []

    def override() -> None:
        channels = [1500, 1500, 1500, 1500, 1700, 1500, *[0] * 12]
        station.send(dialect.MAVLink_rc_channels_override_message(1, 1, *channels))

    def mission() -> Mission:
        yield lambda: station.output("ArduPilot Ready")
        for name, value in settings.items():
            station.set_parameter(name, value)
        yield 1.0
        yield from dive.command(ARM, 1)
        station.sticks = (0, 0, 200, 0)
        yield lambda: dive.position[2] > 2.0
        station.sticks = (500, 0, 500, 0)
        if lost == "channels":
            station.sticks, station.every = None, override
        yield 5.0
        speeds.append(hypot(*dive.run.simulation.state.nu[:2]))
        pulses.append(dive.run.pwm_us)
        station.sticks = station.every = None
        station.has_heartbeat = lost != "all"  # to ArduSub each MANUAL_CONTROL is a heartbeat, too
        yield lambda: station.output(text)
        yield 20.0

    dive.fly(mission(), 200.0)
    beat, pwm_us, depth = station.latest["HEARTBEAT"], dive.run.pwm_us, dive.position[2]
    print(f"{lost} {settings}: {speeds[0]:.2f} m/s with {pulses[0]}; then depth {depth:.2f} m, {pwm_us}, {beat}")
    assert speeds[0] > 0.2
    assert (beat.custom_mode, bool(beat.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)) == (mode, is_armed)
    assert max(abs(pulse - 1500) for pulse in pwm_us[:4]) < 50  # it is not driven ahead any more
    assert depth < 0.5 or mode != ALT_HOLD
