"""Access control by certificates through a router, with real processes: who may command, and reasons for refusals."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from hil.commands.keys import add_machine, init
from hil.common.errors import NetworkError
from hil.network.roles import open_client_session, open_master_session
from hil.ros import graph
from hil.scenario.config import Scenario, load_scenario
from tests.support.processes import Program, command_until, free_port, surge_of, wait_for, write_scenario

MACHINES = ("uuv1", "laptop", "viewer", "outsider", "hub")
SECTIONS = """
[network]
mode = "routed"
router = "{endpoint}"
[security]
slave = "keys/uuv1"
master = "{master}"
router = "keys/hub"
may_command = ["laptop"]
may_listen = ["viewer"]
"""


class Site(NamedTuple):
    """A router, a slave that connects to it, and clients of both."""

    folder: Path
    endpoint: str
    router: Program
    slave: Program

    def scenario(self, master: str) -> Scenario:
        return load_scenario(str(self.folder / f"{Path(master).name or 'none'}.toml"))

    def client(self, master: str) -> VehicleClient:
        scenario = self.scenario(master)
        return VehicleClient(self.endpoint, "uuv1", network=scenario.network, security=scenario.security)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("site")
    init(str(folder / "keys"))
    init(str(folder / "other"))
    for name in MACHINES:
        add_machine(str(folder / "keys"), name, ["localhost"])
    add_machine(str(folder / "other"), "foreigner", ["localhost"])
    scenario, _ = write_scenario(folder)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    for master in ("keys/laptop", "keys/viewer", "keys/outsider", "other/foreigner"):
        text = scenario.read_text() + SECTIONS.format(endpoint=endpoint, master=master)
        (folder / f"{Path(master).name}.toml").write_text(text)
    (folder / "none.toml").write_text(
        scenario.read_text() + SECTIONS.format(endpoint=endpoint, master="").split("[sec")[0]
    )
    with (
        Program(folder, "router", "--scenario", folder / "laptop.toml", "--listen", endpoint) as router,
        Program(folder, "slave", folder / "laptop.toml") as slave,
    ):
        router.expect("connected: uuv1")
        yield Site(folder, endpoint, router, slave)
    assert "Traceback" not in router.output + slave.output


def test_a_permitted_master_commands_through_the_router(site: Site) -> None:
    with site.client("keys/laptop") as laptop:
        assert laptop.wait_for_vehicle(60)
        assert command_until(lambda: len(laptop.delays) > 50, laptop, surge=0.4)
        assert command_until(lambda: abs(surge_of(laptop) - 0.4) < 0.15, laptop, surge=0.4)
        assert laptop.refusal() == ""
        assert laptop.diagnostics().may_command == ("laptop",)
    site.router.expect("connected: laptop, uuv1")


def test_a_listener_receives_but_cannot_command(site: Site) -> None:
    with site.client("keys/viewer") as viewer:
        assert viewer.wait_for_vehicle(60)
        assert wait_for(lambda: viewer.received["diagnostics"] > 2), "the laptop's last message is counted by then"
        before = viewer.diagnostics().commands_received
        for _ in range(60):
            viewer.command(VelocityCommand(surge=0.4))
            time.sleep(0.02)
        seen = viewer.received["diagnostics"]
        assert wait_for(lambda: viewer.received["diagnostics"] > seen + 1)
        assert viewer.diagnostics().commands_received == before
        assert "may_command" in viewer.refusal()


def test_a_machine_without_rights_receives_nothing(site: Site) -> None:
    with site.client("keys/outsider") as outsider:
        assert not outsider.wait_for_vehicle(1.0)
        assert not outsider.contact.present


def test_listeners_receive_liveliness_tokens(site: Site) -> None:
    scenario = site.scenario("keys/viewer")
    with open_client_session(site.endpoint, scenario.network, scenario.security, seconds=3.0) as client:
        assert wait_for(lambda: any("uuv1%cmd_vel" in key for key in client.tokens(graph.ALL)))


@pytest.mark.parametrize(
    ("master", "messages"),
    [("other/foreigner", ["not of the authority", "ca.pem"]), ("", ["wants a certificate", "[security]"])],
)
def test_a_wrong_or_missing_certificate_is_refused_with_a_reason(
    site: Site, master: str, messages: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil.network.settings.ROUTER_WAIT_MS", 700)
    scenario = site.scenario(master)
    with pytest.raises(NetworkError) as caught:
        open_master_session(site.endpoint, network=scenario.network, security=scenario.security)
    assert all(message in str(caught.value) for message in (site.endpoint, *messages)), str(caught.value)
    with pytest.raises(NetworkError) as caught:
        open_client_session(site.endpoint, scenario.network, scenario.security, seconds=0.2)
    assert all(message in str(caught.value) for message in (site.endpoint, *messages)), str(caught.value)


def test_commands_report_a_foreign_certificate(site: Site) -> None:
    scenario = site.folder / "foreigner.toml"
    options = ("--connect", site.endpoint, "--output", site.folder / "run")
    asking = ("list", "--connect", site.endpoint, "--scenario", scenario, "--wait", 0.3)
    with (
        Program(site.folder, "master", scenario, *options) as master,
        Program(site.folder, "topic", *asking) as topic,
    ):
        assert (master.wait(), topic.wait()) == (4, 4)
    for program in (master, topic):
        assert "not of the authority" in program.output
        assert "Traceback" not in program.output


def test_a_slave_with_a_foreign_certificate_is_refused_and_reports_it(site: Site, tmp_path: Path) -> None:
    text = (site.folder / "laptop.toml").read_text().replace('"keys/uuv1"', f'"{site.folder}/other/foreigner"')
    text = text.replace('"keys/', f'"{site.folder}/keys/').replace("listen = ", 'node = "uuv9"\nlisten = ', 1)
    port = free_port()
    lines = [f'listen = "tcp/127.0.0.1:{port}"' if line.startswith("listen") else line for line in text.splitlines()]
    (tmp_path / "foreign.toml").write_text("\n".join(lines))
    with Program(tmp_path, "slave", tmp_path / "foreign.toml") as slave:
        slave.expect("ready")
        slave.expect("not of the authority")
        assert "foreigner" not in site.router.output
