"""Waves, and what a current does to a vehicle."""

from collections.abc import Sequence
from math import cosh, dist, exp, pi, sinh, tanh
from statistics import pstdev

import numpy as np
from matplotlib.axes import Axes
from scipy.signal import welch

from sim.dynamics import Dynamics, Integrator, State
from sim.environment.waves import WaveField, components, spectral_density, wave_number
from sim.rotations import from_euler, rotate, rotate_inverse
from tests.support.flights.von_benzon import LeftOut
from tests.unit.sim.environment import test_waves as swell
from tests.unit.sim.test_dynamics import DEEP, HEAVY, NOTHING, STILL
from tools.validations.sheet import (
    SHADES,
    WRONG,
    Finding,
    Sheet,
    below,
    label,
    near,
    plot_own,
    plot_ref,
    wrong,
)

# -- a current and a vehicle ------------------------------------------------------------------------------------------

CURRENT = (0.4, -0.3, 0.1)


def carried(panels: Sequence[Axes]) -> list[Finding]:
    """Galileo's principle: relative to the water, motion in a steady current is the same as in still water. Left: the
    same run in both. The vehicle starts with speeds on all axes, and a constant wrench acts on it. Red: the same
    without the term for the water's velocity in turning axes. Right: a drifting vehicle gets the speed of the current.
    In HoloOcean it stays at rest."""
    apart, adrift = panels
    ends = {}
    runs: tuple[tuple[Integrator, bool, str, str], ...] = (
        ("rk4", True, "turning left out (RK4)", WRONG),
        ("verlet", False, "ours, Verlet, 2 ms", SHADES[2]),
        ("rk4", False, "ours, RK4, 2 ms", SHADES[0]),
    )
    for integrator, left_out, name, color in runs:
        away = _apart(integrator, left_out)
        apart.semilogy([0.1 * (i + 1) for i in range(len(away))], away, color=color, label=name)
        ends[name] = away[-1]
    label(apart, "time (s)", "distance of the two (m)", legend="center right")
    return [
        below("seen from the water, RK4, 4 s: distance", ends["ours, RK4, 2 ms"], 1e-8, "m"),
        below("the same, Verlet", ends["ours, Verlet, 2 ms"], 5e-5, "m"),
        _adrift(adrift),
    ]


def _apart(integrator: Integrator, left_out: bool) -> list[float]:
    """Return the distances (m) between the carried vehicle and the one in calm water, each 0.1 s of 4 s."""
    q, nu = from_euler(0.3, -0.2, 0.9), [0.5, -0.2, 0.1, 0.4, -0.3, 0.8]
    moving = [a + b for a, b in zip(nu[:3], rotate_inverse(q, CURRENT), strict=True)] + nu[3:]
    calm, moved = State((0.0, 0.0, DEEP), q, nu), State((0.0, 0.0, DEEP), q, moving)
    still = Dynamics(HEAVY, 1000.0, 9.82, integrator)
    flowing = Dynamics(HEAVY, 1000.0, 9.82, integrator, [LeftOut(CURRENT)] if left_out else [])
    wrench, away = (20.0, 5.0, 0.0, 0.0, 0.0, 1.0), []
    for step in range(1, 2001):
        still.step(calm, wrench, STILL, 0.002)
        flowing.step(moved, wrench, CURRENT, 0.002)
        if step % 50 == 0:
            drifted = [x - c * 0.002 * step for x, c in zip(moved.position, CURRENT, strict=True)]
            away.append(max(dist(drifted, calm.position), 1e-16))
    return away


def _adrift(axes: Axes) -> Finding:
    current, state = (0.3, -0.2, 0.0), State((0.0, 0.0, DEEP), from_euler(0.0, 0.0, 1.0))
    dynamics = Dynamics(HEAVY._replace(neutrally_buoyant=True), 1000.0, 9.82)
    speeds = [(0.0, 0.0, 0.0)]
    for _ in range(120):
        for _ in range(200):
            dynamics.step(state, NOTHING, current, 0.0025)
        speeds.append(rotate(state.quaternion, state.nu[:3]))
    times = [0.5 * i for i in range(121)]
    for axis, name, color in ((0, "ours, north", SHADES[0]), (1, "ours, east", SHADES[2])):
        plot_own(axes, times, [speed[axis] for speed in speeds], name, color)
        plot_ref(axes, times[::8], [current[axis]] * len(times[::8]), "the water" if axis else "_")
    wrong(axes, times, [0.0] * len(times), "HoloOcean")
    axes.set_ylim(-0.25, 0.6)
    label(axes, "time (s)", "speed over ground (m/s)", legend="upper right")
    away = max(abs(a - b) for a, b in zip(speeds[-1], current, strict=True))
    return below("adrift for a minute: speed away from the water's", away, 0.02, "m/s")


# -- waves ------------------------------------------------------------------------------------------------------------


