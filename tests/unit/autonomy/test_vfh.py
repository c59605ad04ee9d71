"""VFH+ against cases worked by hand, and properties that hold for any scan."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.control.controller import wrap
from hil.autonomy.paths.vfh import Scan, Vfh, VfhSettings

# 36 sectors of 10 degrees; clearance 0.5 m: at 1 m an obstacle fills asin(0.5) = 30 degrees to both sides
SETTINGS = VfhSettings(
    radius=0.3, safety=0.2, range=4.0, block_within=2.0, free_beyond=3.0, sectors=36, wide=math.radians(40.0)
)
DEGREE = math.pi / 180.0


def scan_with_echo(bearing: float, distance: float) -> Scan:
    """Return a scan all round, a beam each degree, with one echo at `bearing` in degrees from the bow."""
    return scan_with_echoes({bearing: distance})


def scan_with_echoes(ranges_by_bearing: dict[float, float]) -> Scan:
    ranges = [math.inf] * 360
    for bearing, distance in ranges_by_bearing.items():
        ranges[int(bearing + 180) % 360] = distance
    return Scan(-math.pi, DEGREE, ranges)


def blocked_sectors(vfh: Vfh) -> list[int]:
    """Return the blocked sectors in degrees from north."""
    return [10 * sector for sector, state in enumerate(vfh.blocked) if state]


def degrees(angle: float | None) -> float:
    assert angle is not None
    return angle / DEGREE


def test_open_water_leads_straight_to_the_target() -> None:
    vfh = Vfh(SETTINGS)
    assert vfh.steer(scan_with_echoes({}), 0.3, -1.2) == -1.2
    command = vfh.command(scan_with_echoes({}), 0.0, 0.3, 0.8)
    assert command.surge == pytest.approx(0.8 * math.cos(0.3))
    assert command.yaw_rate == pytest.approx(0.3)


def test_an_obstacle_is_enlarged_by_the_safety_distance() -> None:
    """An obstacle at 1 m blocks 30 degrees to both sides: sectors from 330 to 30; its magnitude is 1 - 1/16."""
    vfh = Vfh(SETTINGS)
    vfh.steer(scan_with_echo(0, 1.0 - 1e-9), 0.0, 0.0)
    assert blocked_sectors(vfh) == [0, 10, 20, 30, 330, 340, 350]
    assert vfh.density[0] == pytest.approx(15.0 / 16.0)
    assert vfh.density[4] == 0.0


def test_the_heading_lies_half_a_wide_opening_into_the_side_nearer_the_target() -> None:
    """The heading past 35 blocked degrees on either side is at 35 + 20 degrees, on the target's side."""
    for target, expected in ((10.0, 55.0), (-10.0, -55.0), (90.0, 90.0), (-170.0, -170.0)):
        vfh = Vfh(SETTINGS)
        assert degrees(vfh.steer(scan_with_echo(0, 1.0 - 1e-9), 0.0, target * DEGREE)) == pytest.approx(expected)


def test_a_narrow_opening_is_passed_in_the_middle() -> None:
    """The heading is midway between two posts at 1 m, 50 degrees to port and to starboard: three sectors are free."""
    vfh = Vfh(SETTINGS)
    heading = vfh.steer(scan_with_echoes({-50: 1.0 - 1e-9, 50: 1.0 - 1e-9}), 0.0, 8.0 * DEGREE)
    assert blocked_sectors(vfh) == [20, 30, 40, 50, 60, 70, 80, 280, 290, 300, 310, 320, 330, 340]
    assert degrees(heading) == pytest.approx(0.0)


def test_sectors_are_fixed_to_the_world() -> None:
    """A post that is seen after a turn of 70 degrees to starboard is 70 degrees to port, in the same sectors."""
    vfh = Vfh(SETTINGS)
    vfh.steer(scan_with_echo(0, 1.0 - 1e-9), 0.0, 0.0)
    before = blocked_sectors(vfh)
    vfh.steer(scan_with_echo(-70, 1.0 - 1e-9), 70.0 * DEGREE, 0.0)
    assert blocked_sectors(vfh) == before


def test_a_sector_changes_state_with_hysteresis() -> None:
    """A sector is free at 2.5 m coming near, blocked at 1.9 m and still at 2.5 m going away, and free at 3.1 m."""
    vfh, states = Vfh(SETTINGS), []
    for distance in (3.1, 2.5, 1.9, 2.5, 2.9, 3.1, 2.5):
        vfh.steer(scan_with_echo(0, distance), 0.0, 0.0)
        states.append(vfh.blocked[0])
    assert states == [False, False, True, True, True, False, False]


def test_sectors_out_of_view_keep_their_state() -> None:
    vfh = Vfh(SETTINGS)
    vfh.steer(scan_with_echo(0, 1.0), 0.0, 0.0)
    open_scan = Scan(-30.0 * DEGREE, DEGREE, [math.inf] * 61)
    vfh.steer(open_scan, math.pi, 0.0)
    assert vfh.blocked[0]
    vfh.steer(open_scan, 0.0, 0.0)
    assert not vfh.blocked[0]


