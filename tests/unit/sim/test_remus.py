"""The REMUS 100 against the model its numbers come from (MSS, remus100.m), term by term and in manoeuvres.

Our class of models has all of that model but five terms, which `theirs` writes out as they are there. With these in
place of ours everything else agrees to the last digits of the reference; with ours the manoeuvres do to the figures
stated in each test.
"""

import csv
from itertools import pairwise
from math import cos, exp, log, pi, radians, sin, sqrt
from pathlib import Path

import pytest

from sim import rotations
from sim.dynamics import Dynamics, State
from sim.environment.world import World, load_world
from sim.rotations import from_euler, rotate, to_euler
from sim.simulation import Simulation
from sim.vehicle.body_lift import CrossFlowDrag, FadingDamping, HullLift, SlowDamping
from sim.vehicle.fins import FinSet
from sim.vehicle.servos import pulse
from sim.vehicle.thrusters.curves import Advance
from sim.vehicle.vehicle import Vehicle, load_vehicle, mass_matrix

VECTORS = Path(__file__).parents[2] / "vectors"
REMUS, _ = load_vehicle("remus100")
LATITUDE = radians(63.446827)
GRAVITY = 9.7803253359 * (1 + 0.0019318504 * sin(LATITUDE) ** 2) / sqrt(1 - 0.006694384442 * sin(LATITUDE) ** 2)
SEA = load_world("pool")._replace(walls=False, depth=1e4, density=1026.0, gravity=GRAVITY)
TAIL = 1.0096 * 0.8
# Degrees of freedom: X Y Z K M N.
Six = list[float]


def rows_of(name: str) -> list[dict[str, float]]:
    with (VECTORS / f"mss_remus100_{name}.csv").open() as file:
        lines = [line for line in file if not line.startswith("#")]
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(lines)]


def add(*wrenches: Six) -> Six:
    return [sum(column) for column in zip(*wrenches, strict=True)]


# -- the five terms of theirs -----------------------------------------------------------------------------------------


def their_propeller(n: float, nu: Six) -> Six:
    """Return their propeller's force, by the speed over ground, also sideways; its torque is a tenth of KQ's."""
    advance = 0.944 * sqrt(nu[0] ** 2 + nu[1] ** 2 + nu[2] ** 2)
    thrust = 1026 * 0.14**4 * (0.4566 * n * n + (0.1798 - 0.4566) / 0.6632 * advance / 0.14 * n)
    torque = 1026 * 0.14**5 * (0.07 * n * n + (0.0312 - 0.07) / 0.6632 * advance / 0.14 * n)
    return [0.9 * thrust, 0.0, 0.0, torque / 10.0, 0.0, 0.0]


def their_fins(rudder: float, planes: float, nu_r: Six) -> Six:
    """Return their fins' forces, by the speed in the horizontal plane or the vertical one."""
    u, v, w, *_ = nu_r
    flat, steep = 0.5 * 1026 * 0.0133 * 0.5 * (u * u + v * v), 0.5 * 1026 * 0.0133 * 0.7 * (u * u + w * w)
    y, z = -flat * rudder, -steep * planes
    return [-flat * rudder**2 - steep * planes**2, y, z, 0.0, TAIL * z, -TAIL * y]


DNV = [(10211.0405297256, 1.20769), (15543.5423211490, 1.20369), (24434.8681540938, 1.20823),
       (35719.8807222993, 1.21060), (60880.7508493947, 1.21093), (86174.7436190610, 1.20901),
       (118086.431856986, 1.21134), (149262.255516420, 1.21148), (214708.876786124, 1.21171),
       (230940.445891927, 1.20109), (271581.385758833, 1.16918), (297098.185911873, 1.11163),
       (325252.018159382, 1.00926), (361942.848517458, 0.89411), (409798.156149477, 0.70855),
       (475302.392082697, 0.53155), (524734.960427919, 0.40785), (578921.928291835, 0.32683),
       (638292.879987135, 0.28422), (744046.366191920, 0.29711), (853237.628592033, 0.32280),
       (1068685.70450627, 0.38909), (1393381.37138896, 0.47033)]  # fmt: skip


