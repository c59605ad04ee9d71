"""Buoyancy engine, drop weights, layers of density and waves at the surface."""

from math import sqrt
from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from hil.scenario.config import build_simulation, load_scenario
from sim.environment.ocean import Ocean, Profile, Waves
from sim.environment.world import World, load_world
from sim.rotations import to_euler
from sim.simulation import Simulation
from sim.vehicle.ballast import BuoyancyEngine, DropWeight, Release, is_release
from sim.vehicle.vehicle import Vehicle, load_vehicle, mass_matrix, validate_drop_weights, without_weight

TETHYS, _ = load_vehicle("tethys")
BARE = TETHYS._replace(buoyancy_engine=None, drop_weights=(), fins=())
SEA = load_world("pool")._replace(walls=False, depth=1e3, density=1025.0, gravity=9.8)
ENGINE = BuoyancyEngine((0.0, 0.0, 0.0), 80e-6, 500e-6, 955e-6, 3e-6)
WEIGHT = DropWeight("keel", 2.0, (0.3, 0.1, 0.12), 2e-4)


def at_sea(vehicle: Vehicle, depth: float, world: World = SEA, releases: tuple[Release, ...] = ()) -> Simulation:
    return Simulation(vehicle, world, {}, 1, 10_000_000, (0.0, 0.0, depth), releases=releases)


def idle(vehicle: Vehicle, **pulses: int) -> list[int]:
    return [pulses.get(name.replace(" ", "_"), 1500) for name in vehicle.channels]


# -- the engine ---------------------------------------------------------------------------------------------------


def test_a_buoyancy_engine_pumps_at_its_rate_between_its_limits() -> None:
    vehicle = BARE._replace(buoyancy_engine=ENGINE._replace(rate=30e-6))
    simulation = at_sea(vehicle, 200.0)
    assert simulation.equipment
    bladder = simulation.equipment.bladder
    assert bladder
    for pulse, seconds, volume in (
        (1900, 1.0, 530e-6),
        (0, 1.0, 530e-6),  # no pulse: it stays
        (2100, 15.0, 955e-6),
        (1100, 5.0, 805e-6),
        (1700, 5.0, 727.5e-6),  # half way from neutral to the maximum
        (1300, 16.0, 290e-6),
        (900, 8.0, 80e-6),
    ):
        for _ in range(round(seconds * 100)):
            simulation.step(idle(vehicle, buoyancy_engine=pulse))
        assert bladder.volume == pytest.approx(volume, rel=1e-9)


def test_a_buoyancy_engine_off_the_middle_pitches_the_vehicle() -> None:
    vehicle = BARE._replace(
        buoyancy_engine=ENGINE._replace(position=(0.2, 0.0, 0.0), rate=1.0),
        linear_damping=(50.0, 0.0, 200.0, 5.0, 50.0, 50.0),
    )
    simulation = at_sea(vehicle, 500.0)
    for _ in range(20_000):
        simulation.step(idle(vehicle, buoyancy_engine=1900))
    stiffness = TETHYS.mass * 9.8 * 0.007
    assert to_euler(simulation.state.quaternion)[1] == pytest.approx(
        0.2 * 1025.0 * 9.8 * 455e-6 / stiffness, rel=0.1
    )  # bow up


# -- weights ------------------------------------------------------------------------------------------------------


def test_only_a_pulse_above_1700_us_releases_a_weight() -> None:
    assert [is_release(pulse) for pulse in (0, 1500, 1700, 1701, 1900, 2200, 2201)] == [0, 0, 0, 1, 1, 1, 0]


def test_the_remaining_vehicle_has_the_remaining_mass_properties() -> None:
    """Two point masses on a stick, one of them dropped, leave the other, about itself."""
    one, other = DropWeight("one", 2.0, (0.4, 0.0, 0.0), 1e-3), (-0.4, 0.0, 0.0)
    pair = BARE._replace(
        mass=4.0, center_of_gravity=(0.0, 0.0, 0.0), volume=5e-3, neutrally_buoyant=False,
        inertia=(1e-3, 4.0 * 0.16 + 1e-3, 4.0 * 0.16 + 1e-3), drop_weights=(one,),
    )  # fmt: skip
    left = without_weight(pair, one, 1000.0)
    assert (left.mass, left.volume) == pytest.approx((2.0, 4e-3))
    assert left.center_of_gravity == pytest.approx(other)
    assert [left.inertia[i] for i in (0, 4, 8)] == pytest.approx([1e-3] * 3)
    assert left.center_of_buoyancy[0] == pytest.approx(-0.1)


