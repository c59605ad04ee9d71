"""The reference platform's allocation in closed form, to compare `Allocator` with."""

from math import sqrt


def four_vectored(surge: float, sway: float, yaw: float, lever: float) -> tuple[float, float, float, float]:
    """Return the thrusts (N) of four horizontal thrusters at 90 degrees to each other, in closed form.

    This is the arrangement the reference platform decomposes in its eqs (12) and (13): one thruster at each corner,
    at 45 degrees to the axes, the four of them mirror images, each pushing forward with a positive thrust; in
    the order front right, front left, rear right, rear left. `surge` and `sway` in N, `yaw` in N m along
    FRD. `lever` in m is the distance from each line of thrust to the vertical axis, (x + y) / sqrt(2) for a
    thruster at (x, y): a true moment arm, where (13) has R (tan a + 1) / tan a. Its patterns of signs are those of
    (13), its thrusters 1 to 4 being rear right, rear left, front right and front left.

    The three patterns are orthogonal to each other, so it equals the pseudo-inverse for this arrangement. For
    levers that differ front and rear (BlueROV2: 0.164 and 0.171 m) it does not: a sway force then turns the
    vehicle, 5 N m for each kN. It has no limits and no other thrusters; `Allocator` has.
    """
    x, y, n = surge / sqrt(8.0), sway / sqrt(8.0), yaw / (4.0 * lever)
    return x - y - n, x + y + n, x + y - n, x - y + n