def their_cross_flow(nu_r: Six) -> Six:
    """Return their cross-flow drag of 21 strips, a twentieth of the length each; Reynolds' number is by the length."""
    _, v, w, _, q, r = nu_r
    reynolds = sqrt(v * v + w * w) * 1.6 * 1e6
    drag = DNV[0][1]
    for (low, before), (high, after) in pairwise(DNV):
        if low <= reynolds < high:
            drag = before + (reynolds - low) / (high - low) * (after - before)
    ratio = 1.6 / 0.19
    drag *= 0.62 + (ratio - 5) / 5 * 0.06 if reynolds < 2e5 else 0.8 + (ratio - 5) / 5 * 0.02
    total = [0.0] * 6
    for i in range(21):
        x = -0.8 + i * 0.08
        size = 0.5 * 1025 * 0.19 * drag * 0.08
        aside, down = abs(v + x * r) * (v + x * r), abs(w + x * q) * (w + x * q)
        total = add(total, [0.0, -size * aside, -size * down, 0.0, -size * x * down, -size * x * aside])
    return total


def their_surge_damping(nu: Six, nu_r: Six) -> Six:
    """Return their damping of surge: it fades with the root of what they call speed over ground, u, not u²."""
    return [-32.76381711084337 / 20 * exp(-3 * sqrt(nu[0] + nu[1] ** 2)) * nu_r[0], 0.0, 0.0, 0.0, 0.0, 0.0]


# -- derivatives ------------------------------------------------------------------------------------------------------


class Sample:
    """One row of the reference."""

    def __init__(self, row: dict[str, float]) -> None:
        self.nu = [row[key] for key in "uvwpqr"]
        self.slope = [row[f"d{key}"] for key in "uvwpqr"]
        self.quaternion = from_euler(row["phi"], row["theta"], row["psi"])
        self.rotation = rotations.matrix(self.quaternion)
        self.rudder, self.planes, self.n = row["delta_r"], row["delta_s"], row["n_rpm"] / 60.0
        # Their current is along the body axes but for yaw: as if the vehicle were level.
        angle = row["betaVc"] - row["psi"]
        self.flow = [row["Vc"] * cos(angle), row["Vc"] * sin(angle), row["wc"]]
        self.current = rotate(self.quaternion, self.flow)
        self.nu_r = [a - b for a, b in zip(self.nu, [*self.flow, 0.0, 0.0, 0.0], strict=True)]

    def slope_of(self, dynamics: Dynamics, wrench: Six) -> Six:
        """Return our derivative with their rate of the current, which omits the effect of roll and pitch on it."""
        place = (0.0, 0.0, 100.0)
        pushed = dynamics.add_forces(place, self.rotation, self.nu, wrench, self.current)
        acceleration = dynamics.acceleration(100.0, self.rotation, self.nu, pushed, self.current)
        p, q, _ = self.nu[3:]
        x, y, z = self.flow
        return add(acceleration, [q * z, -p * z, p * y - q * x, 0.0, 0.0, 0.0])


SAMPLES = [Sample(row) for row in rows_of("xdot_samples")]


def hull_of(vehicle: Vehicle) -> HullLift:
    assert vehicle.lift
    return HullLift(vehicle.lift, 1026.0)


