"""Numbers that are not finite: refused as input, and a diverged state ends the run with the time and the cause."""

import re
from collections.abc import Iterator, Sequence
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

import pytest

from hil.common.errors import ConfigError, DivergenceError
from hil.common.schema import find_preset
from hil.common.tables import read_table
from hil.scenario.variant import write_toml
from sim.dynamics import Dynamics, State
from sim.environment.world import load_world
from sim.native import NativeDynamics
from sim.rotations import Rotation
from sim.simulation import Simulation
from sim.vehicle.vehicle import Vehicle, load_vehicle
from tests.support.flights.twins import taken_from
from tests.support.processes import Program, write_scenario

SIX, _ = load_vehicle("paper_six")
POOL = load_world("pool")
PLACE, NEUTRAL = (4.0, 4.0, 2.0), [1500] * 6
STILL, NOTHING = (0.0, 0.0, 0.0), (0.0,) * 6
BROKEN = """
class Broken:
    def begin(self, time_ns):
        self.time_ns = time_ns
    def wrench(self, position, rotation, nu_r):
        return (float("nan") if self.time_ns >= 250_000_000 else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""


@pytest.fixture(params=["python", "C"])
def twin(request: pytest.FixtureRequest, binaries: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Use each of the two steps in turn."""
    if request.param == "python":
        monkeypatch.setenv("UUV_HIL_NATIVE", "0")
        yield
        return
    with taken_from(binaries):
        yield


class BrokenForce:
    """A force that is not finite from `since` ns on."""

    def __init__(self, since: int, value: float = nan) -> None:
        self._since, self._value = since, value
        self._now = 0

    def begin(self, time_ns: int) -> None:
        self._now = time_ns

    def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Sequence[float]:
        return (0.0, 0.0, self._value if self._now >= self._since else 0.0, 0.0, 0.0, 0.0)


def fly(simulation: Simulation, steps: int = 2000) -> str:
    """Step until the simulation diverges; return exit code and error. The state remains the last finite one."""
    try:
        for _ in range(steps):
            simulation.step(NEUTRAL)
    except DivergenceError as error:
        return f"{error.exit_code}: {error}"
    pytest.fail("it flew on")


# -- at the start -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"dt_ns": 0}, "dt_ns = 0"), ({"dt_ns": -2_500_000}, "dt_ns = -2500000"),
        ({"dt_ns": 2.5e6}, "dt_ns = 2500000.0: a step takes whole ns"),
        ({"position": (4.0, 2.0)}, "position: 2 numbers: give three"),
        ({"world": POOL._replace(current=(0.0, 0.1))}, "current of pool: 2 numbers"),  # type: ignore[arg-type]
        ({"vehicle": SIX._replace(mass=-1.0)}, "paper_six: mass, volume and dimensions must be above 0"),
        ({"vehicle": SIX._replace(munk_share=(2.0, 0.0, 0.0))}, "paper_six: munk_share"),
        ({"vehicle": SIX._replace(capsize_tilt=nan)}, "paper_six: capsize_tilt: nan"),
        ({"position": (4.0, nan, 2.0)}, "position: nan"), ({"position": (inf, 4.0, 2.0)}, "position: inf"),
        ({"heading": nan}, "heading: nan"),
        ({"position": (1e300, 4.0, 2.0)}, "position: 1e+300 is no number to start from: give finite ones, to 1"),
        ({"position": (4.0, "x", 2.0)}, "position: x is no number"), ({"position": 5}, "position: 5"),
        *[({"seed": seed}, f"seed = {seed}: give a whole number") for seed in (-1, 1.5, nan, "abc", None, True)],
        ({"world": POOL._replace(current=(0.0, nan, 0.0))}, "current of pool: nan"),
        ({"world": POOL._replace(density=inf)}, "density of pool: inf"),
        ({"vehicle": SIX._replace(added_mass=(inf, 1.0, 1.0, 0.1, 0.1, 0.1))}, "paper_six: added_mass: inf"),
        ({"vehicle": SIX._replace(linear_damping=(-1.0,) * 6)}, "paper_six: linear_damping is negative"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)  # fmt: skip
def test_a_simulation_refuses_invalid_arguments(arguments: dict[str, Any], message: str) -> None:
    given = {"vehicle": SIX, "world": POOL, "position": PLACE, **arguments}
    with pytest.raises(ConfigError) as caught:
        Simulation(**given)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_the_shortest_and_the_longest_step_are_accepted() -> None:
    for dt_ns in (1_000, 100_000_000):
        assert Simulation(SIX, POOL, {}, dt_ns=dt_ns, position=PLACE).step(NEUTRAL) == []