def test_the_order_of_releases_does_not_matter() -> None:
    other = DropWeight("nose", 1.0, (0.9, 0.0, 0.0), 1e-4)
    one = without_weight(without_weight(TETHYS, WEIGHT, 1025.0), other, 1025.0)
    two = without_weight(without_weight(TETHYS, other, 1025.0), WEIGHT, 1025.0)
    for key in ("mass", "volume", "inertia", "center_of_gravity", "center_of_buoyancy"):
        assert getattr(one, key) == pytest.approx(getattr(two, key), abs=1e-12)


def test_a_release_keeps_the_velocity_and_removes_its_momentum() -> None:
    """The momentum before is that of the remaining vehicle and of the weight, which moves on unchanged."""
    vehicle = TETHYS._replace(drop_weights=(WEIGHT,), volume=TETHYS.mass / 1025.0)
    simulation = at_sea(vehicle, 50.0)
    simulation.state.nu = nu = [1.0, 0.2, -0.1, 0.1, 0.05, -0.2]
    before = [sum(a * b for a, b in zip(row, nu, strict=True)) for row in mass_matrix(vehicle)]
    simulation.release("keel")
    assert list(simulation.state.nu) == nu
    left = [sum(a * b for a, b in zip(row, nu, strict=True)) for row in mass_matrix(simulation.vehicle)]
    (x, y, z), (u, v, w, p, q, r) = WEIGHT.position, nu
    own = [2.0 * s for s in (u + q * z - r * y, v + r * x - p * z, w + p * y - q * x)]
    own += [y * own[2] - z * own[1], z * own[0] - x * own[2], x * own[1] - y * own[0]]
    assert [a + b for a, b in zip(left, own, strict=True)] == pytest.approx(before)


def test_a_vehicle_rises_after_release_as_its_remaining_mass_allows() -> None:
    vehicle = BARE._replace(drop_weights=(WEIGHT._replace(position=(0.0, 0.0, 0.0), volume=0.0),))
    simulation = at_sea(vehicle, 50.0)
    simulation.step(idle(vehicle))
    assert simulation.state.nu_dot[2] == pytest.approx(0.0, abs=1e-9)
    simulation.step(idle(vehicle, keel=1701))
    expected = -2.0 * 9.8 / (TETHYS.mass - 2.0 + TETHYS.added_mass[2])
    assert simulation.state.nu_dot[2] == pytest.approx(expected, rel=1e-6)
    assert simulation.vehicle.mass == TETHYS.mass - 2.0
    assert simulation.vehicle.channels == vehicle.channels
    simulation.step(idle(vehicle, keel=1900))  # it has been released: nothing more happens
    assert simulation.vehicle.mass == TETHYS.mass - 2.0
    for _ in range(9000):
        simulation.step(idle(vehicle))
    assert simulation.state.position[2] < 45.0
    assert simulation.state.nu[2] == pytest.approx(-sqrt(2.0 * 9.8 / 601.27), rel=0.01)


def test_a_collision_after_release_uses_the_remaining_mass() -> None:
    offloaded = TETHYS._replace(drop_weights=(DropWeight("half", 70.0, (0.0, 0.0, 0.0), 0.0),))
    dropped, light = at_sea(offloaded, 5.0), at_sea(without_weight(offloaded, offloaded.drop_weights[0], 1025.0), 5.0)
    dropped.release("half")
    for simulation in (dropped, light):
        simulation.state.position, simulation.state.nu = [0.0, 0.0, SEA.depth - 0.1], [0.2, 0.0, 1.0, 0.0, 0.1, 0.0]
        simulation.step(idle(offloaded))
        assert simulation.touching
    assert dropped.state.nu == light.state.nu


