"""The step in C gives the same bytes as the step in Python, and the choice between the two."""

import random
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from struct import pack
from typing import NamedTuple

import pytest

import c_extensions
import sim.native
from hil.common.errors import ConfigError
from hil.common.schema import preset_names
from hil.doctor.software import EXTENSIONS
from sim import rotations
from sim.assembly import make_dynamics, make_thruster_set
from sim.dynamics import Dynamics, State
from sim.matrices import square
from sim.native import NativeDynamics, NativeErrorBank, NativeThrusterSet, choose, has_native
from sim.sensors.error import ErrorBank, ErrorModel
from sim.twins import make_error_bank
from sim.vehicle.thrusters.bank import ThrusterSet
from sim.vehicle.vehicle import Vehicle, load_vehicle

ROOT = Path(__file__).parents[4]
BINARY = "sim.native._native"
STEPS = 300
DT = 0.0025


@pytest.fixture
def no_native(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, BINARY, None)
    monkeypatch.delattr(sim.native, "_native", raising=False)
    monkeypatch.delenv("UUV_HIL_NATIVE", raising=False)


def coupled() -> Vehicle:
    """Return a vehicle whose matrices are all full, and which floats."""
    rng = random.Random(5)
    vehicle, _ = load_vehicle("bluerov2_heavy")

    def full(diagonal: tuple[float, ...]) -> tuple[float, ...]:
        matrix = square(diagonal, 6)
        for i in range(6):
            for j in range(i):
                matrix[i][j] = matrix[j][i] = rng.uniform(-0.02, 0.02)
        return tuple(x for row in matrix for x in row)

    return vehicle._replace(
        name="coupled", neutrally_buoyant=False, volume=1.1 * vehicle.mass / 1000.0,
        center_of_gravity=(0.01, -0.02, 0.03), added_mass=full(vehicle.added_mass),
        linear_damping=full(vehicle.linear_damping), quadratic_damping=full(vehicle.quadratic_damping),
        munk_share=(0.9, 0.3, 0.0),
    )  # fmt: skip


VEHICLES = [*(load_vehicle(name)[0] for name in preset_names("sim/vehicles")), coupled()]


class Flight(NamedTuple):
    """A start and what acts on each step."""

    position: tuple[float, ...]
    quaternion: tuple[float, ...]
    nu: tuple[float, ...]
    inputs: list[tuple[list[float], tuple[float, ...]]]

    def state(self) -> State:
        return State(self.position, self.quaternion, self.nu)


def flight(seed: int, depth: float, steps: int = STEPS) -> Flight:
    """Return a flight from `depth` m: random attitude, speeds and currents, and wrenches held for some steps."""
    rng = random.Random(seed)

    def numbers(count: int, size: float) -> tuple[float, ...]:
        return tuple(rng.uniform(-size, size) for _ in range(count))

    inputs = []
    for i in range(steps):
        if i % 50 == 0:
            wrench, current = [*numbers(3, 60.0), *numbers(3, 8.0)], numbers(3, 0.6)
        inputs.append((wrench, current))
    return Flight((*numbers(2, 9.0), depth), rotations.normalise(numbers(4, 1.0)), numbers(6, 1.5), inputs)


def packed(numbers: Sequence[float]) -> bytes:
    return pack(f"{len(numbers)}d", *numbers)


def move_to_surface(state: State) -> None:
    """Move the vehicle to the surface, so that the hull crosses it often."""
    north, east, down = state.position
    if abs(down) > 0.3:
        state.position = [north, east, 0.1 * down]


def leave_unchanged(state: State) -> None:
    """Do not change the state."""


