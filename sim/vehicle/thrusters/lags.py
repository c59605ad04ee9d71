"""Dynamics between curve and thrust besides the first-order lag, selected by `dynamics = { kind = ... }`.

In all of them a rotor turns at `s` rad/s and thrust goes with s|s|: `full_speed` gives the thruster's limit.
The curve has the speed it should settle at, so each model settles at the curve's thrust. How far a step
goes depends on its length alone: Yoerger's and Bessa's are solved exactly for a command that holds.
"""

from math import atan, atanh, cos, exp, expm1, inf, sin, sqrt
from typing import Annotated, NamedTuple, Protocol

from hil.common.schema import Range

Speed = Annotated[float, Range(0.1, 1e5, "rad/s")]
Positive = Annotated[float, Range(1e-9, 1e6)]
NotNegative = Annotated[float, Range(0.0, 1e6)]


class Lag(Protocol):
    """The state of a thruster that follows its curve."""

    def step(self, target: float) -> float:
        """Return the thrust in N a step later, when the curve asks for `target` N during it."""


class Lagging(Protocol):
    """A record of the dynamics between curve and thrust."""

    def lag(self, max_forward: float, max_reverse: float, dt: float) -> Lag:
        """Return the state, at rest, of a thruster of these limits (N) stepped every `dt` s."""


class Yoerger(NamedTuple):
    """s' = beta u - alpha s|s| (Yoerger, Cooke, Slotine 1990); `alpha` in 1/rad.

    `beta` only scales the command u, which is the one that holds the curve's thrust: it is no key.
    """

    alpha: Positive
    full_speed: Speed

    def lag(self, max_forward: float, max_reverse: float, dt: float) -> Lag:
        """Return the state of one thruster."""
        return _RotorLag(_Braked(0.0, self.alpha, dt), self.full_speed, max_forward, max_reverse)


class Bessa(NamedTuple):
    """inertia s' = Kt/Rm u - kv1 s - kv2 s|s| (Bessa, Dutra, Kreuzer 2006, as in uuv_simulator).

    `inertia` in kg m² with the water that turns along, `kv1` in N m s/rad, `kv2` in N m s²/rad². Kt and Rm only
    scale the command u, which is the one that holds the curve's thrust: they are no keys.
    """

    inertia: Positive
    kv1: NotNegative
    kv2: NotNegative
    full_speed: Speed

    def validate(self) -> str | None:
        """Return what is wrong between the keys, or None."""
        return None if self.kv1 or self.kv2 else "kv1 and kv2 are both 0: the rotor would never settle"

    def lag(self, max_forward: float, max_reverse: float, dt: float) -> Lag:
        """Return the state of one thruster."""
        rotor = _Braked(self.kv1 / self.inertia, self.kv2 / self.inertia, dt)
        return _RotorLag(rotor, self.full_speed, max_forward, max_reverse)


