"""Thousands of subscriptions by an observer delay the network, but not the loop."""

import socket
import time
from pathlib import Path

import zenoh

from hil.client.client import VehicleClient
from hil.network.roles import open_client_session
from hil.ros.diagnostics import Diagnostics, or_nan
from tests.support.busy import retried_when_busy
from tests.support.processes import Program, wait_for, write_scenario

SUBSCRIPTIONS = 5000
TIMES = 1  # more show the same and take longer
LATE_SHARE = 0.01  # of the steps, more than 2 ms late: less than half of what it was, ten times a quiet machine's
QUIET_S = 2.0
SETTLED_S = 0.5  # in which the slave takes up most of what was declared


def steps(figures: Diagnostics) -> tuple[float, float]:
    """Return how many steps there were, and how many of them were late."""
    count = or_nan(figures.uptime_s) * or_nan(figures.loop_rate_hz)
    return count, (1.0 - or_nan(figures.within_2ms)) * count


def next_figures(client: VehicleClient) -> Diagnostics:
    """Return the diagnostics after the next, whose period began after this call."""
    for _ in range(2):
        before = client.received["diagnostics"]
        assert wait_for(lambda: client.received["diagnostics"] > before)  # noqa: B023
    return client.diagnostics()


def late_share(before: Diagnostics, after: Diagnostics) -> float:
    """Return the share of late steps between two diagnostics."""
    (count, late), (count_after, late_after) = steps(before), steps(after)
    return max(0.0, late_after - late) / (count_after - count)


def attack(endpoint: str) -> None:
    """Subscribe to thousands of keys, and leave."""
    with open_client_session(endpoint, seconds=60.0) as session:
        keys = [f"0/uuv1/imu/{number}/**" for number in range(SUBSCRIPTIONS)]
        held = [session._session.declare_subscriber(key, zenoh.handlers.RingChannel(1)) for key in keys]
        assert len(held) == SUBSCRIPTIONS
        time.sleep(SETTLED_S)


@retried_when_busy("lateness of a loop, while other processes want the processor too")
def test_the_loop_is_on_time_during_thousands_of_subscriptions(tmp_path: Path) -> None:
    """The loop used to be late by up to a second."""
    with socket.socket(type=socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        # No pty: there the loop would also wait for threads of the kernel, which others keep from a processor.
        link = f'port = "udp://127.0.0.1:{silent.getsockname()[1]}"'
        scenario, port = write_scenario(tmp_path, 'stm32 = "device"', link=link)
        quiet_share, share = late_shares(tmp_path, scenario, f"tcp/127.0.0.1:{port}")
    assert share <= LATE_SHARE + 2.0 * quiet_share


def late_shares(folder: Path, scenario: Path, endpoint: str) -> tuple[float, float]:
    """Return the share of late steps in a quiet time, and under attack."""
    with (
        Program(folder, "slave", scenario) as slave,
        VehicleClient(endpoint, "uuv1", role="observer") as client,
    ):
        slave.expect("idle processors")  # its start is over
        quiet = next_figures(client)
        time.sleep(QUIET_S)
        before = next_figures(client)
        for _ in range(TIMES):
            attack(endpoint)
        after = next_figures(client)
        samples = client.received["imu"]
        assert wait_for(lambda: client.received["imu"] > samples), "samples still come"
    return late_share(quiet, before), late_share(before, after)
