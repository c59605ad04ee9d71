"""The laws by which the MAVLink vehicle steers, its accessories and buttons: what each number leads to."""

from collections.abc import Callable
from math import atan2, cos, inf, nan, pi, sin
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.autonomy.control.controller import VelocityCommand
from hil.client.samples import State
from hil.gateways.mavlink.accessories import OUTPUTS, Accessories
from hil.gateways.mavlink.buttons import Buttons
from hil.gateways.mavlink.calibration import answer
from hil.gateways.mavlink.flight import guidance
from hil.gateways.mavlink.flight.guidance import Holds, go_to, piloted, push
from hil.gateways.mavlink.flight.modes import Mode
from hil.gateways.mavlink.flight.sticks import Sticks
from hil.gateways.mavlink.flight.targets import Target, TargetError, attitude_target, depth_of, local_target
from hil.gateways.mavlink.parameter_table import ParameterTable
from hil.gateways.mavlink.snapshot import Origin
from hil.ros.commands import MAX_DEPTH, MAX_PLACE
from tests.support.clients.mavlink_vehicle import Bench

TABLE = {
    **{f"HIL_FORCE_{axis}": force for axis, force in zip("XYZ", (80.0, 70.0, 60.0), strict=True)},
    **{f"HIL_MOMENT_{axis}": moment for axis, moment in zip("KMN", (5.0, 6.0, 7.0), strict=True)},
    "PILOT_SPEED": 0.8, "PILOT_SPEED_UP": 0.5, "PILOT_SPEED_DN": 0.25, "HIL_YAW_RATE": 0.6, "WPNAV_SPEED": 0.7,
    "HIL_DEPTH_MAX": 30.0, "HIL_STEER": 0.0, "WPNAV_RADIUS": 2.0, "WP_YAW_BEHAVIOR": 1.0, "PSC_POSXY_P": 0.5,
}  # fmt: skip


def state(heading: float = 0.0, position: Any = (0.0, 0.0, 5.0), nu: Any = (0.0,) * 6) -> State:
    return State(0, position, (cos(0.5 * heading), 0.0, 0.0, sin(0.5 * heading)), nu)


def table(**changes: float) -> ParameterTable:
    return TABLE | changes  # type: ignore[return-value]


def test_sticks_push_along_their_axes() -> None:
    assert push(Sticks(1.0, 0.5, 0.25, -1.0, -0.5, 0.1), table()) == pytest.approx((80, 35, -15, -2.5, 0.6, -7))


def test_level_vectors_are_turned_by_the_heading() -> None:
    heading = atan2(0.8, 0.6)
    assert guidance.in_body(1.0, 2.0, heading) == pytest.approx((2.2, 0.4))
    assert guidance.in_world(1.0, 2.0, heading) == pytest.approx((-1.0, 2.0))
    assert guidance.level_velocity(state(heading, nu=(1.0, 2.0, 9.0, 0, 0, 0))) == pytest.approx((-1.0, 2.0))


def held(**changes: Any) -> Holds:
    holds = Holds()
    for name, value in changes.items():
        setattr(holds, name, value)
    return holds


@pytest.mark.parametrize(
    ("sticks", "holds", "changes", "command"),
    [
        (Sticks(0.5, -0.5, 1.0, 0.5), held(), {}, VelocityCommand(0.4, -0.4, -0.5, 0.3)),
        (Sticks(z=-1.0), held(), {}, VelocityCommand(0.0, 0.0, 0.25, 0.0)),
        (Sticks(z=-1.0), held(), {"PILOT_SPEED_DN": 0.0}, VelocityCommand(0.0, 0.0, 0.5, 0.0)),
        (Sticks(), held(depth=50.0, heading=1.5), {}, VelocityCommand(0.0, 0.0, 0.0, 0.0, 30.0, 1.5)),
        (Sticks(), held(position=(0.4, -0.8)), {}, VelocityCommand(0.2, -0.4, 0.0, 0.0)),
        (Sticks(), held(position=(9.0, 0.0)), {}, VelocityCommand(0.7, 0.0, 0.0, 0.0)),
    ],
)
def test_sticks_and_holds_become_a_command(
    sticks: Sticks, holds: Holds, changes: dict[str, float], command: VelocityCommand
) -> None:
    found = piloted(sticks, state(), holds, table(**changes))
    assert [value for value in found if value is not None] == pytest.approx([v for v in command if v is not None])
    assert (found.depth, found.heading) == (command.depth, command.heading)


