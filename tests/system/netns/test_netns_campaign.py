"""Campaigns with workers on two other machines give the same rows as on one machine."""

import time
from contextlib import ExitStack, closing
from pathlib import Path
from secrets import token_hex

import pytest

from tests.support.processes import write_scenario
from tests.system.netns.network import Lines, Network

pytestmark = [pytest.mark.netns, pytest.mark.cluster, pytest.mark.timeout(600)]

START_S = 240.0  # for engines to start, run and end, whatever else the machine does
WORKERS = ("boat", "pier")
CAMPAIGN = """
import os, sys
os.environ.update({environment!r})
from hil.cli import main
code = main(["campaign", {scenario!r}, "--seeds", "4", "--backend", {backend!r}, "-o", {output!r}])
print("ended with", code)
"""
DASK_PORT, RAY_PORT = 8786, 6379
RAY = ("-m", "ray.scripts.scripts", "start", "--block", "--disable-usage-stats")


@pytest.fixture(autouse=True)
def requires_marker(request: pytest.FixtureRequest) -> None:
    if "cluster" not in str(request.config.option.markexpr):
        pytest.skip("starts clusters, for a minute: pytest -m cluster")


class Cluster:
    """A desk and two worker machines; the output of each process is a file in the folder."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self.network = stack.enter_context(Network("desk", *WORKERS))
        self.desk = self.network.address("desk")
        self._stack, self._folder = stack, folder

    def start(self, machine: str, *words: object, until: str) -> None:
        """Start a program there, and wait until it prints `until`."""
        lines = self._stack.enter_context(closing(Lines(self._folder / f"{len(list(self._folder.iterdir()))}.log")))
        began = time.monotonic()
        self.network.start(machine, *words, output=lines.file)
        lines.first(until, began, START_S)

    def campaign(self, scenario: Path, backend: str, environment: dict[str, str]) -> str:
        """Run a campaign at the desk; return its rows."""
        output = self._folder / f"{backend}.csv"
        code = CAMPAIGN.format(scenario=str(scenario), backend=backend, output=str(output), environment=environment)
        self.start("desk", "-c", code, until="ended with 0")
        return output.read_text()


def test_dask_workers_on_other_machines_give_the_same_rows(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    with ExitStack() as stack:
        cluster = Cluster(stack, tmp_path)
        here = f"--host {cluster.desk} --port {DASK_PORT} --no-dashboard".split()
        cluster.start("desk", "-m", "dask", "scheduler", *here, until="Scheduler at")
        address = f"tcp://{cluster.desk}:{DASK_PORT}"
        for machine in WORKERS:
            own = f"--nthreads 1 --no-dashboard --local-directory {tmp_path / machine}".split()
            cluster.start(machine, "-m", "dask", "worker", address, *own, until="Registered to")
        rows = cluster.campaign(scenario, "dask", {"DASK_SCHEDULER_ADDRESS": address})
        assert rows.count("\n") == 5
        assert rows == cluster.campaign(scenario, "loky", {})


def test_ray_workers_on_other_machines_give_the_same_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cluster needs a token, and all runs are on the other machines, as the desk offers no processor."""
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    monkeypatch.setenv("RAY_AUTH_TOKEN", token_hex(32))
    scenario, _ = write_scenario(tmp_path)
    with ExitStack() as stack:
        cluster = Cluster(stack, tmp_path)
        address = f"{cluster.desk}:{RAY_PORT}"
        head = f"--head --node-ip-address={cluster.desk} --port={RAY_PORT} --num-cpus=0 --include-dashboard=false"
        cluster.start("desk", *RAY, *head.split(), until="Ray runtime started")
        for machine in WORKERS:
            own = f"--address={address} --num-cpus=1 --node-ip-address={cluster.network.address(machine)}".split()
            cluster.start(machine, *RAY, *own, until="Ray runtime started")
        rows = cluster.campaign(scenario, "ray", {"RAY_ADDRESS": address})
        assert rows.count("\n") == 5
        assert rows == cluster.campaign(scenario, "loky", {})