class RotorPi(NamedTuple):
    """A shaft under a PI speed controller (as Stonefish's mechanical_pi).

    inertia s' = kp e + ki z - load s|s|, z' = e, |z| <= integral_limit, e the missing speed. `inertia` in kg m²,
    `kp` in N m s/rad, `ki` in N m/rad, `integral_limit` in rad, `load` in N m s²/rad². If ki integral_limit is
    below the load's torque, the rotor stays too slow, as a real one does.
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
        wanted = sqrt(target / self._forward) if target > 0.0 else -sqrt(-target / self._reverse)
        self.speed = speed = self._advance(self.speed, wanted)
        return (self._forward if speed > 0.0 else self._reverse) * speed * abs(speed)


class _Braked:
    """s' = c - k1 s - k2 s|s|, solved over `dt`; c is what holds the wanted speed."""

    def __init__(self, k1: float, k2: float, dt: float) -> None:
        self._k1, self._k2, self._dt = k1, k2, dt

    def advance(self, speed: float, wanted: float) -> float:
        """Return the speed a step later."""
        if wanted < 0.0 or (wanted == 0.0 and speed < 0.0):  # the equation is odd
            return -self._towards(-speed, -wanted, self._dt)
        return self._towards(speed, wanted, self._dt)

    def _towards(self, speed: float, wanted: float, time: float) -> float:
        """Step towards a requested speed of 0 or more. The rotor may have to stop first."""
        if speed < 0.0:
            c = wanted * (self._k1 + self._k2 * wanted)
            stop = self._stopping_time(-speed, c)
            if stop >= time:
                return -self._braking(-speed, c, time)
            speed, time = 0.0, time - stop
        # With d = s - wanted: d' = -d (rate + k2 d), Bernoulli's equation.
        rate = self._k1 + 2.0 * self._k2 * wanted
        missing = speed - wanted
        span = -expm1(-rate * time) / rate if rate else time
        return wanted + missing * exp(-rate * time) / (1.0 + self._k2 * missing * span)

    def _braking(self, y: float, c: float, time: float) -> float:
        """Solve y' = -(c + k1 y + k2 y²) from `y` > 0 on: Riccati's equation with constant coefficients."""
        square = self._k1 * self._k1 / 4.0 - self._k2 * c
        shift = -sqrt(square) if square > 0.0 else 0.0  # cancels, and keeps a long step from overflowing
        even, odd = _waves(square, shift, time)
        half = self._k1 / 2.0
        return (y * (even - half * odd) - c * odd) / (even + (self._k2 * y + half) * odd)

    def _stopping_time(self, y: float, c: float) -> float:
        """Return when that y is 0."""
        square = self._k1 * self._k1 / 4.0 - self._k2 * c
        q = y / (c + self._k1 * y / 2.0)
        if square == 0.0:
            return q
        root = sqrt(abs(square))
        if square < 0.0:
            return atan(root * q) / root
        return atanh(root * q) / root if root * q < 1.0 else inf


class _PiRotor:
    """The loop with its load straightened at the present speed, solved exactly over the step.

    That is the exponential Rosenbrock-Euler step (Hochbruck, Ostermann 2010, eq. 2.54): of second order, stable
    at any step, and it settles exactly where the loop does. At its limit the integral stands still.
    """

    def __init__(self, model: RotorPi, dt: float) -> None:
        self._dt = dt
        self._damping, self._stiffness = model.kp / model.inertia, model.ki / model.inertia
        self._load = model.load / model.inertia
        self._limit = model.integral_limit
        self._integral = 0.0

    def advance(self, speed: float, wanted: float) -> float:
        """Return the speed a step later."""
        # e' = push - damping e - stiffness z, z' = e, with load s|s| taken as load |s0| (2 s - s0).
        error, integral = wanted - speed, self._integral
        damping = self._damping + 2.0 * self._load * abs(speed)
        push = self._load * abs(speed) * (2.0 * wanted - speed)
        stiffness = self._stiffness
        if abs(integral) >= self._limit and error * integral > 0.0:
            push -= stiffness * integral
            stiffness = 0.0
        half = damping / 2.0
        even, odd = _waves(half * half - stiffness, -half, self._dt)
        decay = even - half * odd  # of an error; `odd` is its integral over the step, `total` that of `odd`
        total = (1.0 - decay - damping * odd) / stiffness if stiffness else 0.0
        end = decay * error - stiffness * odd * integral + odd * push
        integral = odd * error + (even + half * odd) * integral + total * push
        self._integral = max(-self._limit, min(self._limit, integral))
        return wanted - end


def _waves(square: float, shift: float, time: float) -> tuple[float, float]:
    """Return exp(shift t) times cosh(w t) and times sinh(w t) / w, w² = `square`: cos, sin where it is negative."""
    if square > 0.0:
        root = sqrt(square)
        up, down = exp((shift + root) * time), exp((shift - root) * time)
        return (up + down) / 2.0, (up - down) / (2.0 * root)
    scale = exp(shift * time)
    if square == 0.0:
        return scale, scale * time
    root = sqrt(-square)
    return scale * cos(root * time), scale * sin(root * time) / root