REMUS = load_vehicle("remus100")[0]  # whose pulses are those of fins, too


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize("vehicle", [SIX, REMUS], ids=["six", "remus"])
@pytest.mark.parametrize("may_fail", [False, True], ids=["sound", "failing"])
@pytest.mark.parametrize("pulse", [nan, inf, "x", None])
def test_a_pulse_that_is_no_number_is_refused(vehicle: Vehicle, pulse: Any, may_fail: bool) -> None:
    for channel in range(len(vehicle.channels)):
        simulation = Simulation(vehicle, load_world("open_water"), {}, position=(0.0, 0.0, 3.0))
        if may_fail:
            simulation.fail()
        pulses: list[Any] = [1500] * len(vehicle.channels)
        simulation.step(pulses)
        pulses[channel] = pulse
        with pytest.raises(ConfigError, match=rf"pulse {channel} is {pulse}: give microseconds"):
            simulation.step(pulses)


# -- in a step --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Dynamics, NativeDynamics])
def test_a_step_with_nan_leaves_the_state_unchanged(kind: type[Dynamics], binaries: Path) -> None:
    with taken_from(binaries):
        dynamics = kind(SIX, 1025.0, 9.8)
        for wrench, current in (((0.0, nan, 0.0, 0.0, 0.0, 0.0), STILL), (NOTHING, (0.0, 0.0, inf))):
            state = State(PLACE, nu=(0.5, 0.0, 0.1, 0.0, 0.0, 0.2))
            before = [*state.position, *state.quaternion, *state.nu, *state.nu_dot]
            with pytest.raises(FloatingPointError):
                dynamics.step(state, wrench, current, 0.01)
            assert [*state.position, *state.quaternion, *state.nu, *state.nu_dot] == before


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(("value", "reported"), [(nan, "nan"), (-inf, "-inf")])
def test_a_force_that_is_not_finite_is_named_with_its_time(value: float, reported: str) -> None:
    simulation = Simulation(
        SIX,
        POOL,
        {},
        position=PLACE,
        forces=[BrokenForce(0, 0.0), BrokenForce(250_000_000, value)],
    )
    words = fly(simulation)
    assert words.startswith("6: paper_six: its state is not finite any more after 0.2500 s: the force ")
    assert f"test_divergence:BrokenForce is {reported}: correct that class" in words
    assert simulation.time_ns == 250_000_000
    assert all(isfinite(x) for x in (*simulation.state.position, *simulation.state.nu))


@pytest.mark.usefixtures("twin")
def test_a_step_too_long_for_its_damping_is_named() -> None:
    """Explicit steps overshoot where damping times the step is beyond twice the inertia: also in one call of C."""
    stiff = SIX._replace(quadratic_damping=(1e5, 46.4, 59.9, 0.694, 0.274, 0.875))
    stream = POOL._replace(current=(0.9, 0.0, 0.0), depth=1e3, extent=(-1e4, 1e4, -1e4, 1e4), box=(), cylinder=())
    simulation = Simulation(stiff, stream, {}, position=PLACE, dt_ns=20_000_000)
    words = fly(simulation)
    advised = re.search("quadratic_damping is too strong for a step of 20 ms.* take a step of ([0-9.]+) ms", words)
    assert advised
    simulation = Simulation(stiff, stream, {}, position=PLACE, dt_ns=round(1e6 * float(advised[1])))
    for _ in range(2000):
        simulation.step(NEUTRAL)
    assert 0.5 < simulation.state.nu[0] < 1.0  # it is carried along


@pytest.mark.usefixtures("twin")
def test_a_force_that_is_too_stiff_for_the_step_is_told_from_a_wrong_one() -> None:
    class Spring:
        """A damper of a user's own, in the right direction or not."""

        def __init__(self, damping: float) -> None:
            self.damping = damping

        def begin(self, time_ns: int) -> None:
            pass

        def wrench(self, position: Sequence[float], rotation: Rotation, nu_r: Sequence[float]) -> Sequence[float]:
            return (-self.damping * nu_r[0], 0.0, 0.0, 0.0, 0.0, 0.0)

    for damping, remedy in (
        (1e5, "is too strong for a step of 10 ms"),
        (-1e5, "makes any motion grow, at a shorter step too"),
    ):
        simulation = Simulation(
            SIX, POOL._replace(current=(0.9, 0.0, 0.0)), {}, position=PLACE, dt_ns=10_000_000, forces=[Spring(damping)]
        )
        words = fly(simulation)
        assert "Spring" in words
        assert remedy in words