def test_releases_are_scheduled_by_name_and_validated(tmp_path: Path) -> None:
    simulation = at_sea(TETHYS, 50.0, releases=(Release("drop weight", 1.0),))
    for _ in range(100):
        simulation.step(idle(TETHYS))
        assert simulation.vehicle.mass == TETHYS.mass
    simulation.step(idle(TETHYS))
    assert simulation.vehicle.mass == TETHYS.mass - 1.0
    with pytest.raises(ConfigError, match="'drop weight' has been dropped already"):
        simulation.release("drop weight")
    with pytest.raises(ConfigError, match="no drop weight 'keel'; there are: drop weight"):
        simulation.release("keel")
    with pytest.raises(ConfigError, match="no drop weight 'keel'; there are: none"):
        at_sea(load_vehicle("paper_six")[0], 50.0, releases=(Release("keel"),))
    with pytest.raises(ConfigError, match="paper_six has no drop weight 'keel'"):
        at_sea(load_vehicle("paper_six")[0], 50.0).release("keel")
    path = tmp_path / "mine.toml"
    path.write_text(
        'vehicle = "tethys"\nworld = "open_water"\n[master]\ngoal = [1.0, 1.0]\n[start]\ndepth = 5.0\n'
        '[[release]]\nname = "drop weight"\ntime = "0.5 s"\n'
    )
    scenario = load_scenario(str(path))
    assert scenario.release == (Release("drop weight", 0.5),)
    flown = build_simulation(scenario, TETHYS, load_world(scenario.world))
    for _ in range(201):
        flown.step(idle(TETHYS))
    assert flown.vehicle.mass == TETHYS.mass - 1.0


def test_a_drop_weight_must_be_a_part_of_the_vehicle() -> None:
    for whole in (WEIGHT._replace(mass=TETHYS.mass), WEIGHT._replace(volume=TETHYS.volume)):
        offloaded = TETHYS._replace(drop_weights=(whole,))
        assert "'keel' is more than the vehicle" in str(validate_drop_weights(offloaded))
    far = TETHYS._replace(drop_weights=(WEIGHT._replace(mass=50.0, position=(5.0, 0.0, 0.0)),))
    assert "'keel' leaves an inertia that is not positive definite" in str(validate_drop_weights(far))


# -- layers and waves ---------------------------------------------------------------------------------------------


def test_a_vehicle_rests_at_the_density_that_it_is_trimmed_for() -> None:
    world = SEA._replace(ocean=Ocean(profile=Profile((0.0, 20.0), (1020.0, 1030.0))))
    vehicle = BARE._replace(linear_damping=(10.0, 10.0, 20.0, 5.0, 30.0, 30.0))
    for start in (5.0, 14.0):
        simulation = at_sea(vehicle, start, world)
        simulation.step(idle(vehicle))
        others = simulation.forces().others
        share = (1020.0 + 0.5 * (start - 0.007)) / 1025.0 - 1.0  # at the centre of buoyancy
        assert others[2] == pytest.approx(-share * vehicle.mass * 9.8, rel=2e-3)
        for _ in range(20_000):
            simulation.step(idle(vehicle))
        assert simulation.state.position[2] == pytest.approx(10.0, abs=0.05)


def test_a_floating_vehicle_follows_a_long_swell() -> None:
    """A swell of 16 s, 400 m long, lifts a floating vehicle by its own height, and a vehicle under water not."""
    swell = Waves(significant_height=2.0 * sqrt(2.0), peak_period=16.0, components=1, hold=0.0)
    world = SEA._replace(ocean=Ocean(waves=swell))
    vehicle = BARE._replace(
        mass=0.8 * BARE.mass, volume=BARE.mass / 1025.0, neutrally_buoyant=False,
        center_of_buoyancy=(0.0, 0.0, -0.05), linear_damping=(50.0, 50.0, 400.0, 20.0, 100.0, 100.0),
    )  # fmt: skip
    simulation = at_sea(vehicle, 0.0, world)
    wave_field, afloat = simulation.wave_field, 0.305 * 0.3
    assert wave_field
    furthest = highest = 0.0
    for step in range(10_000):
        simulation.step(idle(vehicle))
        north, east, down = simulation.state.position
        elevation = wave_field.elevation(simulation.time_ns * 1e-9, north, east)
        if step > 4000:
            highest = max(highest, elevation)
            furthest = max(furthest, abs(-down - elevation + afloat))
    assert highest == pytest.approx(1.0, rel=0.01)
    assert furthest < 0.1
    deep = at_sea(BARE._replace(lift=None), 40.0, world)
    deep.step(idle(BARE))
    assert deep.forces().others == pytest.approx([0.0] * 6, abs=0.05), "only the water turns a little along the hull"
