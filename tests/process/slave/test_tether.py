"""The tether of a real slave: its line on the network, in the live view and in plots."""

import time
from pathlib import Path

import pytest

from hil.client.client import VehicleClient
from hil.network.roles import open_master_session
from hil.plots.run_data import collect
from hil.recording.mcap_file import Message
from hil.ros.plan import encode_plan
from tests.support.processes import Program, write_scenario

TETHER = '[tether]\nlength = "12 m"\nanchor = [0.0, 0.0, 0.0]\nsegments = 6\n'


def test_a_slave_publishes_the_line_of_its_tether(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    with scenario.open("a") as file:
        file.write(TETHER)
    with (
        Program(tmp_path, "slave", scenario),
        open_master_session(f"tcp/127.0.0.1:{port}") as session,
        VehicleClient(session, "uuv1") as client,
    ):
        assert client.wait_for_vehicle(60)
        client.watch("tether", "ground_truth")
        until = time.monotonic() + 30.0
        while not (client.latest.get("tether") and client.latest.get("ground_truth")):
            assert time.monotonic() < until
            time.sleep(0.05)
        line, truth = client.latest["tether"].value, client.latest["ground_truth"].value
    assert len(line) == 7
    assert line[0] == (0.0, 0.0, 0.0)
    assert line[-1] == pytest.approx(truth.position, abs=0.5)


def test_plots_have_the_last_line_of_the_tether() -> None:
    lines = [((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)), ((0.0, 0.0, 0.0), (4.0, 5.0, 6.0))]
    messages = [
        Message("/uuv1/tether", "nav_msgs/msg/Path", k, k, k, encode_plan(k, line, 0.0))
        for k, line in enumerate(lines, 1)
    ]
    assert collect(messages, "a.mcap")["uuv1"].tether == lines[1]


class _Truth:
    position, orientation = (4.0, 0.0, 5.0), (1.0, 0.0, 0.0, 0.0)
