"""Commands, sticks and packets of the MAVLink vehicle: what each is limited to, and who may send it."""

from math import cos, nan, pi, radians, sin
from typing import Any, cast

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.common.clock import NS_PER_S
from hil.gateways.mavlink.flight.modes import Mode, mode_of
from hil.gateways.mavlink.flight.sticks import CENTRED, Joystick, Sticks
from hil.gateways.mavlink.snapshot import Origin
from hil.links.contract import Counters
from hil.links.mavlink.stream import MavlinkStream
from tests.support.clients.mavlink_vehicle import Bench

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
MODE, LASTS_NS = dialect.MAV_CMD_DO_SET_MODE, NS_PER_S


def int_command(bench: Bench, frame: int, *params: Any, command: int = dialect.MAV_CMD_DO_REPOSITION) -> int:
    bench.partner.take_messages("COMMAND_ACK")
    bench.partner.send(dialect.MAVLink_command_int_message(1, 1, frame, command, 0, 0, *params))
    return int(bench.partner.take_messages("COMMAND_ACK")[-1].result)


@pytest.mark.parametrize(
    ("params", "frame", "result", "speed", "heading", "place"),
    [
        ((-1.0, 1.0, 0.0, nan, 450000000, 100000000, -4.0), 0, ACCEPTED, None, None, (0.0, 0.0, 4.0)),
        ((1.5, 1.0, 0.0, 90.0, 450000000, 100000000, -4.0), 0, ACCEPTED, 1.5, 0.5 * pi, (0.0, 0.0, 4.0)),
        ((9.0, 1.0, 0.0, nan, 450000000, 100000000, 3.0), 0, ACCEPTED, 5.0, None, (0.0, 0.0, 0.0)),
        ((0.0, 1.0, 0.0, nan, 450000000, 100000000, nan), 0, ACCEPTED, None, None, (0.0, 0.0, 2.0)),
        ((nan, 3.0, 0.0, nan, 450000000, 100000000, -4.0), 3, ACCEPTED, None, None, (0.0, 0.0, 4.5)),
        ((1.0, 1.0, 0.0, nan, 450000000, 100000000, -4.0), 1, DENIED, None, None, None),
        ((1.0, 2.0, 0.0, nan, 450000000, 100000000, -4.0), 0, DENIED, None, None, None),
        ((1.0, nan, 0.0, nan, 450000000, 100000000, -4.0), 0, DENIED, None, None, None),
        ((1.0, 1.0, 0.0, nan, 800000000, 100000000, -4.0), 0, DENIED, None, None, None),
        ((1.0, 1.0, 0.0, nan, 450000000, 300000000, -4.0), 0, DENIED, None, None, None),
        ((1.0, 1.0, 0.0, nan, 910000000, 100000000, -4.0), 0, DENIED, None, None, None),
    ],
)
def test_a_place_to_go_to_is_checked_before_it_is_a_target(
    params: Any, frame: int, result: int, speed: float | None, heading: float | None, place: Any
) -> None:
    bench = Bench()
    bench.core.set_home((0.0, 0.0, 0.5))
    assert int_command(bench, frame, *params) == (result or REJECTED), "disarmed"
    bench.arm(Mode.MANUAL)
    assert int_command(bench, frame, *params) == result
    target = bench.core.pilot.target
    assert (target is None) == (place is None)
    if target:
        assert target.position == pytest.approx(place, abs=1e-6)
        assert (target.speed, target.heading) == (speed, heading and pytest.approx(heading))


