"""A client of the JSON gateway whose machine is disconnected silently: its vehicle stops."""

import json
import time
from contextlib import closing
from pathlib import Path

import pytest

from hil.gateways.json_lines.connection import LOST_S
from tests.support.output_lines import Lines
from tests.support.processes import write_scenario
from tools.faults.spaces import Network

pytestmark = pytest.mark.netns

PORT, LINES_PORT = 7447, 7450
NOTICED_S = 1.0  # by the kernel's timers, which are coarse
STOPPED_S = 1.5  # from 0.4 m/s

CLIENT = """
import json, socket
from hil.gateways.access import token_path
lines = socket.create_connection(("{host}", {port})).makefile("rw")
with open(token_path({port})) as file:
    print(json.dumps({{"do": "login", "token": file.read().strip()}}), file=lines, flush=True)
for request in {requests}:
    print(request, file=lines, flush=True)
for line in lines:
    print(line, end="", flush=True)
"""
DRIVE, SUBSCRIBE = '{"do": "drive", "surge": 0.4}', '{"do": "subscribe", "sensor": "state", "rate": 20}'


@pytest.mark.parametrize("requests", [(DRIVE,), (SUBSCRIBE, DRIVE)], ids=["silent", "listening"])
def test_the_vehicle_stops_when_the_machine_of_its_client_is_disconnected(
    requests: tuple[str, ...], tmp_path: Path
) -> None:
    scenario, _ = write_scenario(tmp_path, allow="", port=PORT)
    with (
        Network("boat", "shore") as network,
        closing(Lines(tmp_path / "slave")) as slave,
        closing(Lines(tmp_path / "gateway")) as gateway,
        closing(Lines(tmp_path / "watch")) as watch,
        closing(Lines(tmp_path / "shore")) as shore,
    ):
        command = f"-m hil.cli gateway --connect tcp/127.0.0.1:{PORT} --listen 0.0.0.0:{LINES_PORT}".split()
        watching = CLIENT.format(host="127.0.0.1", port=LINES_PORT, requests=(SUBSCRIBE,))
        driving = CLIENT.format(host=network.address("boat"), port=LINES_PORT, requests=requests)
        began = time.monotonic()
        network.start("boat", "-m", "hil.cli", "slave", scenario, output=slave.file)
        slave.first("ready", began, 60)
        network.start("boat", *command, output=gateway.file)
        gateway.first("lines of JSON", began, 60)
        network.start("boat", "-c", watching, output=watch.file)
        network.start("shore", "-c", driving, output=shore.file)
        shore.first('"ok": true', began, 60)
        time.sleep(1.0)
        network.unplug("shore")
        time.sleep(LOST_S + NOTICED_S + STOPPED_S)
        speeds = [json.loads(line)["sample"]["nu"][0] for _, line in watch.seen if "sample" in line]
    print([round(speed, 2) for speed in speeds[::10]])
    assert max(speeds) > 0.3
    assert abs(speeds[-1]) < 0.05
