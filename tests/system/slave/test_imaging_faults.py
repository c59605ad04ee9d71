"""A slave whose imaging process is slow or killed: the loop continues at its rate."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.client.client import VehicleClient
from hil.ros.diagnostics import or_nan
from tests.support.clients.imaging_slave import camera, has_all, kill_and_wait, newest, start, wait_for, watched_slave
from tests.support.processes import Program


@pytest.fixture
def slave(tmp_path: Path) -> Iterator[tuple[Program, VehicleClient]]:
    with watched_slave(tmp_path) as watched:
        yield watched


def steps_skipped_by_a_kill(program: Program, client: VehicleClient, restarts: int) -> float:
    """Kill the imaging process and wait for the next one's pictures; return the steps that the loop skipped per second.

    A loop that waited half a second for the restart would skip some 12 of 100.
    """
    began = time.monotonic()
    then, now = kill_and_wait(program, client, restarts)
    return (or_nan(now.steps_skipped) - or_nan(then.steps_skipped)) / (time.monotonic() - began)


def test_a_slow_imaging_process_drops_pictures_without_slowing_the_loop(tmp_path: Path) -> None:
    program, endpoint = start(tmp_path, "[sensors.camera]\nrate = 50\nwidth = 1200\nheight = 900\ndepth = false\n")
    with program, VehicleClient(endpoint, "uuv1") as client:
        assert wait_for(client.diagnostics)
        calm = max(or_nan(newest(client).real_time_factor) for _ in range(2))
        client.watch("camera/camera_info")
        assert wait_for(lambda: client.received["camera/camera_info"] > 2)
        assert wait_for(lambda: camera(client, "dropped") > 10)
        assert wait_for(lambda: camera(client, "took_ms") > 20.0)
        assert wait_for(lambda: or_nan(client.diagnostics().real_time_factor) > 0.7 * calm), "it waits for none"
        assert camera(client, "requested") > camera(client, "dropped")


def test_the_loop_continues_while_a_killed_imaging_process_is_restarted(slave: tuple[Program, VehicleClient]) -> None:
    program, client = slave
    assert wait_for(lambda: has_all(client)), client.received
    skipped = [steps_skipped_by_a_kill(program, client, number) for number in (1, 2, 3)]
    assert min(skipped) <= 5, "other programs may delay the loop at the same time, but hardly each time"
