"""A real Prometheus server reads the figures of a real slave."""

import json
import shutil
import subprocess
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from hil.client.client import VehicleClient
from hil.common.ports import free_ports
from hil.gateways.prometheus import METRICS
from tests.support.processes import Program, command_until, wait_for, write_scenario

NOT_EVERYWHERE = ("temperature_celsius",)  # sensors of a board that a virtual machine lacks

pytestmark = pytest.mark.skipif(not shutil.which("prometheus"), reason="needs prometheus, which .ci/run installs")


def test_every_figure_has_an_answer(tmp_path: Path) -> None:
    path, port = write_scenario(tmp_path)
    (serving,) = free_ports(1)
    with Program(tmp_path, "slave", path) as vehicle:
        vehicle.expect("ready")
        with Program(tmp_path, "top", "--connect", f"tcp/127.0.0.1:{port}", "--prometheus", "0") as top:
            address = top.expect(r"serving http://(127.0.0.1:\d+)/metrics").group(1)
            server = start_server(tmp_path, serving, address)
            try:
                assert wait_for(lambda: answers(serving, "uuv_hil_cpu_share") and uptime(serving) > 2), server.args
                queries = [f'uuv_hil_{name}{{node="uuv1"}}' for name in ("up", "cpu_share", *METRICS)]
                with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1") as client:  # clocks are compared with a master's
                    silent = [
                        text
                        for text in queries
                        if not any(name in text for name in NOT_EVERYWHERE)
                        and not command_until(lambda text=text: answers(serving, text), client)  # type: ignore[misc]
                    ]
            finally:
                server.terminate()
                server.wait(60)
    assert silent == []


def start_server(folder: Path, port: int, target: str) -> subprocess.Popen[bytes]:
    scrape = {"job_name": "uuv-hil", "scrape_interval": "1s", "static_configs": [{"targets": [target]}]}
    config = folder / "prometheus.yml"  # JSON is YAML
    config.write_text(json.dumps({"scrape_configs": [scrape]}))
    return subprocess.Popen(
        ["prometheus", f"--config.file={config}", f"--storage.tsdb.path={folder / 'data'}",
         f"--web.listen-address=127.0.0.1:{port}"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def answers(port: int, query: str) -> list[Any]:
    """Return the server's results of a query; nothing while it starts."""
    text = urllib.parse.urlencode({"query": query})
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/api/v1/query?{text}", timeout=60) as answer:
            return list(json.load(answer)["data"]["result"])
    except OSError:
        return []


def uptime(port: int) -> int:
    """Return how many times the server has read the figures."""
    found = answers(port, "count_over_time(uuv_hil_up[5m])")
    return int(found[0]["value"][1]) if found else 0