def test_an_obstacle_in_the_turning_circle_blocks_that_side() -> None:
    """A post 40 degrees to starboard at 1.5 m blocks that side. The circle of 1 m to starboard has its centre at 1 m
    abeam; the post is 1.15 m from it, within 1 m + 0.5 m: no way round that side. To port all is free.
    """
    vfh = Vfh(SETTINGS._replace(turning_radius=1.0))
    heading = degrees(vfh.steer(scan_with_echo(40, 1.5), 0.0, 120.0 * DEGREE))
    assert [10 * k for k, masked in enumerate(vfh.masked) if masked] == [50, 60, 70, 80, 90, *range(100, 180, 10)]
    assert heading == pytest.approx(5.0)  # blocked from 25 degrees on, and half of the wide opening off that
    spot = Vfh(SETTINGS)
    assert degrees(spot.steer(scan_with_echo(40, 1.5), 0.0, 120.0 * DEGREE)) == pytest.approx(120.0)


def test_the_previous_heading_is_preferred_between_equal_ones() -> None:
    """A vehicle blocked ahead that once went to starboard stays there, though the target is a bit to port now."""
    scan = scan_with_echo(0, 1.0 - 1e-9)
    vfh = Vfh(SETTINGS)
    assert degrees(vfh.steer(scan, 0.0, 2.0 * DEGREE)) == pytest.approx(55.0)
    assert degrees(vfh.steer(scan, 0.0, -2.0 * DEGREE)) == pytest.approx(55.0)
    assert degrees(Vfh(SETTINGS).steer(scan, 0.0, -2.0 * DEGREE)) == pytest.approx(-55.0)


def test_the_speed_falls_with_the_free_distance_ahead() -> None:
    """The speed is full from block_within (2 m) on, zero at the clearance (0.5 m), linear between, by echoes ahead."""
    far = SETTINGS._replace(safety=0.2)
    for distance, share in ((3.5, 1.0), (2.0, 1.0), (1.25, 0.5), (0.5, 0.0), (0.4, 0.0)):
        vfh = Vfh(far)
        free = vfh.steer(scan_with_echo(0, distance), 0.0, 0.0)
        command = Vfh(far).command(scan_with_echo(0, distance), 0.0, 0.0, 0.6)
        assert free is not None
        assert command.surge == pytest.approx(0.6 * share * max(0.0, math.cos(free)), abs=1e-9)
    assert Vfh(SETTINGS).command(scan_with_echo(90, 0.6), 0.0, 0.0, 0.6).surge > 0.0


def test_obstacles_beyond_the_goal_are_ignored() -> None:
    scan = scan_with_echo(0, 1.5)
    assert Vfh(SETTINGS).steer(scan, 0.0, 0.0, reach=1.4) == 0.0
    assert Vfh(SETTINGS).steer(scan, 0.0, 0.0, reach=1.6) != 0.0


def test_an_enclosed_vehicle_turns_on_the_spot() -> None:
    ring = Scan(-math.pi, DEGREE, [1.0] * 360)
    vfh = Vfh(SETTINGS)
    assert vfh.steer(ring, 0.0, 1.0) is None
    command = vfh.command(ring, 0.0, 1.0, 0.6, max_yaw_rate=0.4)
    assert (command.surge, command.yaw_rate) == (0.0, 0.4)


DISTANCES = st.one_of(st.floats(-1.0, 8.0), st.sampled_from([math.inf, math.nan, 0.0]))
ANGLES = st.floats(-10.0, 10.0)


@given(st.lists(st.tuples(st.lists(DISTANCES, min_size=2, max_size=40), ANGLES, ANGLES), min_size=1, max_size=4))
def test_any_scan_gives_a_free_heading_and_a_command_within_limits(
    rounds: list[tuple[list[float], float, float]],
) -> None:
    vfh = Vfh(SETTINGS)
    for ranges, heading, target in rounds:
        scan = Scan(-1.5, 3.0 / len(ranges), ranges)
        command = vfh.command(scan, heading, target, 0.7, 0.5)
        assert 0.0 <= command.surge <= 0.7
        assert abs(command.yaw_rate) <= 0.5
        chosen = vfh.steer(scan, heading, target)
        if chosen is None:
            assert all(vfh.blocked)
            continue
        assert not vfh.blocked[round(chosen / (10.0 * DEGREE)) % 36]
        for angle, distance in scan.points():  # a straight path ahead keeps the clearance, to half a sector
            aside = abs(wrap(chosen - heading - angle))
            if distance < SETTINGS.block_within and aside < math.pi / 2.0:
                assert aside >= math.asin(min(1.0, 0.5 / distance)) - 5.1 * DEGREE


def test_contradicting_settings_are_refused_by_name() -> None:
    assert SETTINGS.validate() is None
    assert "must grow" in str(SETTINGS._replace(block_within=0.4).validate())
    assert "must grow" in str(SETTINGS._replace(free_beyond=1.0).validate())
