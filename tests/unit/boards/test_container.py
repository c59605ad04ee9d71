"""The containers: each command is one that the project accepts, and the services connect to each other."""

import argparse
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from hil.cli import COMMANDS, find_command
from hil.commands.completion import find_parser
from hil.common.clock import LOOP_PRIORITY
from hil.common.options import changes_of
from hil.scenario.config import load_scenario

FOLDER = Path(__file__).parents[3] / "boards" / "container"
SERVICES: dict[str, dict[str, Any]] = YAML(typ="safe").load(FOLDER / "compose.yaml")["services"]


def read_command(text: str) -> tuple[str, argparse.Namespace]:
    """Return the command's name, and its options as its own parser reads them; fail the test at an unknown word."""
    name, words = find_command(shlex.split(text))
    return name, find_parser(COMMANDS[name][0]).parse_args(words)


@pytest.mark.parametrize("service", SERVICES)
def test_each_service_command_is_accepted(service: str) -> None:
    name, options = read_command(SERVICES[service]["command"])
    assert name == service
    if getattr(options, "scenario", None):
        network = load_scenario(options.scenario, changes_of(options)).network
        assert name == "view" or (network.mode, network.router) == ("routed", "tcp/router:7447")


def test_all_services_connect_to_the_router() -> None:
    router = read_command(SERVICES["router"]["command"])[1].listen
    assert router == "tcp/0.0.0.0:7447"
    for service in ("master", "view"):
        assert read_command(SERVICES[service]["command"])[1].connect in ("tcp/router:7447", ["tcp/router:7447"])
    assert read_command(SERVICES["view"]["command"])[1].routed


def test_only_the_view_has_a_port_and_that_on_this_machine_only() -> None:
    assert {name: service["ports"] for name, service in SERVICES.items() if "ports" in service} == {
        "view": ["127.0.0.1:7480:7480"]
    }
    assert str(read_command(SERVICES["view"]["command"])[1].listen) in ("0.0.0.0:7480", "('0.0.0.0', 7480)")


def test_every_package_folder_is_in_the_image() -> None:
    text = (FOLDER / "Containerfile").read_text()
    for folder in ("hil", "sim", "boards", "firmware_stub"):
        assert f"COPY {folder} /src/{folder}\n" in text
    assert (FOLDER / SERVICES["slave"]["build"]["context"] / SERVICES["slave"]["build"]["dockerfile"]).exists()


def test_the_extension_of_blueos_has_the_labels_and_runs_what_the_project_accepts() -> None:
    text = (FOLDER / "Containerfile").read_text().replace("\\\n", "").partition(" AS blueos")[2]
    labels = dict(re.findall(r"""(\w+)=("(?:\\.|[^"\\])*"|'[^']*')""", text.partition("LABEL")[2].partition("\n")[0]))
    shown = {name: value[1:-1].replace('\\"', '"') for name, value in labels.items()}
    read = {name: json.loads(value) for name, value in shown.items() if value[0] in "[{"}
    assert set(read) == {"tags", "authors", "company", "links", "permissions"}
    assert set(labels) - set(read) == {"version", "type", "requirements", "readme"}
    host = read["permissions"]["HostConfig"]
    folder = text.partition("WORKDIR ")[2].split("\n")[0]
    assert [bind.partition(":")[2] for bind in host["Binds"]] == [folder]
    assert all(limit["Hard"] in (-1, 90) and LOOP_PRIORITY < 90 for limit in host["Ulimits"])
    for name in re.findall(r"boards/container/(\S+)", text):
        assert (FOLDER / name).exists()
    lines = [line for line in (FOLDER / "blueos.sh").read_text().splitlines() if "uuv-hil " in line]
    (view, watched), (slave, run) = (read_command(re.sub(".*uuv-hil | &$", "", line)) for line in lines)
    assert (view, slave, watched.scenario, run.scenario) == ("view", "slave", "scenario.toml", "scenario.toml")
    scenario = load_scenario(str(FOLDER / "blueos.toml"))
    assert watched.connect == [scenario.slave.listen]
    assert scenario.mavlink is not None
    assert scenario.mavlink.system == 2
    assert str(scenario.mavlink.parameters).startswith(folder)
