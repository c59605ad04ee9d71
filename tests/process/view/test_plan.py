"""The plan that one client of a slave publishes reaches the live view, another client."""

from pathlib import Path
from typing import Any

from hil.client.client import VehicleClient
from hil.ros.plan import encode_plan
from hil.view.sources.live import LiveSource
from tests.support.processes import Program, wait_for, write_scenario


def arrives(master: VehicleClient, payload: bytes, source: LiveSource) -> Any:
    """Publish a plan, as a mission does repeatedly because it is not latched; return the plan that the view has."""
    master.publish("plan", payload)
    return source.latest("uuv1").get("plan")


def test_the_view_has_the_newest_plan_of_another_client(tmp_path: Path) -> None:
    path, port = write_scenario(tmp_path)
    endpoint = f"tcp/127.0.0.1:{port}"
    plans = ((1.0, 2.0, 0.5), (3.0, 4.0, 0.5)), ((1.0, 2.0, 0.5), (5.0, 6.0, 0.5), (7.0, 8.0, 0.5))
    with (
        Program(tmp_path, "slave", path),
        VehicleClient(endpoint, "uuv1") as master,
        LiveSource([endpoint], observe=True) as source,
    ):
        assert wait_for(lambda: source.names == ["uuv1"])
        for plan in plans:
            payload = encode_plan(1, plan, 0.5)
            assert wait_for(lambda: arrives(master, payload, source) == plan), source.latest("uuv1")  # noqa: B023