@pytest.mark.usefixtures("twin")
@pytest.mark.parametrize(
    ("name", "numbers", "message"),
    [
        ("nu", [nan] * 6, "its velocity is nan"),
        ("position", [0.0, inf, 0.0], "its position is inf"),
        ("quaternion", [0.0] * 4, "its attitude is a quaternion of length 0: set one of length 1"),
    ],
)
def test_a_state_that_was_set_to_nan_is_named(name: str, numbers: list[float], message: str) -> None:
    simulation = Simulation(SIX, POOL, {}, position=PLACE)
    simulation.step(NEUTRAL)
    setattr(simulation.state, name, numbers)
    assert f"after 0.0025 s: {message}" in fly(simulation, 2)


# -- to a person ------------------------------------------------------------------------------------------------------


def scenario_of(folder: Path) -> Path:
    (folder / "broken.py").write_text(BROKEN)
    path, _ = write_scenario(folder)
    path.write_text(f'{path.read_text()}[[force]]\nclass = "broken:Broken"\n')
    return path


def test_a_diverged_slave_ends_with_neutral_thrusters(tmp_path: Path) -> None:
    here = {"PYTHONPATH": str(tmp_path)}
    with Program(tmp_path, "slave", scenario_of(tmp_path), environment=here) as slave:
        assert slave.wait(60.0) == 6
        output = slave.output
    assert "thrusters neutral" in output
    assert "uuv-hil slave: paper_six: its state is not finite any more after 0.2500 s" in output
    assert "Traceback" not in output


# -- vehicles that cannot be ------------------------------------------------------------------------------------------


def write_vehicle(folder: Path, key: str, numbers: Sequence[float]) -> str:
    """Return a copy of a preset in which `key` has these numbers."""
    table = read_table(find_preset("sim/vehicles", "paper_six"))
    path = folder / "mine.toml"
    write_toml(str(path), {**table, key: list(numbers)})
    return str(path)


def _matrix(diagonal: float, **entries: float) -> list[float]:
    """Return 36 numbers: `diagonal`, and entries such as e16, row 1 and column 6."""
    numbers = [diagonal if i % 7 == 0 else 0.0 for i in range(36)]
    for key, value in entries.items():
        numbers[6 * (int(key[1]) - 1) + int(key[2]) - 1] = value
    return numbers


@pytest.mark.parametrize(
    ("key", "numbers", "reason"),
    [
        ("linear_damping", _matrix(1.0, e26=-3.0), "makes energy in some motions"),
        ("linear_damping", _matrix(1.0, e26=1.5, e62=1.5), "makes energy in some motions"),
        ("linear_damping", [1.0, 1.0, -0.1, 1.0, 1.0, 1.0], "negative on its diagonal"),
        ("forward_speed_damping", [-5.0, 1.0, 1.0, 1.0, 1.0, 1.0], "negative on its diagonal"),
        ("forward_speed_damping", _matrix(1.0, e35=2.5), "makes energy in some motions"),
        ("forward_speed_damping", [1.0, 2.0], "needs 6 numbers (diagonal) or 36 (full), found 2"),
        ("inertia", [0.1, 0.1, 0.21], "each principal moment is at most the sum of the other two"),
        ("inertia", [0.2, 0.12, 0.0, 0.12, 0.2, 0.0, 0.0, 0.0, 0.05], "each principal moment is at most"),
    ],
)
def test_coefficients_that_generate_energy_are_refused(
    key: str, numbers: list[float], reason: str, tmp_path: Path
) -> None:
    path = write_vehicle(tmp_path, key, numbers)
    with pytest.raises(ConfigError) as caught:
        load_vehicle(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: {key}")
    assert reason in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("key", "numbers"),
    [
        ("linear_damping", _matrix(1.0, e26=1.9, e62=-3.0)),  # what is not symmetric does no work
        ("linear_damping", [0.0] * 6),
        ("forward_speed_damping", _matrix(1.0, e26=-7.0, e62=7.0)),
        ("inertia", [0.1, 0.2, 0.3]),  # a plate
        ("inertia", [0.2, 0.1, 0.0, 0.1, 0.2, 0.0, 0.0, 0.0, 0.3]),
    ],
)
def test_coefficients_at_the_limit_are_accepted(key: str, numbers: list[float], tmp_path: Path) -> None:
    vehicle: Vehicle = load_vehicle(write_vehicle(tmp_path, key, numbers))[0]
    assert getattr(vehicle, key) == tuple(numbers)