def waves(panels: Sequence[Axes]) -> list[Finding]:
    """An irregular sea of 1.5 m and 7 s. First: the spectrum of its elevation at one place, compared with JONSWAP.
    Second: orbital speeds over depth, compared with Airy's theory, in deep water and over a seabed at 5 m. Third: the
    dispersion."""
    spectrum, orbits, dispersion = panels
    return [*_spectrum(spectrum), *_orbits(orbits), _dispersion(dispersion)]


def _spectrum(axes: Axes) -> list[Finding]:
    waves = swell.SEA
    wave_field = WaveField(waves._replace(components=400), 30.0, swell.G, 5)
    heights = np.array([wave_field.elevation(0.5 * i, 3.0, -4.0) for i in range(16_384)])
    hertz, density = welch(heights, 2.0, nperseg=512)
    plot_own(axes, 2.0 * pi * hertz, density / (2.0 * pi), "ours, 2.3 h of elevation")
    dots = [0.3 + 0.05 * i for i in range(50)]
    plot_ref(axes, dots, [spectral_density(waves, omega) for omega in dots], "JONSWAP")
    axes.set_xlim(0.0, 2.6)
    label(axes, "angular frequency (rad/s)", "spectrum (m² s/rad)", legend="upper right")
    tested = WaveField(waves, 30.0, swell.G, 5)
    significant = [tested.elevation(0.7 * i, 3.0, -4.0) for i in range(10_000)]
    energy = sum(0.5 * wave.amplitude**2 for wave in components(waves, 50.0, swell.G, 3)) / (1.5**2 / 16.0)
    return [
        near("significant height of two hours", 4.0 * pstdev(significant), 1.5, "m", rel=0.04),
        below("energy of the components away from Hs²/16 (share)", abs(energy - 1.0), 1e-12),
    ]


def _orbit(wave_field: WaveField, z: float) -> tuple[float, float]:
    """Return the greatest horizontal and vertical speed at `z` of a wave field of one wave."""
    wave = wave_field.components[0]
    motions = [wave_field.motion(i * pi / wave.omega / 200.0, 0.0, 0.0, z).velocity for i in range(400)]
    return max(abs(v[0]) for v in motions), max(abs(v[2]) for v in motions)


def _orbits(axes: Axes) -> list[Finding]:
    worst = []
    for depth, deepest, color in ((4000.0, 25.0, SHADES[0]), (5.0, 5.0, SHADES[2])):
        wave_field = swell.single(depth)
        distances = [deepest * i / 25.0 for i in range(26)]
        orbits = [_orbit(wave_field, z) for z in distances]
        theory = [_airy(wave_field, z) for z in distances]
        differences = [dist(f, t) for f, t in zip(orbits, theory, strict=True)]
        worst.append(max(differences) / theory[0][0])
        name = "deep" if depth > 100.0 else "5 m"
        axes.plot([h for h, _ in orbits], distances, color=color, label=f"ours, {name}, level")
        axes.plot([v for _, v in orbits], distances, "--", color=color, label=f"ours, {name}, upright")
        plot_ref(axes, [h for h, _ in theory[::2]], distances[::2], "_")
        plot_ref(axes, [v for _, v in theory[::2]], distances[::2], "Airy" if depth < 100.0 else "_")
    axes.invert_yaxis()
    label(axes, "greatest orbital speed (m/s)", "depth (m)", legend="lower right")
    return [
        below("orbital speed in deep water away from Airy (share of the surface's)", worst[0], 1e-3),
        below("over a seabed at 5 m", worst[1], 1e-3),
    ]


def _airy(wave_field: WaveField, z: float) -> tuple[float, float]:
    wave = wave_field.components[0]
    k, size = wave.wave_number, wave.amplitude * wave.omega
    if wave_field.depth > 1000.0:
        return size * exp(-k * z), size * exp(-k * z)
    below_it = k * (wave_field.depth - z)
    return size * cosh(below_it) / sinh(k * wave_field.depth), size * sinh(below_it) / sinh(k * wave_field.depth)


def _dispersion(axes: Axes) -> Finding:
    omegas, worst = [0.05 * 1.1**i for i in range(51)], 0.0
    for depth, color in zip((0.1, 5.0, 30.0, 11_000.0), reversed(SHADES), strict=True):
        numbers = [wave_number(omega, depth, swell.G) for omega in omegas]
        squares = [swell.G * k * tanh(k * depth) for k in numbers]
        worst = max(worst, *(abs(square / w**2 - 1.0) for square, w in zip(squares, omegas, strict=True)))
        axes.loglog(omegas, numbers, color=color, label=f"ours, {depth:g} m")
    plot_ref(axes, omegas[::4], [w * w / swell.G for w in omegas[::4]], "deep: ω² / g")
    shallow = [w for w in omegas[::4] if w < 2.5]
    axes.plot(shallow, [w / (swell.G * 0.1) ** 0.5 for w in shallow], "k+", label="0.1 m: ω / √(g h)")
    label(axes, "angular frequency (rad/s)", "wave number (rad/m)", legend="lower right")
    return below("dispersion away from g k tanh(k h) (share)", worst, 1e-12)


SHEETS = [
    Sheet("Carried by a current", carried),
    Sheet("Waves", waves, columns=3, size=(9.5, 3.1)),
]