def test_what_is_held_is_where_the_vehicle_comes_to_rest() -> None:
    """A vehicle moves on for 0.4 s after its stick is let go; each stick releases what it moves."""
    holds, moving = Holds(), state(0.5 * pi, (1.0, 2.0, 5.0), (0.5, 0.25, 0.1, 0.0, 0.0, -0.2))
    holds.drive(Sticks(), moving, True, True)
    assert holds.depth == pytest.approx(5.04)
    assert holds.heading == pytest.approx(0.5 * pi - 0.08)
    assert holds.position == pytest.approx((0.9, 2.2))
    holds.drive(Sticks(), state(), True, True)
    assert holds.depth == pytest.approx(5.04), "what is held stays"
    holds.drive(Sticks(y=0.1), moving, True, True)
    assert (holds.position, holds.depth is None, holds.heading is None) == (None, False, False)
    holds.drive(Sticks(z=0.1, r=-0.1), moving, True, False)
    assert (holds.position, holds.depth, holds.heading) == (None, None, None)
    rising = state(0.0, (0.0, 0.0, 0.1), (0.0, 0.0, -1.0, 0.0, 0.0, 0.0))
    holds.hold(rising)
    assert holds.depth == 0.0, "the surface is the end"
    pitched = State(0, (0.0, 0.0, 5.0), (cos(0.1), 0.0, sin(0.1), 0.0), (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    holds.hold(pitched)
    assert holds.depth == pytest.approx(5.0 - 0.4 * 0.2), "ahead with the bow up is up"


@pytest.mark.parametrize(
    ("target", "heading", "now", "changes", "surge", "sway", "to"),
    [
        ((10.0, 0.0, 40.0), None, state(), {}, 0.7, 0.0, (30.0, 0.0)),
        ((0.0, 10.0, -1.0), None, state(), {}, 0.0, 0.3 * 0.7, (0.0, 0.5 * pi)),  # turns first
        ((10.0, 0.0, 5.0), None, state(0.6), {}, 0.21 * cos(0.6), -0.21 * sin(0.6), (5.0, 0.0)),
        ((10.0, 0.0, 5.0), None, state(0.4), {}, 0.7 * cos(0.4), -0.7 * sin(0.4), (5.0, 0.0)),
        ((0.0, 10.0, 5.0), None, state(), {"WP_YAW_BEHAVIOR": 0.0}, 0.0, 0.7, (5.0, 0.0)),
        ((0.0, 0.8, 5.0), None, state(), {}, 0.0, 0.4, (5.0, 0.0)),  # near: as it is
        ((10.0, 0.0, 5.0), 0.4, state(), {}, 0.7 * cos(0.4), None, (5.0, 0.4)),
        ((0.0, 10.0, 5.0), None, state(), {"HIL_STEER": 1.0}, 0.7, 0.0, (5.0, 0.5 * pi)),
        ((0.0, 2.0, 5.0), None, state(), {"HIL_STEER": 1.0}, 0.35, 0.0, (5.0, 0.5 * pi)),
        ((10.0, 0.0, 5.0), None, state(), {"speed": 0.2}, 0.2, 0.0, (5.0, 0.0)),
    ],
)
def test_a_place_is_approached(
    target: Any, heading: float | None, now: State, changes: dict[str, float], surge: float, sway: float | None, to: Any
) -> None:
    changes = dict(changes)
    speed = changes.pop("speed", None)
    found = go_to(target, heading, now, table(**changes), speed)
    assert (found.depth, found.heading) == pytest.approx(to)
    if sway is None:  # the heading is reached on the way
        assert 0.0 < found.surge <= 0.7
    else:
        assert (found.surge, found.sway) == pytest.approx((surge, sway), abs=1e-9)


@pytest.mark.parametrize(("distance", "reached"), [(1.99, True), (2.0, True), (2.01, False)])
def test_a_place_is_reached_within_the_radius(distance: float, reached: bool) -> None:
    assert guidance.is_reached((0.0, 0.0, 5.0 + distance), state(), 2.0) is reached


@pytest.mark.parametrize(("thrust", "heave"), [(0.5, 0.0), (1.0, -0.4), (0.0, 0.4), (2.0, -0.4), (0.75, -0.2)])
def test_thrust_of_an_attitude_target_is_a_speed_up(thrust: float, heave: float) -> None:
    packet = dialect.MAVLink_set_attitude_target_message(
        0, 1, 1, 1 << 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.3, thrust
    )  # fmt: skip
    found = attitude_target(packet, 0.4)
    assert found.velocity == pytest.approx((0.0, 0.0, heave))
    assert (found.heading, found.yaw_rate) == (None, 0.3)


@pytest.mark.parametrize(
    ("field", "value"),
    [("x", nan), ("vx", nan), ("vz", 20.1), ("vy", -20.1), ("yaw", inf), ("yaw_rate", nan), ("yaw_rate", -20.1)],
)
def test_a_number_of_a_target_is_finite_and_in_range_unless_it_is_ignored(field: str, value: float) -> None:
    fields = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)
    ignored = {"x": 0b111, "yaw": 1 << 10, "yaw_rate": 1 << 11}.get(field, 0b111000)
    accelerations = 0b111000000
    with pytest.raises(TargetError):
        local_target(target_message(accelerations, **fields | {field: value}), state())
    if abs(value) < inf and "v" in field + "v" * (field == "yaw_rate"):
        assert local_target(target_message(accelerations, **fields | {field: 20.0 if value > 0.0 else -20.0}), state())
    assert local_target(target_message(accelerations | ignored, **fields | {field: value}), state())


@pytest.mark.parametrize(
    ("field", "most"), [("x", MAX_PLACE), ("x", -MAX_PLACE), ("y", MAX_PLACE), ("y", -MAX_PLACE), ("z", MAX_DEPTH)]
)
def test_places_up_to_the_limit_are_targets(field: str, most: float) -> None:
    fields = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)
    target = local_target(target_message(0b110111111000, **fields | {field: most}), state())
    assert target.position is not None
    assert most in target.position
    with pytest.raises(TargetError):
        local_target(target_message(0b110111111000, **fields | {field: 1.001 * most}), state())


