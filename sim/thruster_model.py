"""The record of one thruster: where it sits, which way it pushes, and by which model a pulse becomes thrust."""

from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from hil.errors import ConfigError
from hil.schema import Range, parse

if TYPE_CHECKING:
    from sim.thruster_curves import Curve
    from sim.thruster_lags import Lagging

Metres = Annotated[float, Range(-50.0, 50.0, "m")]
Point = tuple[Metres, Metres, Metres]
Pulse = Annotated[int, Range(800, 2200)]


class Thruster(NamedTuple):
    """One thruster.

    `direction` is that of positive thrust, of any length; `unit_direction` has length 1. Without a `curve`
    thrust grows from the edge of the dead band (`dead_band_us` each side of neutral) to `max_forward` at
    `pwm_max_us` and `max_reverse` (both positive) at `pwm_min_us`, a share `linear_share` of it in
    proportion to the pulse and the rest with its square. Another `curve` is a table with its `kind`
    (sim/thruster_curves.py); `max_forward` and `max_reverse` limit that one too.

    Thrust follows the curve at once if `time_constant` is 0, else with this first-order lag, or as the table
    `dynamics` and its `kind` say (sim/thruster_lags.py). The propeller turns the vehicle by `torque` N m for each N
    of thrust, right-handed about `direction`. Not modelled: torque that is not in proportion, ventilation.
    """

    name: str
    position: Point
    direction: tuple[float, float, float]
    max_forward: Annotated[float, Range(1e-3, 1e5, "N")]
    max_reverse: Annotated[float, Range(1e-3, 1e5, "N")]
    dead_band_us: Annotated[float, Range(0.0, 300.0)] = 0.0
    linear_share: Annotated[float, Range(0.0, 1.0)] = 0.0
    time_constant: Annotated[float, Range(0.0, 10.0, "s")] = 0.0
    pwm_neutral_us: Pulse = 1500
    pwm_min_us: Pulse = 1100
    pwm_max_us: Pulse = 1900
    curve: "Curve | None" = None
    dynamics: "Lagging | None" = None
    torque: Annotated[float, Range(-10.0, 10.0, "m")] = 0.0

    @property
    def unit_direction(self) -> tuple[float, float, float]:
        """The direction of positive thrust with length 1."""
        x, y, z = self.direction
        length = (x * x + y * y + z * z) ** 0.5
        return x / length, y / length, z / length

    def problem(self) -> str | None:
        """What is wrong between the keys, if anything."""
        if not any(self.direction):
            return f"thruster {self.name!r}: direction is zero"
        low, high = self.pwm_min_us + self.dead_band_us, self.pwm_max_us - self.dead_band_us
        if not low < self.pwm_neutral_us < high:
            return f"thruster {self.name!r}: neutral and dead band leave no pulse to drive it both ways"
        return None

    def deflection(self, pwm_us: float) -> float:
        """How far a pulse is from the dead band's edge to the end of its range: -1 to 1, beyond counts as the end."""
        offset = pwm_us - self.pwm_neutral_us
        beyond = abs(offset) - self.dead_band_us
        if beyond <= 0.0:
            return 0.0
        return min(1.0, beyond / self.span(offset)) if offset > 0 else -min(1.0, beyond / self.span(offset))

    def pulse_at(self, deflection: float) -> int:
        """The pulse (us) of a deflection, which is clamped to -1 to 1; neutral for 0."""
        if deflection == 0.0:
            return self.pwm_neutral_us
        neutral, dead_band = self.pwm_neutral_us, self.dead_band_us
        if deflection > 0.0:
            return round(neutral + (min(1.0, deflection) * (self.pwm_max_us - neutral - dead_band) + dead_band))
        return round(neutral + (max(-1.0, deflection) * (neutral - self.pwm_min_us - dead_band) - dead_band))

    def clamp(self, thrust: float) -> float:
        """`thrust` (N) within what the thruster can give."""
        return max(-self.max_reverse, min(self.max_forward, thrust))

    def span(self, side: float) -> float:
        """The microseconds from the dead band's edge to the end of the pulse range, ahead or (`side` < 0) astern."""
        end = self.pwm_max_us - self.pwm_neutral_us if side > 0 else self.pwm_neutral_us - self.pwm_min_us
        return end - self.dead_band_us


def with_models(thruster: Thruster, tables: dict[str, Any], where: str) -> Thruster:
    """`thruster` with the `curve` and `dynamics` of its TOML table. Raises ConfigError.

    The models are loaded here, when a vehicle uses one: most do without.
    """
    if "curve" in tables:
        from sim.thruster_curves import CURVES

        thruster = thruster._replace(curve=_read_kind(tables["curve"], CURVES, f"{where}: curve"))
    if "dynamics" in tables:
        from sim.thruster_lags import DYNAMICS

        if thruster.time_constant:
            raise ConfigError(f"{where}: give time_constant or dynamics, not both")
        thruster = thruster._replace(dynamics=_read_kind(tables["dynamics"], DYNAMICS, f"{where}: dynamics"))
    return thruster


def _read_kind(table: Any, kinds: dict[str, Any], where: str) -> Any:
    """The record that the table's key `kind` chooses, from its other keys."""
    if not isinstance(table, dict):
        raise ConfigError(f'{where}: expected a table like {{ kind = "{next(iter(kinds))}" }}, found {table!r}')
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise ConfigError(f"{where}: kind: {kind!r} is not one of {', '.join(kinds)}")
    return parse({key: value for key, value in table.items() if key != "kind"}, kinds[kind], where)
