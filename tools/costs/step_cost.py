"""Measure the time of one step of the dynamics: in Python, in C, and as others do it, in one run.

    python tools/costs/step_cost.py [--vehicle bluerov2_heavy] [--integrator rk4] [--rounds 15]

- C, Python: sim.native and sim.dynamics, the same numbers to the last bit.
- numpy: the same equations the way a textbook writes them, in this file; checked against ours first.
- MuJoCo, where it is installed: a free body in its own fluid model (ellipsoid). Other equations, with added
  mass as a force and no full 6x6, but the same task: a wrench in, a state out.

The implementations run in turn, many steps a round; the figure is the best round of each, as other
processes can only add. Ratios are what to compare: microseconds depend on the machine.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

sys.path.insert(0, str(Path(__file__).parents[2]))

from sim.dynamics import Dynamics, Integrator, State
from sim.native import NativeDynamics
from sim.vehicle.vehicle import Vehicle, load_vehicle

DENSITY, GRAVITY, DT = 1025.0, 9.81, 0.0025
WRENCH = [12.0, -5.0, 3.0, 0.2, -0.1, 0.6]
CURRENT = (0.3, -0.2, 0.05)
DEPTH = 1000.0
STEPS = 400


class PlainNumpy:
    """The vector equations of Fossen 2021 as they stand there, deep under water."""

    def __init__(self, vehicle: Vehicle, integrator: Integrator) -> None:
        import numpy as np

        dynamics = Dynamics(vehicle, DENSITY, GRAVITY)
        self.np: Any = np
        self.M = np.array(dynamics.mass)
        self.M_inv = np.linalg.inv(self.M)
        self.D, self.Q = (self._square(x) for x in (vehicle.linear_damping, vehicle.quadratic_damping))
        self.W, self.B = dynamics.weight, dynamics.hull.full
        self.r_g, self.r_b = np.array(vehicle.center_of_gravity), np.array(vehicle.center_of_buoyancy)
        self.A11, self.lost = self._square(vehicle.added_mass)[:3, :3], 1.0 - np.array(vehicle.munk_share)
        self.integrator = integrator
        self.nu_dot = np.zeros(6)

    def _square(self, values: Sequence[float]) -> Any:
        return self.np.diag(values) if len(values) == 6 else self.np.reshape(values, (6, 6))

    def step(self, state: Any, wrench: Any, current: Any, dt: float) -> Any:
        """Return the next state, 13 numbers, by Verlet with a predicted speed or by Runge-Kutta."""
        np = self.np
        if self.integrator == "rk4":
            k1 = self.slope(state, wrench, current)
            k2 = self.slope(state + 0.5 * dt * k1, wrench, current)
            k3 = self.slope(state + 0.5 * dt * k2, wrench, current)
            k4 = self.slope(state + dt * k3, wrench, current)
            state = state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        else:
            rates = np.diag(self.M_inv) * (np.diag(self.D) + 2.0 * np.diag(self.Q) * np.abs(state[7:]))
            ahead = np.maximum(0.0, 1.0 - dt * rates) * self.nu_dot
            mid = state + 0.5 * dt * np.concatenate([self.slope(state, wrench, current, only_pose=True), ahead])
            mid[3:7] /= np.linalg.norm(mid[3:7])
            mid[:3] = state[:3] + 0.5 * dt * self.rotation(mid[3:7]) @ state[7:10]
            self.nu_dot = self.slope(mid, wrench, current)[7:]
            nu = state[7:] + dt * self.nu_dot
            state = np.concatenate([mid[:3] + 0.5 * dt * self.rotation(mid[3:7]) @ nu[:3], mid[3:7], nu])
            state[3:7] += 0.5 * dt * self.slope(state, wrench, current, only_pose=True)[3:]
        q = state[3:7] / np.linalg.norm(state[3:7])
        return np.concatenate([state[:3], q, state[7:]])

    def slope(self, state: Any, wrench: Any, current: Any, only_pose: bool = False) -> Any:
        """Return the rate of the 13 numbers, or of position and quaternion alone."""
        np = self.np
        quaternion, nu = state[3:7] / np.linalg.norm(state[3:7]), state[7:]
        R = self.rotation(quaternion)
        p, q, r = nu[3:]
        turn = np.array([[0, -p, -q, -r], [p, 0, r, -q], [q, -r, 0, p], [r, q, -p, 0]])
        pose_dot = np.concatenate([R @ nu[:3], 0.5 * turn @ state[3:7]])
        if only_pose:
            return pose_dot
        water = R.T @ current
        nu_r = nu - np.concatenate([water, np.zeros(3)])
        drag = self.D @ nu_r + self.Q @ (np.abs(nu_r) * nu_r)
        total = wrench - self.coriolis(nu_r) @ nu_r + self.relief(nu_r) - drag - self.restoring(R)
        nu_dot = self.M_inv @ total - np.concatenate([np.cross(nu[3:], water), np.zeros(3)])
        return np.concatenate([pose_dot, nu_dot])

    def rotation(self, quaternion: Any) -> Any:
        """Return R = I + 2 w S(e) + 2 S(e)²."""
        w, S = quaternion[0], self.skew(quaternion[1:])
        return self.np.eye(3) + 2.0 * w * S + 2.0 * S @ S

    def skew(self, a: Any) -> Any:
        """Return S(a), where S(a) b = a x b."""
        return self.np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])

    def coriolis(self, nu: Any) -> Any:
        """Return C(nu) from M (Fossen 2021, theorem 3.2)."""
        momentum = self.M @ nu
        S_linear, S_angular = self.skew(momentum[:3]), self.skew(momentum[3:])
        return self.np.block([[self.np.zeros((3, 3)), -S_linear], [-S_linear, -S_angular]])

    def relief(self, nu: Any) -> Any:
        """Return the part of the Munk moment that is lost, and the forces that do its work."""
        np = self.np
        momentum = self.A11 @ nu[:3]
        return np.concatenate([np.cross(self.lost * nu[3:], momentum), self.lost * np.cross(nu[:3], momentum)])

    def restoring(self, rotation: Any) -> Any:
        """Return g: minus the force of weight and lift."""
        np = self.np
        f_g, f_b = (rotation.T @ np.array([0.0, 0.0, force]) for force in (self.W, -self.B))
        return -np.concatenate([f_g + f_b, np.cross(self.r_g, f_g) + np.cross(self.r_b, f_b)])


def run_ours(dynamics: Dynamics) -> State:
    """Fly STEPS steps from rest."""
    state = State((0.0, 0.0, DEPTH))
    for _ in range(STEPS):
        dynamics.step(state, WRENCH, CURRENT, DT)
    return state


def run_numpy(plain: PlainNumpy) -> Any:
    """Return the same with numpy."""
    wrench, current = plain.np.array(WRENCH), plain.np.array(CURRENT)
    plain.nu_dot = plain.np.zeros(6)
    state = plain.np.array([0.0, 0.0, DEPTH, 1.0, *[0.0] * 9])
    for _ in range(STEPS):
        state = plain.step(state, wrench, current, DT)
    return state


def check(plain: PlainNumpy, dynamics: Dynamics) -> None:
    """End the program unless both flew the same path, but for rounding."""
    ours, theirs = run_ours(dynamics), run_numpy(plain)
    mine = [*ours.position, *ours.quaternion, *ours.nu]
    apart = max(abs(a - b) for a, b in zip(mine, theirs, strict=True))
    if apart > 1e-9:
        sys.exit(f"numpy and Python disagree by {apart:g}: this tool is wrong")


def mujoco_runner(vehicle: Vehicle, integrator: Integrator) -> Callable[[], object]:
    """Return a free body of the same mass and size in MuJoCo's ellipsoid fluid model."""
    mujoco = __import__("mujoco")
    half = " ".join(str(0.5 * x) for x in vehicle.dimensions)
    inertia = " ".join(str(x) for x in (vehicle.inertia if len(vehicle.inertia) == 3 else vehicle.inertia[::4]))
    method = "RK4" if integrator == "rk4" else "Euler"
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{DT}" density="{DENSITY}" viscosity="0.001" gravity="0 0 0"
                        wind="{" ".join(map(str, CURRENT))}" integrator="{method}"/>
          <worldbody><body><freejoint/>
            <inertial pos="0 0 0" mass="{vehicle.mass}" diaginertia="{inertia}"/>
            <geom type="ellipsoid" size="{half}" fluidshape="ellipsoid" contype="0" conaffinity="0"/>
          </body></worldbody></mujoco>""")
    data = mujoco.MjData(model)

    def run() -> object:
        mujoco.mj_resetData(model, data)
        for _ in range(STEPS):
            data.xfrc_applied[1] = WRENCH
            mujoco.mj_step(model, data)
        return data

    return run


def candidates(vehicle: Vehicle, integrator: Integrator) -> dict[str, Callable[[], object]]:
    """Return the implementations that can be measured on this machine, by name."""
    python = Dynamics(vehicle, DENSITY, GRAVITY, integrator)
    runs: dict[str, Callable[[], object]] = {}
    try:
        native = NativeDynamics(vehicle, DENSITY, GRAVITY, integrator)
        runs["C"] = lambda: run_ours(native)
    except ImportError:
        print("no C here (make it with: python c_extensions.py)", file=sys.stderr)
    runs["Python"] = lambda: run_ours(python)
    if find_spec("numpy"):
        plain = PlainNumpy(vehicle, integrator)
        check(plain, python)
        runs["numpy"] = lambda: run_numpy(plain)
    if find_spec("mujoco"):
        runs["MuJoCo"] = mujoco_runner(vehicle, integrator)
    return runs


def best_times(runs: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return seconds a step of the best round of each, the rounds taken in turn."""
    best = dict.fromkeys(runs, float("inf"))
    for _ in range(rounds):
        for name, run in runs.items():
            began = time.perf_counter()
            run()
            best[name] = min(best[name], (time.perf_counter() - began) / STEPS)
    return best


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicle", default="bluerov2_heavy", help="preset or file [%(default)s]")
    parser.add_argument("--integrator", choices=get_args(Integrator), default="verlet")
    parser.add_argument("--rounds", type=int, default=15, help=f"rounds of {STEPS} steps [%(default)s]")
    options = parser.parse_args()
    vehicle, _ = load_vehicle(options.vehicle)
    best = best_times(candidates(vehicle, options.integrator), options.rounds)
    print(f"{vehicle.name}, {options.integrator}, us a step, best of {options.rounds} rounds")
    for name, seconds in best.items():
        print(f"{name:8}{seconds * 1e6:8.2f}   {seconds / best['Python']:8.3f} x Python")
    return 0


if __name__ == "__main__":
    sys.exit(main())
