"""Fins, hull lift and cross-flow drag against formulas, and that none of them adds energy."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import cos, exp, inf, isfinite, pi, sin, sqrt
from pathlib import Path
from random import Random

import pytest

from hil.common.errors import ConfigError
from sim.dynamics import Dynamics
from sim.environment.world import load_world
from sim.forces import Force
from sim.rotations import Rotation
from sim.simulation import Simulation
from sim.vehicle.body_lift import CrossFlow, CrossFlowDrag, HullLift, Lift, SpeedDamping
from sim.vehicle.fins import Fin, FinSet, fin_matrix, lift_slope
from sim.vehicle.servos import deflection, pulse
from sim.vehicle.thrusters.bank import ThrusterSet
from sim.vehicle.vehicle import load_vehicle

LEVEL: Rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
DEEP = (0.0, 0.0, 50.0)
RHO = 1025.0
RUDDER = Fin(
    "rudder", (-1.0, 0.0, 0.0), (0.0, 0.0, -2.0), 0.02, 0.5, aspect_ratio=2.0, stall_angle=0.3, stall_width=0.2
)
SEA = load_world("pool")._replace(walls=False, depth=1e4, density=RHO)
TORPEDOES = ("remus100", "lauv", "eca_a9", "tethys")


def wrench(force: Force, *nu: float) -> Sequence[float]:
    return force.wrench(DEEP, LEVEL, (*nu, *(0.0,) * (6 - len(nu))))


def rudder(angle: float, fin: Fin = RUDDER) -> FinSet:
    fins = FinSet([fin], RHO, 0.01)
    fins.servos.values = [angle]
    return fins


# -- the polar ----------------------------------------------------------------------------------------------------


def test_known_wings_have_their_lift_slope() -> None:
    assert lift_slope(1e4) == pytest.approx(2.0 * pi, rel=1e-3)  # a long one: thin-aerofoil theory
    assert lift_slope(0.1) == pytest.approx(0.5 * pi * 0.1, rel=1e-2)  # a short one: Jones
    assert RUDDER.polar.lift_slope == pytest.approx(2.0 * pi / (1.0 + sqrt(2.0)))
    assert RUDDER.polar.induced_drag == pytest.approx(1.0 / (pi * 0.9 * 2.0))


def test_lift_and_drag_scale_with_dynamic_pressure() -> None:
    for speed, angle in ((0.5, 0.1), (2.0, -0.2), (1.0, 0.3)):
        slope = RUDDER.polar.lift_slope
        size = 0.5 * RHO * speed * speed * 0.02
        lift, drag = size * slope * angle, size * (0.01 + (slope * angle) ** 2 / (pi * 0.9 * 2.0))
        # a positive angle turns its leading edge to port, about an axis that points up
        assert wrench(rudder(angle), speed) == pytest.approx([-drag, -lift, 0.0, 0.0, 0.0, lift])


def test_the_angle_of_attack_is_relative_to_the_local_flow() -> None:
    """A drift by 0.1 rad with a rudder turned by as much equals straight motion, all turned by 0.1 rad."""
    straight, drifting = wrench(rudder(0.2), 1.0), wrench(rudder(0.1), cos(0.1), sin(0.1))
    x, y = straight[:2]
    assert drifting[:2] == pytest.approx([x * cos(0.1) - y * sin(0.1), x * sin(0.1) + y * cos(0.1)])
    turning = rudder(0.0).wrench(DEEP, LEVEL, (1.0, 0.0, 0.0, 0.0, 0.0, 0.2))  # the tail goes to port at 0.2 m/s
    assert turning == pytest.approx(wrench(rudder(0.0), 1.0, -0.2))


def test_a_fin_stalls_beyond_its_angle() -> None:
    polar = RUDDER.polar
    before, stalled, after = (polar.at(angle)[0] for angle in (0.29, 0.3, 0.55))
    assert before < stalled == pytest.approx(0.3 * polar.lift_slope)
    assert after == pytest.approx(0.5 * 1.17 * sin(1.1))
    assert after < 0.7 * stalled
    assert polar.at(0.5 * pi) == pytest.approx((0.0, 0.01 + 1.17), abs=1e-12)
    angles = [0.001 * k for k in range(-3500, 3501)]
    coefficients = [polar.at(angle) for angle in angles]
    steps = [abs(b - a) for one, two in pairwise(coefficients) for a, b in zip(one, two, strict=True)]
    assert max(steps) < 0.001 * 10.0  # no jump anywhere, nor from ahead to behind
    assert max(lift for lift, _ in coefficients) == pytest.approx(stalled)
    assert min(drag for _, drag in coefficients) >= 0.01


def test_a_rudder_acts_in_reverse_going_astern() -> None:
    ahead, astern = wrench(rudder(0.2), 1.0), wrench(rudder(0.2), -1.0)
    assert astern == pytest.approx([-x for x in ahead])
    assert list(wrench(rudder(0.2))) == [0.0] * 6  # at rest


def test_the_hull_straightens_the_flow_at_a_rudder() -> None:
    behind = RUDDER._replace(straightening=0.0)
    assert wrench(rudder(0.2, behind), 1.0, 0.3) == pytest.approx(wrench(rudder(0.2), 1.0))
    half = RUDDER._replace(straightening=0.5)
    assert wrench(rudder(0.2, half), 1.0, 0.3) == pytest.approx(wrench(rudder(0.2), 1.0, 0.15))


@pytest.mark.parametrize("end", [1.0, -1.0])
def test_the_fin_matrix_is_the_slope_of_the_wrench(end: float) -> None:
    """A chord that points astern turns the other edge into the flow, so the force has the other sign."""
    for name in TORPEDOES:
        vehicle, _ = load_vehicle(name)
        turned = tuple([fin._replace(chord=(end * fin.chord[0], *fin.chord[1:])) for fin in vehicle.fins])
        matrix = fin_matrix(turned, RHO)
        for index in range(len(turned)):
            fins = FinSet(turned, RHO, 0.01)
            zero = list(wrench(fins, 1.5))
            fins.angles[index] = 1e-5
            slope = [(a - b) / 1e-5 / 1.5**2 for a, b in zip(wrench(fins, 1.5), zero, strict=True)]
            column = [row[index] for row in matrix]
            assert slope[1:] == pytest.approx(column[1:], rel=0.02, abs=0.02 * max(map(abs, column)))


# -- energy -------------------------------------------------------------------------------------------------------


def forces() -> list[Callable[[Random], Force]]:
    lift = Lift(0.2, aspect_ratio=0.2, parasitic_drag=0.05, position=(-0.3, 0.1, 0.02))

    def fin(random: Random) -> Force:
        axis = random.gauss(0.0, 1.0), random.gauss(0.0, 1.0), random.gauss(0.0, 1.0)
        place = random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0)
        return rudder(random.uniform(-0.5, 0.5), RUDDER._replace(axis=axis, position=place))

    return [
        fin,
        lambda _: HullLift(lift, RHO),
        lambda _: HullLift(lift._replace(plane="vertical", position=(0.0, 0.0, 0.0)), RHO),
        lambda _: CrossFlowDrag(CrossFlow((1.1, 0.3), (0.1, 1.0)), (1.6, 0.2, 0.2), RHO),
        lambda _: SpeedDamping((8.0, 162.0, 108.0, 13.0, 20.0, 32.0)),
    ]


@pytest.mark.parametrize("make", forces(), ids=["fin", "hull", "hull in a plane", "cross flow", "damping"])
def test_no_surface_adds_energy(make: Callable[[Random], Force]) -> None:
    """The power of force and moment is never above zero in still water, for flows from everywhere."""
    random = Random(5)
    for _ in range(2000):
        scale = 10.0 ** random.uniform(-6.0, 1.0)
        nu = [scale * random.gauss(0.0, 1.0) for _ in range(6)]
        actual = make(random).wrench(DEEP, LEVEL, nu)
        power = sum(a * b for a, b in zip(actual, nu, strict=True))
        size = sum(abs(a * b) for a, b in zip(actual, nu, strict=True))
        assert all(map(isfinite, actual))
        assert power <= 1e-12 * size
    assert all(x == 0.0 for x in make(random).wrench(DEEP, LEVEL, (0.0,) * 6))


@pytest.mark.parametrize("name", TORPEDOES)
def test_a_vehicle_without_thrust_comes_to_rest(name: str) -> None:
    """The kinetic energy of a vehicle thrown with its fins deflected, ahead or astern, falls all the time."""
    vehicle, _ = load_vehicle(name)
    vehicle = vehicle._replace(neutrally_buoyant=True, center_of_buoyancy=vehicle.center_of_gravity)
    vehicle = vehicle._replace(fins=tuple([fin._replace(straightening=1.0) for fin in vehicle.fins]))
    for speed in (1.5, -1.5):
        simulation = Simulation(vehicle, SEA, dt_ns=5_000_000, position=DEEP)
        simulation.state.nu = [speed, 0.3, -0.2, 0.1, 0.05, -0.1]
        mass = Dynamics(vehicle, RHO, 9.8).mass
        idle = [1500] * len(vehicle.thrusters) + [1700] * len(vehicle.fins)
        idle += [1500] * (len(vehicle.channels) - len(idle))
        before = inf
        for _ in range(1000):
            simulation.step(idle)
            nu = simulation.state.nu
            energy = 0.5 * sum(a * m * b for a, row in zip(nu, mass, strict=True) for m, b in zip(row, nu, strict=True))
            assert energy < before
            before = energy


# -- hull and cross flow ------------------------------------------------------------------------------------------


def test_hull_lift_has_its_value_at_an_angle() -> None:
    lift = Lift(0.2, aspect_ratio=0.2, parasitic_drag=0.05, position=(-0.3, 0.0, 0.0))
    size, slope, angle = 0.5 * RHO * 4.0 * 0.2, lift_slope(0.2), 0.1
    up, drag = size * slope * angle, size * (0.05 + (slope * angle) ** 2 / (pi * 0.3 * 0.2))
    axial, lateral = -drag * cos(angle) + up * sin(angle), -drag * sin(angle) - up * cos(angle)
    u, across = 2.0 * cos(angle), 2.0 * sin(angle)
    actual = wrench(HullLift(lift, RHO), u, 0.0, across)
    assert actual == pytest.approx([axial, 0.0, lateral, 0.0, 0.3 * lateral, 0.0])
    actual = wrench(HullLift(lift, RHO), u, 0.6 * across, 0.8 * across)  # rolled: a hull is round
    assert actual[:3] == pytest.approx([axial, 0.6 * lateral, 0.8 * lateral])
    flat = HullLift(lift._replace(plane="vertical"), RHO)
    assert wrench(flat, u, across)[1] == 0.0


def test_cross_flow_drag_acts_on_sway_and_yaw() -> None:
    drag = CrossFlowDrag(CrossFlow((1.1,)), (2.0, 0.2, 0.3), RHO)
    assert wrench(drag, 1.0, 0.4)[1] == pytest.approx(-0.5 * RHO * 1.1 * 2.0 * 0.3 * 0.16)
    assert wrench(drag, 1.0, 0.0, -0.4)[2] == pytest.approx(0.5 * RHO * 1.1 * 2.0 * 0.2 * 0.16)
    assert wrench(drag, 1.0, 0.3, 0.4)[1] == pytest.approx(-0.5 * RHO * 1.1 * 2.0 * 0.3 * 0.5 * 0.3)  # both at once
    yaw = wrench(drag, 0.0, 0.0, 0.0, 0.0, 0.0, 0.7)
    assert yaw[5] == pytest.approx(-0.5 * RHO * 1.1 * 0.3 * 0.49 * 2.0**4 / 32.0, rel=0.005)
    assert yaw[1] == pytest.approx(0.0, abs=1e-9)


def test_the_cross_flow_coefficient_depends_on_speed() -> None:
    drag = CrossFlowDrag(CrossFlow((1.0, 0.4), (0.2, 0.4)), (2.0, 0.2, 0.2), RHO)
    for speed, coefficient in ((0.1, 1.0), (0.3, 0.7), (0.9, 0.4)):
        assert wrench(drag, 0.0, speed)[1] == pytest.approx(-0.5 * RHO * coefficient * 0.4 * speed * speed)


# -- servos -------------------------------------------------------------------------------------------------------


def test_pulses_and_deflections_convert_both_ways() -> None:
    fin = RUDDER._replace(pwm_min_us=1200, max_deflection=0.4)
    assert [deflection(fin, us) for us in (1100, 1200, 1350, 1500, 1501, 1700, 1900, 2100)] == pytest.approx(
        [-0.4, -0.4, -0.2, 0.0, 0.001, 0.2, 0.4, 0.4]
    )
    assert [pulse(fin, angle) for angle in (-1.0, -0.2, 0.0, 0.2, 1.0)] == [1200, 1350, 1500, 1700, 1900]


def test_a_servo_follows_with_its_lag() -> None:
    fins = FinSet([RUDDER._replace(time_constant=0.1)], RHO, 0.01)
    for _ in range(10):
        fins.step([1900])
    assert fins.angles[0] == pytest.approx(0.5 * (1.0 - exp(-1.0)))
    fins = FinSet([RUDDER._replace(time_constant=0.0, rate=0.5)], RHO, 0.01)
    fins.step([1100])
    fins.step([1100])
    assert fins.angles[0] == pytest.approx(-0.01)


# -- in the simulation --------------------------------------------------------------------------------------------


def test_a_step_needs_one_pulse_a_channel() -> None:
    vehicle, _ = load_vehicle("tethys")
    assert vehicle.channels == ("propeller", "rudder", "elevator", "buoyancy engine", "drop weight")
    simulation = Simulation(vehicle, SEA, position=DEEP)
    with pytest.raises(ConfigError, match="1 pulses for a vehicle of 5 channels"):
        simulation.step([1500])


def test_propeller_torque_rolls_the_vehicle() -> None:
    vehicle, _ = load_vehicle("lauv")
    (thruster,) = vehicle.thrusters
    twisting = vehicle._replace(thrusters=(thruster._replace(torque=0.02, time_constant=0.0),))
    assert ThrusterSet(twisting, 0.01).step([1900]) == pytest.approx((15.0, 0.0, 0.0, 0.3, 0.0, 0.0))


WRONG = [
    ("axis = [0, 1, 0]", "axis = [2, 0, 0]", "fin 'stern planes': axis and chord must be directions across"),
    ("axis = [0, 1, 0]", "axis = [0, 1e-160, 0]", "fin 'stern planes': axis and chord must be directions across"),
    ('name = "stern planes"', 'name = "rudder"', "two channels have the same name"),
    ("induced_drag = 2.0", "", "fin 'rudder': give aspect_ratio, or lift_slope and induced_drag"),
    ("speed = [0.0064,", "speed = [0.01, 0.0064,", "cross_flow: speed: each must be greater"),
    ("drag = [0.798,", "drag = [", "drag: expected 19 values, one for each speed, found 18"),
]


@pytest.mark.parametrize(("right", "wrong", "message"), WRONG)
def test_mistakes_are_reported(right: str, wrong: str, message: str, tmp_path: Path) -> None:
    text = (Path(__file__).parents[4] / "sim/vehicles/remus100.toml").read_text()
    assert right in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(right, wrong, 1))
    with pytest.raises(ConfigError, match=r"mine\.toml") as caught:
        load_vehicle(str(path))
    assert message in str(caught.value)


def test_a_vehicle_has_at_most_16_channels(tmp_path: Path) -> None:
    text = (Path(__file__).parents[4] / "sim/vehicles/tethys.toml").read_text()
    weight = '[[drop_weights]]\nname = "w{}"\nmass = 0.1\nposition = [0.0, 0.0, 0.0]\n'
    for count, is_valid in ((11, True), (12, False)):
        path = tmp_path / f"{count}.toml"
        path.write_text(text + "".join(weight.format(i) for i in range(count)))
        if is_valid:
            assert len(load_vehicle(str(path))[0].channels) == 16
        else:
            with pytest.raises(ConfigError, match="an STM32 has 16 outputs, found 17"):
                load_vehicle(str(path))
