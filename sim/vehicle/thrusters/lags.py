"""Rotor dynamics of a thruster, in place of the first-order lag, selected by `dynamics = { kind = ... }`.

In all models a rotor turns at `s` rad/s and thrust is proportional to s|s|; `full_speed` makes the thruster's limit.
The target speed is that of the curve's thrust, so each model settles at the curve's thrust. Yoerger's and Bessa's
models are solved exactly for a command that is constant during the step.
"""

from math import atan, atanh, cos, exp, expm1, inf, sin, sqrt
from typing import Annotated, NamedTuple, Protocol

from hil.common.schema import Range

Speed = Annotated[float, Range(0.1, 1e5, "rad/s")]
Positive = Annotated[float, Range(1e-9, 1e6)]
NotNegative = Annotated[float, Range(0.0, 1e6)]


class Lag(Protocol):
    """The state of one thruster whose thrust follows its curve with a lag."""

    def step(self, target: float) -> float:
        """Return the thrust in N at the end of a step during which the curve's thrust is `target` N."""


class LagModel(Protocol):
    """The keys of a model of the dynamics between curve and thrust."""

    def lag(self, max_forward: float, max_reverse: float, dt: float) -> Lag:
        """Return the state, at rest, of a thruster with these limits (N) that is stepped every `dt` s."""


class Yoerger(NamedTuple):
    """s' = beta u - alpha s|s| (Yoerger, Cooke, Slotine 1990); `alpha` in 1/rad.

    `beta` only scales the command u, which is chosen to keep the curve's thrust; so it is not a key.
    """

    alpha: Positive
    full_speed: Speed

    def lag(self, max_forward: float, max_reverse: float, dt: float) -> Lag:
        """Return the state of one thruster."""
        return _RotorLag(_Braked(0.0, self.alpha, dt), self.full_speed, max_forward, max_reverse)


class Bessa(NamedTuple):
    """inertia s' = Kt/Rm u - kv1 s - kv2 s|s| (Bessa, Dutra, Kreuzer 2006, as in uuv_simulator).

    `inertia` in kg m² with added inertia of the water, `kv1` in N m s/rad, `kv2` in N m s²/rad². Kt and Rm only scale
    the command u, which is chosen to keep the curve's thrust; so they are not keys.
    """

    inertia: Positive
    kv1: NotNegative
    kv2: NotNegative
    full_speed: Speed

    def validate(self) -> str | None:
        """Return what is wrong with the combination of the keys, or None."""
        return None if self.kv1 or self.kv2 else "kv1 and kv2 are both 0: the rotor would never settle"

    def lag(self, max_forward: float, max_reverse: float, dt: float) -> Lag:
        """Return the state of one thruster."""
        rotor = _Braked(self.kv1 / self.inertia, self.kv2 / self.inertia, dt)
        return _RotorLag(rotor, self.full_speed, max_forward, max_reverse)


class RotorPi(NamedTuple):
    """A shaft under a PI speed controller (as Stonefish's mechanical_pi).

    inertia s' = kp e + ki z - load s|s|, z' = e, |z| <= integral_limit, with the speed error e. `inertia` in kg m²,
    `kp` in N m s/rad, `ki` in N m/rad, `integral_limit` in rad, `load` in N m s²/rad². If ki integral_limit is less
    than the load's torque, the rotor stays too slow, as a real one does.
    """

    inertia: Positive
    kp: Positive
    ki: NotNegative
    full_speed: Speed
    load: NotNegative = 0.0
    integral_limit: Positive = 1e6

    def lag(self, max_forward: float, max_reverse: float, dt: float) -> Lag:
        """Return the state of one thruster."""
        return _RotorLag(_PiRotor(self, dt), self.full_speed, max_forward, max_reverse)


DYNAMICS = {"yoerger": Yoerger, "bessa": Bessa, "rotor_pi": RotorPi}


class _RotorLag:
    """Thrust through the `speed` (rad/s) of a rotor."""

    def __init__(self, rotor: "_Braked | _PiRotor", full_speed: float, forward: float, reverse: float) -> None:
        self._advance = rotor.advance
        self._forward, self._reverse = forward / full_speed**2, reverse / full_speed**2  # N s²/rad²
        self.speed = 0.0

    def step(self, target: float) -> float:
        """Return the thrust in N a step later."""
        target_speed = sqrt(target / self._forward) if target > 0.0 else -sqrt(-target / self._reverse)
        self.speed = speed = self._advance(self.speed, target_speed)
        return (self._forward if speed > 0.0 else self._reverse) * speed * abs(speed)