@pytest.mark.parametrize(("mask", "frame"), [(0b110111111000, 99), (0b110111111111, 1), (0b110000111111, 1), (0, 1)])
def test_a_target_needs_a_known_frame_and_something_that_can_be_followed(mask: int, frame: int) -> None:
    with pytest.raises(TargetError):
        local_target(dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *[0.0] * 11), state())


@pytest.mark.parametrize(
    ("ignored", "velocity"), [(0, (1, 2, 3)), (8, (0, 2, 3)), (16, (1, 0, 3)), (32, (1, 2, 0)), (48, (1, 0, 0))]
)
def test_each_axis_of_a_velocity_may_be_ignored(ignored: int, velocity: tuple[float, ...]) -> None:
    fields = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)
    found = local_target(target_message(0b110111000111 | ignored, **fields | {"vx": 1, "vy": 2, "vz": 3}), state())
    assert found.velocity == velocity


@pytest.mark.parametrize(("mask", "heading", "yaw_rate"), [(1 << 11, 0.7, 0.0), (1 << 10, None, -0.2), (0, 0.7, -0.2)])
def test_a_heading_or_a_turn_alone_is_a_target(mask: int, heading: float | None, yaw_rate: float) -> None:
    fields = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz"), 9.0) | {"yaw": 0.7, "yaw_rate": -0.2}
    found = local_target(target_message(0b111111111 | mask, **fields), state())
    assert found == Target(None, (0.0, 0.0, 0.0), heading, yaw_rate)


def target_message(mask: int, **fields: float) -> Any:
    return dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, mask, *fields.values())