def fly(dynamics: Dynamics, path: Flight, change_state: Callable[[State], None] = leave_unchanged) -> tuple[bytes, int]:
    """Return all 19 numbers of each step as bytes, and in how many steps the hull stood partly out of the water."""
    state, chunks, crossing = path.state(), [], 0
    for wrench, current in path.inputs:
        change_state(state)
        lift = dynamics.hull.buoyancy(state.position[2], rotations.matrix(state.quaternion)[6:])[0]
        crossing += 0.0 < lift < dynamics.hull.full
        dynamics.step(state, wrench, current, DT)
        chunks.append(packed([*state.position, *state.quaternion, *state.nu, *state.nu_dot]))
    return b"".join(chunks), crossing


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: vehicle.name)
@pytest.mark.usefixtures("native")
def test_steps_in_c_and_python_are_equal_bit_for_bit(vehicle: Vehicle) -> None:
    python, native = Dynamics(vehicle, 1025.0, 9.81), NativeDynamics(vehicle, 1025.0, 9.81)
    deep, shallow = flight(7, 500.0), flight(8, 0.05)
    expected, crossing = fly(python, deep)
    assert crossing == 0
    assert fly(native, deep) == (expected, 0)
    expected, crossing = fly(python, shallow, move_to_surface)
    assert crossing > STEPS / 4
    assert fly(native, shallow, move_to_surface) == (expected, crossing)


AARCH64 = ("aarch64-linux-gnu-gcc", "qemu-aarch64")
needs_aarch64 = [
    pytest.mark.aarch64,
    pytest.mark.skipif(not all(map(shutil.which, AARCH64)), reason=f"needs {' and '.join(AARCH64)}"),
]


@pytest.mark.parametrize(
    ("compiler", "emulator", "flags"),
    [
        pytest.param("cc", [], ["-O2"], id="this-machine"),
        pytest.param("cc", [], ["-O3", "-march=native"], id="this-machine-O3"),
        pytest.param(AARCH64[0], [AARCH64[1]], ["-O2"], id="aarch64", marks=needs_aarch64),
        pytest.param(AARCH64[0], [AARCH64[1]], ["-O3", "-mcpu=cortex-a72"], id="cortex-a72", marks=needs_aarch64),
    ],
)
def test_the_kernel_alone_equals_python_on_each_machine(
    compiler: str, emulator: list[str], flags: list[str], tmp_path: Path
) -> None:
    """A C program without Python runs the same kernel and equals Python on this machine."""
    if not shutil.which(compiler):
        pytest.skip(f"no {compiler}")
    program = tmp_path / "kernel"
    source = [str(Path(__file__).with_name("kernel_main.c")), f"-I{ROOT / 'sim/native'}"]
    common = [flag for flag in c_extensions.FLAGS if not flag.startswith("-O") and flag not in ("-fPIC", "-shared")]
    subprocess.run([compiler, *common, *flags, *source, "-static", "-o", str(program), "-lm"], check=True)
    path = flight(9, -0.1)
    start = (*path.position, *path.quaternion, *path.nu, DT, float(len(path.inputs)))
    inputs = [x for wrench, current in path.inputs for x in (*wrench, *current)]
    python = Dynamics(VEHICLES[-1], 1025.0, 9.81)
    hull = float(len(python.hull.triangles)), *(x for triangle in python.hull.triangles for x in triangle)
    given = packed([*python.numbers(), *hull, *start, *inputs])
    completed = subprocess.run([*emulator, str(program)], input=given, capture_output=True)
    expected, crossing = fly(python, path)
    assert crossing > STEPS / 20
    assert completed.returncode == 0
    assert completed.stdout == expected


@pytest.mark.usefixtures("native")
def test_a_step_does_not_change_earlier_state_lists() -> None:
    path = flight(3, 500.0)
    state = path.state()
    position, quaternion, nu = state.position, state.quaternion, state.nu
    NativeDynamics(VEHICLES[0], 1025.0, 9.81).step(state, *path.inputs[0], DT)
    assert (tuple(position), tuple(quaternion), tuple(nu)) == (path.position, path.quaternion, path.nu)
    assert state.nu != nu