@pytest.mark.parametrize(
    ("params", "result", "heading"),
    [
        ((90.0,), ACCEPTED, 0.5 * pi), ((90.0, 0.0, -1.0), ACCEPTED, 0.5 * pi), ((nan,), DENIED, None),
        ((90.0, 0.0, 1.0, 1.0), ACCEPTED, 0.3 + 0.5 * pi), ((90.0, 0.0, 0.0, 1.0), ACCEPTED, 0.3 + 0.5 * pi),
        ((90.0, 0.0, -1.0, 1.0), ACCEPTED, 0.3 - 0.5 * pi), ((90.0, 0.0, 0.0, 2.0), ACCEPTED, 0.5 * pi),
    ],
)  # fmt: skip
def test_a_turn_in_guided_keeps_the_place(params: tuple[float, ...], result: int, heading: float | None) -> None:
    bench = Bench()
    yaw = dialect.MAV_CMD_CONDITION_YAW
    assert bench.partner.command(yaw, *params) == REJECTED, "only Guided turns"
    bench.arm(Mode.GUIDED)
    bench.vehicle.heading, bench.vehicle.north = 0.3, 3.0
    bench.core.tick(bench.now)
    assert bench.partner.command(yaw, *params) == result
    target = bench.core.pilot.target
    assert (target is None) == (heading is None)
    if target:
        assert target.position == (3.0, 0.0, 2.0)
        assert target.heading == pytest.approx(heading)


@pytest.mark.parametrize(
    ("place", "taken"),
    [((90 * 10**7, 180 * 10**7, 10**7), True), ((-90 * 10**7, -180 * 10**7, -(10**7)), True),
     ((90 * 10**7 + 1, 0, 0), False), ((0, 180 * 10**7 + 1, 0), False), ((0, 0, 10**7 + 1), False),
     ((-90 * 10**7 - 1, 0, 0), False), ((0, -180 * 10**7 - 1, 0), False), ((0, 0, -(10**7) - 1), False)],
)  # fmt: skip
def test_an_origin_is_a_place_on_the_earth(place: tuple[int, int, int], taken: bool) -> None:
    bench = Bench(origin=None)
    bench.partner.send(dialect.MAVLink_set_gps_global_origin_message(1, *place))
    assert bench.core.origin == (Origin(place[0] * 1e-7, place[1] * 1e-7, place[2] * 1e-3) if taken else None)


COMMANDS: dict[str, tuple[int, tuple[float, ...], int]] = {  # command, parameters, result
    "mode by flags": (MODE, (1, Mode.STABILIZE), ACCEPTED),
    "mode without the flag": (MODE, (8, Mode.STABILIZE), DENIED),
    "mode with flags of no number": (MODE, (nan, Mode.STABILIZE), DENIED),
    "speed": (178, (1, 0.5), ACCEPTED), "speed of zero": (178, (1, 0.0), DENIED),
    "speed beyond the parameter": (178, (1, 99.0), FAILED), "speed of no number": (178, (1, nan), DENIED),
    "item of no number": (224, (nan,), DENIED), "item that is not there": (224, (5,), DENIED),
    "pause": (193, (0,), UNSUPPORTED), "termination": (185, (1,), UNSUPPORTED), "home here": (179, (1,), ACCEPTED),
    "home of no number": (179, (0, 0, 0, 0, nan, 10.0, 0.0), DENIED),
    "home at a place": (179, (0, 0, 0, 0, 45.0001, 10.0, 0.0), ACCEPTED),
    "home too far away": (179, (0, 0, 0, 0, 55.0, 10.0, 0.0), DENIED),
    "servo": (183, (9, 1500), ACCEPTED), "servo of no number": (183, (nan, 1500), FAILED),
    "thruster as servo": (183, (8, 1500), FAILED), "relay": (181, (0, 1), ACCEPTED),
    "relay 4": (181, (4, 1), DENIED), "relay of no number": (181, (nan, 1), DENIED),
    "storing": (245, (1,), ACCEPTED), "loading": (245, (0,), ACCEPTED), "resetting": (245, (2,), UNSUPPORTED),
    "gripper opens": (211, (1, 0), ACCEPTED),
    "land": (21, (), ACCEPTED), "loiter": (17, (), ACCEPTED),
}  # fmt: skip


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_is_accepted_only_with_parameters_that_mean_something(name: str) -> None:
    command, params, result = COMMANDS[name]
    bench = Bench()
    bench.vehicle.north = 4.0
    bench.run(0.1)
    assert bench.partner.command(command, *params) == result
    core = bench.core
    changed = {
        "land": core.pilot.mode == Mode.SURFACE, "loiter": core.pilot.mode == Mode.POSHOLD,
        "home here": core.home == (4.0, 0.0, 0.0), "relay": core.accessories.relays[0],
        "home at a place": core.home == pytest.approx((11.1, 0.0, 0.0), abs=0.1),
        "gripper opens": core.accessories.pulses[11] == 1900, "speed": core.table["WPNAV_SPEED"] == 0.5,
    }  # fmt: skip
    assert changed.get(name, True)