def test_altitudes_become_depths() -> None:
    origin = Origin(45.0, 10.0, 100.0)
    assert depth_of(97.0, False, origin, 0.5) == 3.0
    assert depth_of(-3.0, False, None, 0.5) == 3.0
    assert depth_of(-3.0, True, origin, 0.5) == 3.5


def test_pulses_of_outputs_move_what_hangs_at_them() -> None:
    moved: dict[str, float] = {}
    outputs = Accessories(moved.__setitem__)
    assert [outputs.set_pulse(output, 1500.0) for output in (8, 9, 16, 17)] == [False, True, True, False]
    assert not outputs.set_pulse(9, float("nan"))
    for output, pulse in ((9, 1300.0), (11, 1300.0), (12, 2500.0), (13, 900.0)):
        outputs.set_pulse(output, pulse)
    assert moved == pytest.approx({"lights": 0.25, "gripper": -0.5, "camera_tilt": 1.0})
    assert (outputs.pulses[12], outputs.pulses[13], outputs.tilt) == (1900, 1100, 45.0)
    outputs.turn_to("CamTilt", -22.5)
    assert (outputs.pulses[12], outputs.tilt) == (1300, -22.5)
    outputs.change("Lights1", 0.5)
    assert outputs.pulses[9] == 1700
    assert [outputs.switch(relay, True) for relay in (-1, 0, 3, 4)] == [False, True, True, False]
    outputs.reset()
    assert outputs.pulses == {row.number: row.first_us for row in OUTPUTS.values()} | {16: 1500}


def lights(bench: Bench) -> int:
    return bench.core.accessories.pulses[9]


@pytest.mark.parametrize(
    ("functions", "read", "expected"),
    [
        ((31,), lights, 1200), ((31,) * 9, lights, 1100), ((32, 32, 33), lights, 1200),
        ((34,), lambda b: b.core.accessories.pulses[10], 1200),
        ((35, 35, 36), lambda b: b.core.accessories.pulses[10], 1200),
        ((51,), lambda b: b.core.accessories.relays, [True, False, False, False]),
        ((55, 51, 52), lambda b: b.core.accessories.relays, [False] * 4),
        ((56, 59), lambda b: b.core.accessories.relays, [False, True, True, False]),
        ((61, 61, 62), lights, 1150), ((64,), lights, 1900), ((63,), lights, 1100), ((65,), lights, 1500),
        ((69,), lambda b: b.core.accessories.pulses[10], 1900),
        ((42,), lambda b: b.core.pilot.joystick.gain, 1.0), ((41,), lambda b: b.core.pilot.joystick.gain, 0.5),
        ((41, 41), lambda b: b.core.pilot.joystick.gain, 1.0),
        ((49,), lambda b: b.core.pilot.joystick.turns_hull, True),
        ((49, 49), lambda b: b.core.pilot.joystick.turns_hull, False),
        ((11,), lambda b: b.core.pilot.mode, Mode.GUIDED), ((8,), lambda b: b.core.pilot.mode, Mode.POSHOLD),
        ((3,), lambda b: b.core.pilot.armed, True), ((2,), lambda b: b.core.pilot.armed, True),
        ((2, 2), lambda b: b.core.pilot.armed, False), ((3, 4), lambda b: b.core.pilot.armed, False),
    ],
)  # fmt: skip
def test_each_function_of_a_button_acts_when_it_is_pressed(
    functions: tuple[int, ...], read: Callable[[Bench], Any], expected: Any
) -> None:
    bench = Bench()
    bench.core.pilot.joystick.gain = 1.0 if functions[0] == 41 else bench.core.pilot.joystick.gain
    buttons = Buttons(bench.core)
    for number, function in enumerate(functions):
        bench.table.set("BTN0_FUNCTION", function)
        for mask in (1, 1, 0):  # it is held, which counts once
            buttons.receive(mask, bench.now + number * 10**9)
    assert any(text.startswith("#") for _, text in bench.core.texts) == (functions[-1] in (41, 42, 49))
    assert read(bench) == expected


