"""Motors of a frame as thrusters of a vehicle: matched by geometry, and correct for every stick, motor by motor."""

import pytest

from hil.autopilots.frames import CUSTOM, Motor, load_frame, map_motors, push_text
from hil.cli import main
from hil.common.errors import ConfigError
from hil.common.schema import preset_names
from sim.vehicle.thrusters.bank import steady_thrust, wrench_matrix
from sim.vehicle.vehicle import Vehicle, load_vehicle

FRAMES = {"bluerov2": "vectored", "bluerov2_blue": "vectored", "bluerov2_li2020": "vectored",
          "bluerov2_heavy": "vectored_6dof", "bluerov2_heavy_px4": "vectored_6dof",
          "bluerov2_heavy_t200": "vectored_6dof", "bluerov2_heavy_wu2018": "vectored_6dof",
          "bluerov2_heavy_vonbenzon2022": "vectored_6dof"}  # fmt: skip
# Outputs of a running ArduSub 4.6 in MANUAL with a gain of 0.5: stick -> outputs, and the axis of X Y Z K M N with
# its sign along which the vehicle must move.
HORIZONTAL = {
    "ahead": ((1400, 1400, 1600, 1600), 0, 1),
    "right": ((1600, 1400, 1600, 1400), 1, 1),
    "yaw right": ((1600, 1400, 1400, 1600), 5, 1),
}
VERTICAL = {"up": (1400, 2, -1), "down": (1600, 2, 1)}
TURNS = {
    "bow up": ((1100, 1100, 1899, 1899), 4, 1),
    "right side down": ((1899, 1100, 1899, 1100), 3, 1),
}


def wrench(vehicle: Vehicle, outputs: tuple[int, ...]) -> list[float]:
    pulses = map_motors("auto", vehicle).pulses(outputs)
    thrusts = [steady_thrust(thruster, pulse) for thruster, pulse in zip(vehicle.thrusters, pulses, strict=True)]
    return [sum(a * b for a, b in zip(row, thrusts, strict=True)) for row in wrench_matrix(vehicle, torque=False)]


def assert_along(values: list[float], axis: int, sign: int) -> None:
    """Assert a motion along one axis, with at most a fifth of it in the others: astern a thruster gives less."""
    assert values[axis] * sign > 1.0
    kind = range(3) if axis < 3 else range(3, 6)
    assert all(abs(values[other]) < 0.25 * abs(values[axis]) for other in kind if other != axis), values


@pytest.mark.parametrize(("name", "frame"), FRAMES.items())
def test_the_frame_is_found_and_every_stick_moves_its_axis(name: str, frame: str) -> None:
    vehicle, _ = load_vehicle(name)
    motors = map_motors("auto", vehicle)
    assert motors.frame == frame
    assert sorted(motor.channel for motor in motors.motors) == list(range(len(vehicle.thrusters)))
    verticals = len(vehicle.thrusters) - 4
    for four, axis, sign in HORIZONTAL.values():
        assert_along(wrench(vehicle, (*four, *[1500] * verticals)), axis, sign)
    for pulse, axis, sign in VERTICAL.values():
        assert_along(wrench(vehicle, (*[1500] * 4, *[pulse] * verticals)), axis, sign)
    if verticals == 4:
        for four, axis, sign in TURNS.values():
            assert_along(wrench(vehicle, (*[1500] * 4, *four)), axis, sign)


def test_a_reversed_thruster_gets_reversed_pulses() -> None:
    vehicle, _ = load_vehicle("bluerov2_heavy")  # as published its positive thrusts are the opposite of ArduSub's
    motors = map_motors("vectored_6dof", vehicle)
    assert {motor.sign for motor in motors.motors} == {-1}
    assert motors.pulses((1600, 1500, 1400, 1100, 1900, 1500, 1500, 1500))[:5] == (1400, 1500, 1600, 1900, 1100)


@pytest.mark.parametrize("width", [0, 1, 799, 2201, 65_535])
def test_a_missing_output_is_neutral_and_never_full_reverse(width: int) -> None:
    for name in ("bluerov2", "bluerov2_heavy"):
        vehicle, _ = load_vehicle(name)
        assert set(map_motors("auto", vehicle).pulses((width,) * 16)) == {1500}
        assert set(map_motors("auto", vehicle).pulses(())) == {1500}


def test_a_frame_that_does_not_fit_is_refused_with_the_motor() -> None:
    vehicle, _ = load_vehicle("bluerov2")
    with pytest.raises(ConfigError, match=r"no thruster of bluerov2 pushes like motor 1 \(ahead"):
        map_motors("bluerov1", vehicle)
    with pytest.raises(ConfigError, match="8 motors, bluerov2 6 thrusters"):
        map_motors("vectored_6dof", vehicle)
    torpedo, _ = load_vehicle("remus100")
    with pytest.raises(ConfigError, match="no frame matches remus100"):
        map_motors("auto", torpedo)
    with pytest.raises(ConfigError, match=r"no autopilot frame 'vectord'; did you mean 'vectored'"):
        map_motors("vectord", vehicle)


def test_swapped_thrusters_are_matched_by_position() -> None:
    """A motor with its right and left wires swapped is another thruster: it is matched by its position."""
    vehicle, _ = load_vehicle("bluerov2")
    first, second, *others = vehicle.thrusters
    swapped = map_motors("vectored", vehicle._replace(thrusters=(second, first, *others)))
    assert swapped.motors[:2] == (Motor(0, 1, 1), Motor(1, 0, 1))


def test_the_custom_frame_maps_channels_one_to_one() -> None:
    vehicle, _ = load_vehicle("remus100")
    motors = map_motors(CUSTOM, vehicle)
    widths = tuple(1500 + 10 * i for i in range(len(vehicle.channels)))
    assert motors.pulses((*widths, 1900, 1900)) == widths


def test_every_installed_frame_can_be_read() -> None:
    names = preset_names("hil/autopilots/frames")
    assert len(names) == len({load_frame(name).frame_config for name in names}) == 7  # all but ArduSub's custom one
    for name in names:
        assert 3 <= len(load_frame(name).motors) <= 8


def test_the_text_of_a_wrench_names_its_directions() -> None:
    assert push_text((1.0, -1.0, 0.0, 0.0, 0.0, 0.2)) == "ahead, to the left, turn right"
    assert push_text((0.0,) * 6) == "nowhere"


def test_the_command_prints_motors_and_parameters(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["autopilot", "motors", "ardusub"]) == 0
    assert "motor 1 (front_right, mirrored): astern, to the right, turn right" in capsys.readouterr().out
    assert main(["autopilot", "parameters", "ardusub"]) == 0
    assert "FRAME_CONFIG 2\n" in capsys.readouterr().out
    assert main(["autopilot", "motors", "paper_field"]) == 2
    assert "no autopilot" in capsys.readouterr().err