@pytest.mark.parametrize(("command", "params"), [(205, (45.0, 0.0, -45.0)), (1000, (45.0, -45.0))])
def test_the_camera_tilts_and_pans_by_both_commands(command: int, params: tuple[float, ...]) -> None:
    bench = Bench()
    pulses = bench.core.accessories.pulses
    assert bench.partner.command(command, *params) == ACCEPTED
    assert (pulses[12], pulses[13]) == (1900, 1100)
    assert bench.partner.command(command, *[nan] * len(params)) == ACCEPTED
    assert (pulses[12], pulses[13]) == (1900, 1100)


def test_the_interval_of_no_message_is_that_of_message_0() -> None:
    bench = Bench()
    for number, answered in ((nan, 0), (2.0**24 + 6.0, 0), (-5.0, 0), (30, 30), (65_536 + 30, 30)):
        assert bench.partner.command(dialect.MAV_CMD_GET_MESSAGE_INTERVAL, number) == ACCEPTED
        assert bench.partner.take_messages("MESSAGE_INTERVAL")[0].message_id == answered


@pytest.mark.parametrize(("mask", "tilt", "remarks"), [(0, 0.2, 1), (1 << 7, 0.2, 0), (0, 0.015, 0), (0, -0.2, 1)])
def test_roll_and_pitch_of_an_attitude_target_are_remarked_on_if_they_are_meant(
    mask: int, tilt: float, remarks: int
) -> None:
    for axis in (1, 2):
        bench = Bench()
        bench.arm(Mode.GUIDED)
        q = [cos(0.5 * tilt), 0.0, 0.0, 0.0]
        q[axis] = sin(0.5 * tilt)
        bench.partner.send(dialect.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, 0.0, 0.0, 0.3, 0.5))
        bench.run(0.1)
        assert bench.partner.texts().count("roll and pitch stay level") == remarks


def test_only_a_plain_reboot_of_a_disarmed_vehicle_restarts_it_with_centred_accessories_and_mode_manual() -> None:
    bench, reboot = Bench(), dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
    bench.core.set_mode(Mode.POSHOLD)
    bench.partner.command(dialect.MAV_CMD_DO_SET_SERVO, 9, 1900)
    bench.core.flight.current = 5
    assert [bench.partner.command(reboot, number) for number in (0, 2, 1)] == [UNSUPPORTED, UNSUPPORTED, ACCEPTED]
    core = bench.core
    assert (core.pilot.mode, core.accessories.pulses[9], core.flight.current) == (Mode.MANUAL, 1100, 1)
    bench.arm()
    assert bench.partner.command(reboot, 1) == DENIED


# --- sticks


def joystick(dead_zone: float = 0.05) -> Joystick:
    table: Any = {"JS_GAIN_DEFAULT": 0.5, "JS_GAIN_MIN": 0.25, "JS_GAIN_MAX": 1.0, "JS_GAIN_STEPS": 4.0,
                  "HIL_DEADZONE": dead_zone}  # fmt: skip
    return Joystick(table)


def control(x: int = 0, y: int = 0, z: int = 500, r: int = 0, **more: int) -> Any:
    return dialect.MAVLink_manual_control_message(1, x, y, z, r, 0, **more)


SENDER, OTHER = (1, 255, 190), (1, 254, 190)