@pytest.mark.parametrize(
    ("function", "name", "pulse"), [(22, "CamTilt", 1553), (23, "CamTilt", 1447), (26, "CamPan", 1553)]
)
def test_the_camera_turns_while_a_button_is_held(function: int, name: str, pulse: int) -> None:
    """A third of its range a second; a gap between two packets counts as a tenth of a second at most."""
    bench = Bench()
    buttons = Buttons(bench.core)
    bench.table.set("BTN1_FUNCTION", function)
    for at_ms in (0, 50, 100, 4000):
        buttons.receive(2 if at_ms else 0, 10**9 + at_ms * 10**6)
    assert bench.core.accessories.pulses[OUTPUTS[name].number] == pulse
    bench.table.set("BTN1_FUNCTION", 21)
    buttons.receive(0, 5 * 10**9)
    buttons.receive(2, 6 * 10**9)
    assert bench.core.accessories.pulses[OUTPUTS[name].number] == 1500


@pytest.mark.parametrize(
    ("kind", "throttle", "share"),
    [(0, 0.0, -1.0), (0, 75.0, 0.5), (1, 1900.0, 1.0), (1, 1100.0, -1.0), (1, 1099.0, None), (1, 1901.0, None),
     (0, 101.0, None)],
)  # fmt: skip
def test_a_motor_test_has_the_range_of_the_pulses(kind: int, throttle: float, share: float | None) -> None:
    bench = Bench()
    bench.arm()
    order = dialect.MOTOR_TEST_ORDER_BOARD
    result = bench.partner.command(dialect.MAV_CMD_DO_MOTOR_TEST, 2, kind, throttle, 1, 0, order)
    assert result == (dialect.MAV_RESULT_FAILED if share is None else dialect.MAV_RESULT_ACCEPTED)
    assert bench.partner.command(dialect.MAV_CMD_DO_MOTOR_TEST, 2, kind, 0.0) == dialect.MAV_RESULT_FAILED, "order"
    if share is not None:
        bench.run(0.1)
        assert bench.vehicle.commands[-1] == (2, share * bench.table["HIL_THRUST"])


@pytest.mark.parametrize(("asked", "mask"), [(0.0, 1), (0.5, 0), (5.0, 5), (255.0, 255), (256.0, 1), (nan, 1)])
def test_a_calibration_of_compasses_is_reported_for_those_asked_for(asked: float, mask: int) -> None:
    _, (report,) = answer(dialect.MAV_CMD_DO_START_MAG_CAL, (asked, *[0.0] * 6))
    fields = {name: value for name, value in report.to_dict().items() if value and name != "mavpackettype"}
    ones = dict.fromkeys(("autosaved", "fitness", "diag_x", "diag_y", "diag_z"), 1)
    assert fields.pop("cal_mask", 0) == mask
    assert fields == ones | {"cal_status": dialect.MAG_CAL_SUCCESS}


def test_the_last_side_of_an_accelerometer_is_reported_as_done_to_everybody() -> None:
    texts, (done,) = answer(dialect.MAV_CMD_PREFLIGHT_CALIBRATION, (-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0))
    fields = {name: value for name, value in done.to_dict().items() if value and name != "mavpackettype"}
    success = {"command": dialect.MAV_CMD_ACCELCAL_VEHICLE_POS, "param1": dialect.ACCELCAL_VEHICLE_POS_SUCCESS}
    assert (texts, fields) == (["accelerometer: calibrated"], success)


def test_texts_of_the_pilot_and_of_the_mission_are_sent_once() -> None:
    bench = Bench()
    bench.core.pilot.texts.append((6, "of the pilot"))
    bench.core.flight.texts.append((6, "of the mission"))
    bench.core.texts.extend([(6, "a" * 51), (6, "b" * 51)])
    bench.run(0.5)
    received = bench.partner.take_messages("STATUSTEXT")
    first, _, second, _ = [text.id for text in received if text.id]
    assert second == first + 1, "the parts of a long text have a number of their own"
    texts = [text.text for text in received]
    assert (texts.count("of the pilot"), texts.count("of the mission")) == (1, 1)