def test_the_mass_matrix_equals_mss() -> None:
    with (VECTORS / "mss_remus100_M.csv").open() as file:
        theirs = [[float(x) for x in line.split(",")] for line in file if not line.startswith("#")]
    for row, expected in zip(mass_matrix(REMUS), theirs, strict=True):
        assert row == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_the_numbers_of_the_vehicle_file_follow_from_the_spheroid() -> None:
    a, b = 1.0096 * 0.8, 1.0096 * 0.095
    mass, displaced = (4 / 3 * pi * density * a * b * b for density in (1025, 1026))
    e = sqrt(1 - (b / a) ** 2)
    turn = log((1 + e) / (1 - e))
    alpha, beta = 2 * (1 - e * e) / e**3 * (0.5 * turn - e), 1 / e**2 - (1 - e * e) / (2 * e**3) * turn
    k1, k2 = alpha / (2 - alpha), beta / (2 - beta)
    k3 = e**4 * (beta - alpha) / ((2 - e * e) * (2 * e * e - (2 - e * e) * (beta - alpha)))
    roll, pitch = 0.4 * b * b, 0.2 * (a * a + b * b)
    assert REMUS.mass == pytest.approx(mass, rel=1e-12)
    assert REMUS.inertia == pytest.approx([mass * roll, mass * pitch, mass * pitch], rel=1e-12)
    added = [k1, k2, k2, 0.3 * roll, k3 * pitch, k3 * pitch]
    assert REMUS.added_mass == pytest.approx([displaced * k for k in added], rel=1e-12)
    M = mass_matrix(REMUS)
    stiffness = mass * GRAVITY * 0.02
    damping = [
        0.0,
        M[1][1] / 20,
        M[2][2] / 20,
        0.6 * sqrt(stiffness * M[3][3]),
        1.6 * sqrt(stiffness * M[4][4]),
        M[5][5],
    ]
    assert REMUS.linear_damping == pytest.approx(damping, rel=1e-9)
    assert REMUS.fading_damping
    assert REMUS.fading_damping.damping == pytest.approx([M[0][0] / 20, *[0.0] * 5], rel=1e-9)
    assert REMUS.lift
    assert REMUS.lift.parasitic_drag * REMUS.lift.area == pytest.approx(0.42 * pi * b * b, rel=1e-12)


def our_propeller(n: float, nu_r: Six) -> Six:
    (thruster,) = REMUS.thrusters
    assert isinstance(thruster.curve, Advance)
    x = n / thruster.curve.full_speed
    static = thruster.curve.full_thrust(reverse=False) * x * x
    thrust = static - thruster.curve.loss(static, nu_r[0])
    return [thrust, 0.0, 0.0, thruster.torque * thrust, 0.0, 0.0]


def test_each_common_term_equals_mss() -> None:
    """The terms are compared for motion straight ahead in water at rest."""
    fins = FinSet(REMUS.fins, 1026.0, 0.01)
    for speed in (0.3, 1.0, 2.5):
        ahead = [speed, 0.0, 0.0, 0.0, 0.0, 0.0]
        for rudder, planes in ((0.349, 0.0), (-0.1, 0.2), (0.0, -0.349)):
            fins.servos.values = [rudder, planes]
            computed = list(fins.wrench((0.0, 0.0, 9.0), SAMPLES[0].rotation, ahead))
            assert computed == pytest.approx(their_fins(rudder, planes, ahead), rel=1e-12, abs=1e-12)
        for n in (10.0, 25.0):
            computed, theirs = our_propeller(n, ahead), their_propeller(n, ahead)
            assert computed[0] == pytest.approx(theirs[0], rel=1e-12)
            if speed < 0.5 * n * 0.14:
                assert computed[3] == pytest.approx(theirs[3], rel=0.1)
    assert REMUS.cross_flow
    drag = CrossFlowDrag(REMUS.cross_flow, REMUS.dimensions, 1026.0)
    for v, r in ((0.05, 0.0), (0.1, 0.2), (0.21, -0.3), (0.0, 0.3)):
        for axis, nu in ((1, [1.5, v, 0.0, 0.0, 0.0, r]), (2, [1.5, 0.0, v, 0.0, -r, 0.0])):
            computed = list(drag.wrench((0.0, 0.0, 9.0), SAMPLES[0].rotation, nu))
            assert computed == pytest.approx(their_cross_flow(nu), rel=0.02, abs=0.01)
            assert abs(computed[axis]) >= 0.0


# -- manoeuvres -------------------------------------------------------------------------------------------------------