@pytest.mark.parametrize("dynamics", [Dynamics, NativeDynamics])
@pytest.mark.usefixtures("native")
def test_invalid_step_arguments_are_refused(dynamics: type[Dynamics]) -> None:
    """Both raise the same error for too few numbers, no numbers, and no attitude."""
    instance = dynamics(VEHICLES[0], 1025.0, 9.81)
    for wrench, current in (([0.0] * 5, (0.0,) * 3), ([0.0] * 7, (0.0,) * 3), ([0.0] * 6, (0.0,) * 2)):
        with pytest.raises(ValueError, match=r"\d"):
            instance.step(State(), wrench, current, DT)
    with pytest.raises(TypeError):
        instance.step(State(), ["x"] * 6, (0.0,) * 3, DT)  # type: ignore[list-item]
    with pytest.raises(FloatingPointError):
        instance.step(State(quaternion=(0.0,) * 4), [0.0] * 6, (0.0,) * 3, DT)


MODELS = [
    ErrorModel(),
    ErrorModel(noise=0.3),
    ErrorModel(bias=0.2, bias_time=3.0),
    ErrorModel(offset=-1.0, turn_on=0.5, bias=0.1, noise=0.02, noise_density=0.01, scale=0.05),
    ErrorModel(noise=2.0, resolution=0.25),
    ErrorModel(noise=3.0, resolution=0.5, limit=4.0, outliers=0.1, outlier=2.0),
    ErrorModel(bias=0.1, flicker=0.2, noise=0.1, noise_share=0.3, warm_up=0.4, warm_up_time=5.0),
]


@pytest.mark.parametrize("drawn", [0, 1, 2, 777])
@pytest.mark.usefixtures("native")
def test_sensor_errors_in_c_and_python_are_equal(drawn: int) -> None:
    """The errors are equal in the middle of a pair of normal numbers too, before and after a new twist."""
    banks = []
    for kind in (ErrorBank, NativeErrorBank):
        rng = random.Random(f"9/{drawn}")
        for _ in range(drawn):
            rng.gauss(0.0, 1.0)
        banks.append(kind(MODELS, 0.01, rng))
    python, native = banks
    rng = random.Random(3)
    for _ in range(2000):
        true = [rng.uniform(-5.0, 5.0) for _ in MODELS]
        first, second = python.measure(true), native.measure(tuple(true))
        assert packed(first) == packed(second)  # == would take -0.0 for 0.0


@pytest.mark.usefixtures("native")
def test_invalid_arguments_of_the_error_bank_are_refused() -> None:
    bank = NativeErrorBank(MODELS, 0.01, random.Random(1))
    with pytest.raises(ValueError, match="7 numbers are needed, found 2"):
        bank.measure([1.0, 2.0])
    with pytest.raises(TypeError):
        bank.measure(["1"] * 7)  # type: ignore[list-item]
    module = sys.modules[BINARY]
    with pytest.raises(ValueError, match="up to 32 records of 176 bytes are needed, found 3"):
        module.Errors(b"123", bytes(2500), None)
    with pytest.raises(ValueError, match="a state of 625 numbers"):
        module.Errors(bytes(176), bytes(9), None)
    with pytest.raises(ValueError, match="up to 16 records of 144 bytes are needed, found 2448"):
        module.ThrusterBank(bytes(17 * 144))


@pytest.mark.usefixtures("native")
def test_the_binary_checks_its_parameters() -> None:
    kernel = sys.modules[BINARY].Kernel
    with pytest.raises(ValueError, match="bytes of parameters"):
        kernel(b"\0" * 8, b"", ())
    with pytest.raises(TypeError, match="a tuple of forces"):
        kernel(bytes(8 * len(Dynamics(VEHICLES[0], 1025.0, 9.81).numbers())), bytes(72), (3,))
    force = sys.modules[BINARY].Force
    for kind, numbers, servos in ((7, 1, 0), (-1, 1, 0), (0, 10, 0), (1, 22, 0), (1, 25, 0), (4, 17, 0), (5, 5, 2)):
        with pytest.raises(ValueError, match=f"a force of kind {kind} is not made of"):
            force(kind, bytes(8 * numbers), bytes(32 * servos), None)
    with pytest.raises(ValueError, match="a force of kind 6"):
        force(6, bytes(136), b"", None)
    with pytest.raises(TypeError, match="a WaveField or None"):
        force(6, bytes(136), b"", 3)


