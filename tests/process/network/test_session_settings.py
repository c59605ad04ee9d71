"""Settings of a session, its errors, and discovery."""

import os
import socket
import stat
from pathlib import Path

import pytest

from hil.commands.keys import add_machine, init, main
from hil.common.errors import ConfigError, NetworkError
from hil.network.discovery import find
from hil.network.opening import listen
from hil.network.responder import answer_searches
from hil.network.security import Security
from hil.network.settings import BATCH, PINGS, Network, endpoints, settings
from hil.network.tokens import Presence, Role, clock_keys, presence_key, read_presence
from hil.scenario.config import load_scenario
from tests.support.network.multicast import require_multicast
from tests.support.processes import Program, free_port, wait_for, write_scenario


def test_an_endpoint_is_two_links_by_priority() -> None:
    urgent, rest = endpoints("tcp/10.0.0.1:7447")
    assert urgent.startswith("tcp/10.0.0.1:7447?prio=1-3#so_sndbuf=")
    assert rest.startswith("tcp/10.0.0.1:7448?prio=4-7#so_sndbuf=")
    assert endpoints("tcp/[::1]:7447", secure=True)[0].startswith("tls/[::1]:7447?")
    (only,) = endpoints("tcp/10.0.0.1:7447", one=True)
    assert only.startswith("tcp/10.0.0.1:7447#so_sndbuf=")


@pytest.mark.parametrize("number", [0, 1])
def test_a_port_in_use_is_reported_with_its_likely_owner(number: int) -> None:
    """The port is in use at all IPv4 and IPv6 addresses, as rmw_zenohd uses it."""
    port = free_port()
    with (
        socket.create_server(("::", port + number), family=socket.AF_INET6, dualstack_ipv6=True),
        pytest.raises(NetworkError, match=f"port {port + number} is in use.*rmw_zenohd.*--listen"),
    ):
        listen(f"tcp/127.0.0.1:{port}")


def test_settings_reach_the_library() -> None:
    network = Network(lease=2.5, retry=0.2, open_timeout=0.7)
    text = settings("master", (), ("tcp/10.0.0.1:7447",), network, None)
    for message in (
        "'lease':2500",
        "'period_max_ms':200",
        "'open_timeout':700",
        f"'batch_size':{BATCH}",
        "'mode':'peer'",
    ):
        assert message in text
    routed = Network(mode="routed", router="tcp/10.0.0.9:7447")
    assert "'mode':'client'" in settings("master", (), ("tcp/10.0.0.9:7447",), routed, None)


def test_a_listening_slave_limits_the_pings_of_observers() -> None:
    routed = Network(mode="routed", router="tcp/10.0.0.9:7447")
    endpoints = ("tcp/10.0.0.1:7447",)
    bound = f"'downsampling':[{{'messages':['put','delete'],'flows':['ingress'],'rules':[{{'key_expr':'{PINGS}'"
    assert bound in settings("slave", endpoints, (), Network(), None)
    assert "downsampling" not in settings("slave", endpoints, (routed.router,), routed, None)
    assert clock_keys("*")[0] == PINGS


def test_gossip_is_on_only_for_roles_that_need_it(tmp_path: Path) -> None:
    """ROS 2 contexts find each other by gossip; it is off under TLS and for clients that only listen."""
    endpoints = ("tcp/10.0.0.1:7447",)
    reported = (
        "'gossip':{'enabled':true,'multihop':false,'target':{'router':['router','peer']},'autoconnect':{'router':[]}}"
    )
    roles: tuple[Role, ...] = ("slave", "router", "master", "client", "imaging")
    for role in roles:
        text = settings(role, endpoints, (), Network(), None)
        assert (reported in text) == (role in ("slave", "router")), role
        assert "'multicast':{'enabled':false}" in text, "multicast connects no session by itself"
    init(str(tmp_path / "keys"))
    for name in ("uuv1", "hub"):
        add_machine(str(tmp_path / "keys"), name, [])
    security = Security(f"{tmp_path}/keys/uuv1", "", ("laptop",), router=f"{tmp_path}/keys/hub")
    hosts: tuple[Role, ...] = ("slave", "router")
    for role in hosts:
        assert "'gossip':{'enabled':false}" in settings(role, ("tls/10.0.0.1:7447",), (), Network(), security)


def test_presence_keys_are_decoded() -> None:
    presence = Presence("uuv1", "master", 3, "ab" * 16, "my host/é*:7")
    assert read_presence(presence_key(presence)) == presence._replace(process="my_host___:7")
    for key in (
        "uuv_hil/uuv1/alive/master/3/zz/x",
        "uuv_hil/uuv1/alive/cook/3/ab/x",
        "uuv_hil/uuv1/alive/master/11/ab/x",
        f"uuv_hil/uuv1/alive/master/{'1' * 5000}/ab/x",  # more than int() reads
        "a",
    ):
        assert read_presence(key) is None


def test_multicast_finds_only_slaves_with_discovery() -> None:
    require_multicast()
    hidden, shown = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with listen(hidden), listen(shown) as session:
        answer_searches(session, shown, Network(), is_secure=False)
        assert wait_for(lambda: shown in find(0.3))
        assert hidden not in find(0.3)


def test_a_mission_finds_its_slave_by_multicast(tmp_path: Path) -> None:
    require_multicast()
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text() + "[network]\ndiscovery = true\n")
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        with Program(tmp_path, "master", scenario, "--connect", "lan", "--output", tmp_path / "run") as master:
            master.expect("flying|several slaves answered")  # another slave on this machine may answer too
    assert load_scenario(str(scenario)).network.discovery


def test_keys_are_private_and_never_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "keys")
    assert main(["--dir", folder, "init"]) == 0
    assert main(["--dir", folder, "add", "uuv1", "--host", "10.0.0.1", "--host", "uuv1.local"]) == 0
    assert f"{folder}/uuv1" in capsys.readouterr().out
    for root, _, files in os.walk(folder):
        for name in files:
            assert stat.S_IMODE(os.stat(os.path.join(root, name)).st_mode) == 0o600
    assert sorted(os.listdir(f"{folder}/uuv1")) == ["ca.pem", "cert.pem", "key.pem"]
    with pytest.raises(ConfigError, match="exists already"):
        add_machine(folder, "uuv1", [])
    with pytest.raises(ConfigError, match="invalid"):
        init(folder)
    with pytest.raises(ConfigError, match="keys init"):
        add_machine(str(tmp_path), "uuv1", [])
    for name in ("", "..", "a/b", "authority", 65 * "a"):
        with pytest.raises(ConfigError, match="name"):
            add_machine(folder, name, [])
    with pytest.raises(ConfigError, match="neither an address nor a name"):
        add_machine(folder, "uuv2", ["ü"])
    assert len(os.listdir(add_machine(folder, 64 * "a", []))) == 3
