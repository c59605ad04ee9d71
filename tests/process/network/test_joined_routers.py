"""Joined routers of two sites: a client behind one commands a slave behind the other."""

import signal
from pathlib import Path

from hil.client.client import VehicleClient
from hil.network.settings import Network
from tests.support.processes import Program, command_until, free_port, surge_of, wait_for, write_scenario


def test_a_slave_behind_another_router_is_commanded(tmp_path: Path) -> None:
    near, far = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(f'{scenario.read_text()}\n[network]\nmode = "routed"\nrouter = "{far}"\n')
    network = Network(mode="routed", router=near)
    with (
        # The one that connects is there first: it tries until the other is there.
        Program(tmp_path, "router", "--listen", near, "--connect", far) as joined,
        VehicleClient(_served(joined, near), "uuv1", network=network) as client,
    ):
        assert not client.received["odom"]
        with Program(tmp_path, "router", "--listen", far) as router, Program(tmp_path, "slave", scenario) as slave:
            assert wait_for(lambda: client.received["odom"]), f"{router.output}{joined.output}{slave.output}"
            assert command_until(lambda: surge_of(client) > 0.05, client)
            assert router.stop(signal.SIGKILL)
            assert joined.process.poll() is None, joined.output


def _served(router: Program, endpoint: str) -> str:
    router.expect("forwarding between all")
    return endpoint