@pytest.mark.usefixtures("native")
def test_c_is_used_where_it_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    for wish in ("", "1"):
        monkeypatch.setenv("UUV_HIL_NATIVE", wish)
        assert type(make_dynamics(VEHICLES[0], 1025.0, 9.81)) is NativeDynamics
        assert type(make_thruster_set(VEHICLES[0], DT)) is NativeThrusterSet
        assert type(make_error_bank(MODELS, DT, random.Random(1))) is NativeErrorBank
        assert choose()[1].startswith("C, ")
    monkeypatch.setenv("UUV_HIL_NATIVE", "0")
    assert type(make_dynamics(VEHICLES[0], 1025.0, 9.81)) is Dynamics
    assert type(make_thruster_set(VEHICLES[0], DT)) is ThrusterSet
    assert type(make_error_bank(MODELS, DT, random.Random(1))) is ErrorBank
    monkeypatch.setenv("UUV_HIL_NATIVE", "yes")
    with pytest.raises(ConfigError, match="UUV_HIL_NATIVE='yes'"):
        choose()


@pytest.mark.usefixtures("no_native")
def test_python_is_used_where_c_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert type(make_dynamics(VEHICLES[0], 1025.0, 9.81)) is Dynamics
    assert "the step in C is not there" in choose()[1]
    monkeypatch.setenv("UUV_HIL_NATIVE", "1")
    with pytest.raises(ConfigError, match=r"UUV_HIL_NATIVE=1, but.*python c_extensions.py"):
        choose()


@pytest.mark.usefixtures("native")
@pytest.mark.parametrize("name", [c_extensions.module(path) for path in c_extensions.SOURCES])
def test_required_c_with_a_missing_extension_is_an_error(name: str) -> None:
    """One extension is missing, as in a tree that was compiled before it was added."""
    with pytest.MonkeyPatch.context() as patch:  # undone before what `native` put in place is taken out
        patch.setenv("UUV_HIL_NATIVE", "1")
        assert has_native(name)
        patch.setitem(sys.modules, name, None)
        if name == BINARY:
            patch.delattr(sim.native, "_native", raising=False)
        with pytest.raises(ConfigError, match=r"UUV_HIL_NATIVE=1, but .*python c_extensions.py"):
            has_native(name)
        patch.delenv("UUV_HIL_NATIVE")
        assert not has_native(name)


@pytest.mark.usefixtures("native")
def test_every_extension_is_loaded_through_has_native() -> None:
    """All use `has_native`, so that Python never replaces a demanded C silently."""
    names = {"sim.native._native"}
    for path in (ROOT / name for name in ("sim/twins.py", "sim/native/__init__.py", "hil/slave/native/firmware.py")):
        text = path.read_text()
        names |= set(re.findall(r'has_native\("([\w.]+)"\)', text))
        assert text.count("except ImportError") <= 2, path
    assert names == {c_extensions.module(path) for path in c_extensions.SOURCES} == {"sim.native._native", *EXTENSIONS}


def test_the_build_reports_what_is_missing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    if reason := c_extensions.unavailable_reason():
        pytest.skip(f"no step in C: {reason}")
    monkeypatch.setattr(c_extensions, "compiler", lambda: None)
    assert "no C compiler" in str(c_extensions.build(str(tmp_path)))
    monkeypatch.setattr(c_extensions, "compiler", lambda: ["cc", "-include", "no_such_header.h"])
    assert "no_such_header.h" in str(c_extensions.build(str(tmp_path)))
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_the_c_sources_use_no_format_that_depends_on_the_python_version() -> None:
    """A format with # compiled for 3.13 fails in 3.10 to 3.12, whatever PY_SSIZE_T_CLEAN says."""
    for source in (*ROOT.glob("sim/native/*.[ch]"), *ROOT.glob("hil/slave/native/*.[ch]")):
        assert not re.search(r'Py(Arg_Parse|_BuildValue)[^;]*"[^";]*#', source.read_text()), source