@pytest.mark.parametrize(
    ("packet", "sticks"),
    [
        (control(x=1000, y=-1000, r=600), Sticks(0.5, -0.5, 0.0, 0.3)), (control(x=2000, r=-2000), Sticks(0.5, r=-0.5)),
        (control(z=0), Sticks(z=-0.5)), (control(z=1000), Sticks(z=0.5)), (control(z=2000), Sticks(z=0.5)),
        (control(z=-900), Sticks(z=-0.5)), (control(x=50, y=51), Sticks(y=0.0255)),
        (control(x=-50, y=-51), Sticks(y=-0.0255)),
        (control(enabled_extensions=1, s=800, t=800), Sticks(m=0.4)), (control(s=800, t=800), Sticks()),
        (control(enabled_extensions=2, s=800, t=800), Sticks(k=0.4)),
        (control(z=0x7FFF, enabled_extensions=3, s=800, t=0x7FFF), Sticks(m=0.4)),
    ],
)  # fmt: skip
def test_sticks_are_scaled_limited_and_centred(packet: Any, sticks: Sticks) -> None:
    held = joystick()
    assert held.receive(packet, SENDER, 5, LASTS_NS)
    assert held.sticks(5) == pytest.approx(sticks)
    assert held.sticks(5 + LASTS_NS) == pytest.approx(sticks)
    assert held.sticks(6 + LASTS_NS) == CENTRED


def test_who_holds_the_sticks_has_them_until_they_expire() -> None:
    held = joystick()
    assert not held.is_alive(0)
    assert held.receive(control(x=1000), SENDER, 0, LASTS_NS)
    assert not held.receive(control(x=-1000), OTHER, LASTS_NS, LASTS_NS)
    assert not held.receive(control(x=-1000), SENDER, 1, LASTS_NS, is_stale=True)
    assert (held.refused, held.stale, held.sticks(LASTS_NS).x) == (1, 1, 0.5)
    held.holds = (0.1, 0.0, 0.0)
    assert held.receive(control(), OTHER, LASTS_NS + 1, LASTS_NS)
    assert (held.holds, held.sticks(LASTS_NS + 1)) == ((0.0, 0.0, 0.0), CENTRED), "what was held ends, too"
    held.release()
    assert not held.is_alive(0)


@pytest.mark.parametrize(
    ("channels", "changed", "sticks"),
    [
        ({1: 1900, 2: 1100}, {1: 1900, 2: 1100}, Sticks(m=1.0, k=-1.0)), ({5: 2500}, {5: 2500}, Sticks(x=1.0)),
        ({5: 900}, {5: 900}, Sticks(x=-1.0)), ({6: 0}, {6: 0}, Sticks()), ({9: 0}, {}, Sticks()),
        ({8: 0, 9: 65534}, {8: 0, 9: 0}, Sticks()), ({18: 1700}, {18: 1700}, Sticks()),
        ({3: 1700}, {3: 1700}, Sticks(z=0.5)),
    ],
)  # fmt: skip
def test_channels_are_sticks_and_outputs(channels: dict[int, int], changed: dict[int, int], sticks: Sticks) -> None:
    held = joystick(0.0)
    packet = dialect.MAVLink_rc_channels_override_message(1, 1, *[channels.get(n, 0xFFFF) for n in range(1, 19)])
    assert held.override(packet, SENDER, 0, LASTS_NS, is_stale=True) is None
    assert held.override(packet, SENDER, 0, LASTS_NS) == changed
    assert held.sticks(0) == pytest.approx(sticks)
    assert held.channels(0) == tuple(round(1500 + 400 * getattr(sticks, axis)) for axis in "mkzrxy")
    assert held.override(packet, OTHER, 0, LASTS_NS) is None


def test_the_gain_stays_within_its_limits_and_the_hull_turns_by_the_sticks() -> None:
    held = joystick(0.0)
    assert [held.change_gain(step) for step in (1, 1, 1, -1, -5)] == [0.75, 1.0, 1.0, 0.75, 0.25]
    held.receive(control(), SENDER, 0, LASTS_NS)
    cast(Any, held._parameters)["JS_GAIN_STEPS"] = 1.0
    assert held.change_gain(1) == 1.0, "one step is the whole range"
    held.gain, held.turns_hull, held.holds = 1.0, True, (0.2, -0.2, 0.5)
    held.receive(control(x=500, y=250), SENDER, 0, LASTS_NS)
    assert held.sticks(0) == pytest.approx(Sticks(0.2, -0.2, 0.5, 0.0, 0.05, -0.7))


