"""Endpoints to which a command connects."""

from pathlib import Path

import pytest

from hil.commands.listening import (
    ConnectArguments,
    add_connect,
    add_fleet,
    add_settings,
    connect_arguments,
    scenario_and_endpoints,
)
from hil.common.errors import ConfigError
from hil.common.options import LOCAL_SLAVE, new_parser
from tests.support.processes import write_scenario

ROUTER = '[network]\nmode = "routed"\nrouter = "tcp/127.0.0.1:7448"\n'


def scenario(folder: Path, extra_keys: str = "") -> tuple[str, int]:
    path, port = write_scenario(folder)
    path.write_text(path.read_text() + extra_keys)
    return str(path), port


def endpoints_of(*arguments: str) -> list[str]:
    parser = new_parser("x", "", "")
    add_connect(parser)
    add_settings(parser)
    return scenario_and_endpoints(parser.parse_args(arguments))[1]


def test_a_scenario_gives_the_endpoint_of_its_slave(tmp_path: Path) -> None:
    path, port = scenario(tmp_path)
    assert endpoints_of("--scenario", path) == [f"tcp/127.0.0.1:{port}"]


def test_a_scenario_with_a_router_gives_the_routers_endpoint(tmp_path: Path) -> None:
    path, _ = scenario(tmp_path, ROUTER)
    assert endpoints_of("--scenario", path) == ["tcp/127.0.0.1:7448"]


def test_the_connect_option_overrides_the_scenario(tmp_path: Path) -> None:
    path, _ = scenario(tmp_path, ROUTER)
    assert endpoints_of("--scenario", path, "--connect", "10.0.0.1") == ["tcp/10.0.0.1:7447"]
    assert endpoints_of() == [LOCAL_SLAVE]


def test_a_fleet_without_a_router_gives_its_vehicles_endpoints() -> None:
    with pytest.raises(ConfigError, match="--connect"):
        endpoints_of("--scenario", "target_hunting")


def reach(*arguments: str) -> ConnectArguments:
    parser = new_parser("x", "", "")
    add_fleet(parser)
    return connect_arguments(parser.parse_args(arguments))[1]


def test_a_fleets_endpoint_is_the_option_or_else_the_scenarios(tmp_path: Path) -> None:
    path, port = scenario(tmp_path, '[security]\nslave = "keys/rov"\nmaster = "keys/base"\nmay_command = ["base"]\n')
    assert reach() == ConnectArguments([LOCAL_SLAVE], routed=False, keys="")
    assert reach("--routed", "--keys", "mine") == ConnectArguments([LOCAL_SLAVE], routed=True, keys="mine")
    own = reach("--scenario", path)
    assert (own.endpoints, own.routed) == ([f"tcp/127.0.0.1:{port}"], False)
    assert own.keys == str(tmp_path / "keys" / "base")
    assert reach("--scenario", path, "--keys", "mine").keys == "mine"
    routed, _ = scenario(tmp_path, ROUTER)
    assert reach("--scenario", routed) == ConnectArguments(["tcp/127.0.0.1:7448"], routed=True, keys="")
