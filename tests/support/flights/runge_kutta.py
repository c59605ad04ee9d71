"""The classical Runge-Kutta method, whose short steps are the reference for the simulator's own step."""

from collections.abc import Sequence

from sim import rotations
from sim.dynamics import Dynamics, State


class RungeKutta(Dynamics):
    """The same equations, integrated with four evaluations a step."""

    def step(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float) -> None:
        def slope(at: Sequence[float]) -> list[float]:
            quaternion, nu = rotations.normalise(at[3:7]), at[7:]
            rotation = rotations.matrix(quaternion)
            pushed = self.add_forces(at[:3], rotation, nu, wrench, current)
            return [
                *rotations.rotate(quaternion, nu[:3]),
                *rotations.multiply(at[3:7], (0.0, 0.5 * nu[3], 0.5 * nu[4], 0.5 * nu[5])),
                *self.acceleration(at[2], rotation, nu, pushed, current),
            ]

        start = [*state.position, *state.quaternion, *state.nu]
        stages = [slope(start)]
        for reach in (0.5 * dt, 0.5 * dt, dt):
            stages.append(slope([x + reach * k for x, k in zip(start, stages[-1], strict=True)]))
        mean = [(a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(*stages, strict=True)]
        end = [x + dt * k for x, k in zip(start, mean, strict=True)]
        state.position, state.quaternion, state.nu = end[:3], list(rotations.normalise(end[3:7])), end[7:]
        state.nu_dot = mean[7:]