def instant(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle without lags, as their inputs are."""
    thrusters = tuple([thruster._replace(time_constant=0.0) for thruster in vehicle.thrusters])
    return vehicle._replace(thrusters=thrusters, fins=tuple([fin._replace(time_constant=0.0) for fin in vehicle.fins]))


class Run:
    """Our REMUS under the inputs of a trajectory of theirs."""

    def __init__(self, rpm: float, speed: float, world: World = SEA) -> None:
        self.simulation = Simulation(instant(REMUS), world, {}, dt_ns=20_000_000, position=(0.0, 0.0, 50.0))
        self.simulation.state.nu = [speed, 0.0, 0.0, 0.0, 0.0, 0.0]
        self._propeller = REMUS.thrusters[0].pulse_at(rpm / 1525.0)

    def step(self, seconds: float, rudder: float = 0.0, planes: float = 0.0) -> None:
        angles = [pulse(fin, radians(angle)) for fin, angle in zip(REMUS.fins, (rudder, planes), strict=True)]
        for _ in range(round(seconds / 0.02)):
            self.simulation.step([self._propeller, *angles])

    @property
    def nu(self) -> Six:
        return list(self.simulation.state.nu)

    @property
    def position(self) -> Six:
        return list(self.simulation.state.position)

    @property
    def euler(self) -> tuple[float, float, float]:
        return to_euler(self.simulation.state.quaternion)


def their_coast(speed: float, seconds: float) -> tuple[float, float]:
    """Return the distance (m) theirs coasts from `speed` m/s, straight ahead, and its last speed (m/s)."""
    dynamics = Dynamics(REMUS, 1026.0, GRAVITY, forces=[hull_of(REMUS)])
    distance, dt = 0.0, 0.01

    def slope(u: float) -> float:
        nu = [u, 0.0, 0.0, 0.0, 0.0, 0.0]
        pushes = dynamics.forces(State((0.0, 0.0, 50.0), nu=nu), their_surge_damping(nu, nu), (0.0,) * 3)
        return pushes.total[0] / dynamics.mass[0][0]

    for _ in range(round(seconds / dt)):
        middle = speed + 0.5 * dt * slope(speed)
        distance += dt * middle
        speed += dt * slope(middle)
    return distance, speed


@pytest.mark.parametrize("start", [0.5, 1.5, 2.5])
def test_coasting_follows_mss(start: float) -> None:
    """The distance and speed over 60 s with the propeller stopped equal theirs. Without the damping of slow motion it
    would move 9.5 to 21 % farther; the reference's own terms are tested by the derivatives above.
    """
    run = Run(0.0, start)
    run.step(60.0)
    way, speed = their_coast(start, 60.0)
    assert run.position[0] == pytest.approx(way, rel=1e-3)
    assert run.nu[0] == pytest.approx(speed, rel=5e-3)


def test_damping_of_slow_motion_depends_on_the_speed_through_water() -> None:
    """Six numbers of its own damp a vehicle less the faster it is, astern as ahead, and never give energy."""
    fading = FadingDamping((2.0, 4.0, 6.0, 1.0, 2.0, 3.0), rate=3.0)
    still = SlowDamping(fading).wrench((0.0, 0.0, 9.0), SAMPLES[0].rotation, [0.0, 0.0, 0.0, 0.5, -0.5, 1.0])
    assert list(still) == pytest.approx([0.0, 0.0, 0.0, -0.5, 1.0, -3.0])
    for nu in ([0.3, 0.0, 0.4, 0.1, 0.0, 0.0], [-0.3, 0.4, 0.0, 0.0, 0.2, 0.1]):
        found = SlowDamping(fading).wrench((0.0, 0.0, 9.0), SAMPLES[0].rotation, nu)
        assert list(found) == pytest.approx([-exp(-1.5) * d * x for d, x in zip(fading.damping, nu, strict=True)])
        assert sum(a * b for a, b in zip(found, nu, strict=True)) < 0.0
