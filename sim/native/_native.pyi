from collections.abc import Sequence

from sim.dynamics import State

class Kernel:
    def __new__(cls, numbers: bytes, /) -> Kernel: ...
    def step(self, state: State, wrench: Sequence[float], current: Sequence[float], dt: float, /) -> None: ...
