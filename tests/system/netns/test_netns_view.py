"""The live view between two machines over 20 Mbit/s, with a seabed of 1,000 x 1,000 nodes."""

import re
import time
from contextlib import closing
from pathlib import Path

import pytest

from tests.support.busy import retried_when_busy
from tests.support.clients.view_client import ADDRESS
from tests.system.netns.network import Lines, Network
from tools.costs.view_cost import MAX_LATENCY_MS, SCENARIO, WORLD

pytest.importorskip("viser", reason="the live view needs the extra view")
pytestmark = [pytest.mark.netns, pytest.mark.timeout(300)]

MBIT_S = 20.0
SETTLE_S, SECONDS = 15.0, 10.0


@retried_when_busy("a latency of tens of ms")
def test_a_sample_is_shown_within_60_ms(tmp_path: Path) -> None:
    world, scenario = tmp_path / "wide.toml", tmp_path / "scenario.toml"
    world.write_text(WORLD, encoding="utf-8")
    listening = '[slave]\nlisten = "tcp/0.0.0.0:7447"\n'
    scenario.write_text(SCENARIO.format(world=world) + listening, encoding="utf-8")
    with (
        Network("boat", "shore") as network,
        closing(Lines(tmp_path / "slave")) as slave,
        closing(Lines(tmp_path / "view")) as view,
        closing(Lines(tmp_path / "shore")) as shore,
    ):
        network.slow("shore", MBIT_S)
        boat, began = network.address("boat"), time.monotonic()
        network.start("boat", "-m", "hil.cli", "slave", scenario, output=slave.file)
        slave.first("ready", began, 60)
        command = ("-m", "hil.cli", "view", "--scenario", scenario, "--connect", "tcp/127.0.0.1:7447")
        network.start("boat", *command, "--listen", "0.0.0.0:7480", "--no-browser", output=view.file)
        view.first("watch at", began, 60)
        found = next(match for _, line in view.seen if (match := re.search(ADDRESS, line)))
        counting = ("-m", "tests.system.netns.view_latency", f"tcp/{boat}:7447", f"http://{boat}:7480/", found[2])
        network.start("shore", *counting, 1, SETTLE_S, SECONDS, output=shore.file)
        shore.first("latency", began, 120)
        line = next(line for _, line in shore.seen if "latency" in line)
    print(line)
    _, middle, _, _, updates, *_ = line.split()
    assert float(middle) < MAX_LATENCY_MS
    assert float(updates) > 10.0