def test_input_hold_keeps_what_is_deflected_by_more_than_its_least() -> None:
    held = joystick(0.0)
    held.gain = 1.0
    held.receive(control(x=51, y=50, z=750), SENDER, 0, LASTS_NS)
    assert held.hold()
    assert held.holds == pytest.approx((0.051, 0.0, 0.5))
    xs = []
    for x, z in ((900, 500), (0, 500), (900, 500), (1000, 500)):  # nothing is added until they were centred
        held.receive(control(x=x, z=z), SENDER, 0, LASTS_NS)
        xs.append(held.sticks(0).x)
    assert xs == pytest.approx([0.051, 0.051, 0.951, 1.0])
    held.receive(control(), SENDER, 0, LASTS_NS)
    assert not held.hold()
    assert held.holds == (0.0, 0.0, 0.0)


# --- who is spoken to


@pytest.mark.parametrize(
    ("system", "component", "taken"), [(1, 1, True), (0, 0, True), (1, 0, True), (2, 1, False), (1, 2, False)]
)
def test_only_packets_for_this_vehicle_are_executed(system: int, component: int, taken: bool) -> None:
    bench = Bench()
    bench.partner.send(
        dialect.MAVLink_command_long_message(system, component, 176, 0, 1, Mode.STABILIZE, 0, 0, 0, 0, 0)
    )
    assert (bench.core.pilot.mode == Mode.STABILIZE, len(bench.partner.take_messages("COMMAND_ACK"))) == (taken, taken)


def test_its_own_packets_which_a_router_returns_are_ignored() -> None:
    bench = Bench()
    for component, mode in ((1, Mode.MANUAL), (2, Mode.STABILIZE)):
        returned = MavlinkStream(1, component, Counters()).pack(
            dialect.MAVLink_command_long_message(1, 1, MODE, 0, 1, Mode.STABILIZE, 0, 0, 0, 0, 0)
        )
        bench.partner.feed(returned)
        assert bench.core.pilot.mode == mode


@pytest.mark.parametrize(("number", "mode"), [(0, 0), (19.0, 19), (19.5, None), (nan, None), (1e6, None), (-1, None)])
def test_only_numbers_of_modes_are_modes(number: float, mode: int | None) -> None:
    assert mode_of(number) == mode


def test_urgent_commands_are_sent_at_once_and_others_twenty_times_a_second() -> None:
    bench = Bench()
    bench.arm()
    bench.run(0.2)
    before = len(bench.vehicle.commands)
    bench.run(2.0)
    assert len(bench.vehicle.commands) - before == pytest.approx(40, abs=8)
    bench.run(1.0, bench.partner.sticks)
    assert len(bench.vehicle.commands) - before == pytest.approx(90, abs=8)
    target = dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0b110111111000, *[1.0] * 11)
    channels = dialect.MAVLink_rc_channels_override_message(1, 1, *[1500] * 18)
    for message in (dialect.MAVLink_set_mode_message(1, 1, Mode.GUIDED), target, channels, None):
        before = len(bench.vehicle.commands)
        while len(bench.vehicle.commands) == before:
            bench.run(0.02)
        bench.partner.send(message) if message else bench.core.disarm()
        bench.run(0.02)
        assert len(bench.vehicle.commands) == before + 2, message


def test_the_turns_of_the_tether_are_counted_in_quarters() -> None:
    bench = Bench()
    for step in range(-1, 12):
        bench.vehicle.heading = radians((40 * step + 180) % 360 - 180)
        bench.run(0.02)
    assert bench.core.context(0, 0).panel["TetherTrn"] == 1.0