class _Braked:
    """A rotor with s' = c - k1 s - k2 s|s|, solved exactly over `dt`; c is the constant that keeps the target speed."""

    def __init__(self, k1: float, k2: float, dt: float) -> None:
        self._k1, self._k2, self._dt = k1, k2, dt

    def advance(self, speed: float, target: float) -> float:
        """Return the speed a step later."""
        if target < 0.0 or (target == 0.0 and speed < 0.0):  # the equation is odd
            return -self._towards(-speed, -target, self._dt)
        return self._towards(speed, target, self._dt)

    def _towards(self, speed: float, target: float, time: float) -> float:
        """Return the speed after `time` s with a target of 0 or more. A rotor that turns backwards stops first."""
        if speed < 0.0:
            c = target * (self._k1 + self._k2 * target)
            stop = self._stopping_time(-speed, c)
            if stop >= time:
                return -self._braking(-speed, c, time)
            speed, time = 0.0, time - stop
        # With d = s - target: d' = -d (rate + k2 d), Bernoulli's equation.
        rate = self._k1 + 2.0 * self._k2 * target
        error = speed - target
        span = -expm1(-rate * time) / rate if rate else time
        return target + error * exp(-rate * time) / (1.0 + self._k2 * error * span)

    def _braking(self, y: float, c: float, time: float) -> float:
        """Return the solution of y' = -(c + k1 y + k2 y²), Riccati's equation, after `time` s from `y` > 0."""
        square = self._k1 * self._k1 / 4.0 - self._k2 * c
        shift = -sqrt(square) if square > 0.0 else 0.0  # cancels in the result, and prevents overflow in a long step
        even, odd = _even_odd(square, shift, time)
        half = self._k1 / 2.0
        return (y * (even - half * odd) - c * odd) / (even + (self._k2 * y + half) * odd)

    def _stopping_time(self, y: float, c: float) -> float:
        """Return the time (s) at which the y of `_braking` is 0; infinity if never."""
        square = self._k1 * self._k1 / 4.0 - self._k2 * c
        q = y / (c + self._k1 * y / 2.0)
        if square == 0.0:
            return q
        root = sqrt(abs(square))
        if square < 0.0:
            return atan(root * q) / root
        return atanh(root * q) / root if root * q < 1.0 else inf


class _PiRotor:
    """A rotor under PI control, with its load linearised at the present speed and solved exactly over the step.

    This is the exponential Rosenbrock-Euler method (Hochbruck, Ostermann 2010, eq. 2.54): of second order, stable for
    any step, and exact in the steady state. The integral stops at its limit.
    """

    def __init__(self, model: RotorPi, dt: float) -> None:
        self._dt = dt
        self._damping, self._stiffness = model.kp / model.inertia, model.ki / model.inertia
        self._load = model.load / model.inertia
        self._limit = model.integral_limit
        self._integral = 0.0

    def advance(self, speed: float, target: float) -> float:
        """Return the speed a step later."""
        # e' = drive - damping e - stiffness z, z' = e, with load s|s| linearised as load |s0| (2 s - s0).
        error, integral = target - speed, self._integral
        damping = self._damping + 2.0 * self._load * abs(speed)
        drive = self._load * abs(speed) * (2.0 * target - speed)
        stiffness = self._stiffness
        if abs(integral) >= self._limit and error * integral > 0.0:
            drive -= stiffness * integral
            stiffness = 0.0
        half = damping / 2.0
        even, odd = _even_odd(half * half - stiffness, -half, self._dt)
        decay = even - half * odd  # of an error; `odd` is its integral over the step, `total` that of `odd`
        total = (1.0 - decay - damping * odd) / stiffness if stiffness else 0.0
        end = decay * error - stiffness * odd * integral + odd * drive
        integral = odd * error + (even + half * odd) * integral + total * drive
        self._integral = max(-self._limit, min(self._limit, integral))
        return target - end


def _even_odd(square: float, shift: float, time: float) -> tuple[float, float]:
    """Return exp(shift t) cosh(w t) and exp(shift t) sinh(w t) / w, w² = `square`; cos and sin if it is negative."""
    if square > 0.0:
        root = sqrt(square)
        up, down = exp((shift + root) * time), exp((shift - root) * time)
        return (up + down) / 2.0, (up - down) / (2.0 * root)
    scale = exp(shift * time)
    if square == 0.0:
        return scale, scale * time
    root = sqrt(-square)
    return scale * cos(root * time), scale * sin(root * time) / root
