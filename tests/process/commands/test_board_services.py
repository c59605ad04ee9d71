"""Services that a board gets beside the slave's: their units, ports, state and removal."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from hil import cli
from hil.install.companions import KINDS
from hil.install.units import FIREWALL, UNIT, UNITS
from tests.support.boards import installed_service as board
from tests.support.boards.installed_service import executed, files, install, root, scenario, uninstall, values

__all__ = ["executed", "root", "scenario"]  # the fixtures
ROUTED = '[network]\nmode = "routed"\nrouter = "tcp/192.168.3.116:7447"\n'


def services(*texts: str) -> list[str]:
    return [word for text in texts for word in ("--service", text)]


def path_of(name: str) -> str:
    return f"{UNITS}uuv-hil-{name}.service"


def test_every_kind_gets_a_unit_that_starts_beside_the_slave(root: Path, scenario: str) -> None:
    Path(scenario).write_text(board.SERIAL + ROUTED)
    before = files(root)
    assert install(root, scenario, "--yes", "--set", "seed=7", *services(",".join(KINDS))) == 0
    paths = [path_of(name) for name in KINDS]
    for name, path in zip(KINDS, paths, strict=True):
        text = (root / path[1:]).read_text()
        assert all(key in board.KNOWN[section].split() for section, key, _ in board.settings(text))
        assert "@" not in text.replace("@system-service", ""), "everything is filled in"
        words = shlex.split(values(root, path, "ExecStart")[0])
        assert {scenario, "seed=7", "tcp/192.168.3.116:7447"} <= {*words}
        order = {key: values(root, path, key) for key in ("Before", "After")}
        is_router = name == "router"
        assert ("uuv-hil.service" in order["Before"], "uuv-hil.service" in order["After"]) == (is_router, not is_router)
        assert values(root, path, "Restart") == ["on-failure"]
        assert values(root, path, "Type") == ["simple"]
        assert values(root, path, "ProtectSystem") == ["strict"]
    assert values(root, UNIT, "Type") == ["notify"]
    if analyze := shutil.which("systemd-analyze"):
        command = [analyze, "verify", "--man=no", *(str(root / path[1:]) for path in paths)]
        errors = subprocess.run(command, capture_output=True, text=True).stderr
        assert [line for line in errors.splitlines() if "uuv-hil" in line] == []
    assert uninstall(root) == 0
    assert files(root) == before


def test_a_service_has_its_options_ports_devices_and_environment(root: Path, scenario: str) -> None:
    mavlink = "mavlink --endpoint udpin:0.0.0.0:14550 --endpoint serial:/dev/ttyUSB0:57600"
    texts = (
        mavlink,
        "view --listen 0.0.0.0:7480",
        "json",
        "ROS_MASTER_URI=http://10.0.0.2:11311 ros1",
        "record -o /data",
    )
    assert install(root, scenario, "--yes", "--listen", "tcp/0.0.0.0:7500", *services(*texts)) == 0
    assert "tcp dport { 7480, 7500, 7501 } ct" in (root / FIREWALL[1:]).read_text()
    assert values(root, path_of("mavlink"), "DeviceAllow") == ["char-ttyUSB rw"]
    assert values(root, path_of("mavlink"), "Wants") == ["modprobe@usbserial.service"]
    assert "ROS_MASTER_URI=http://10.0.0.2:11311" in values(root, path_of("ros1"), "Environment")[0].split()
    assert values(root, path_of("ros1"), "Wants") == ["network-online.target"]
    assert values(root, path_of("record"), "ReadWritePaths") == ["-/data"]
    assert "--connect tcp/127.0.0.1:7500" in values(root, path_of("json"), "ExecStart")[0]
    assert install(root, scenario, "--yes", *services("json --connect tcp/10.0.0.9:7447")) == 0
    assert values(root, path_of("json"), "ExecStart")[0].count("--connect") == 1
    assert not (root / path_of("view")[1:]).exists(), "a later installation does not name it"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("record,recrod", "--service: 'recrod' is not one of mavlink, record, .*; did you mean 'record'"),
        ("view,view", "--service: 'view' is given twice"),
        ('view "', "--service view \": No closing quotation"),
        ("ROS_MASTER_URI=http://[x ros1", "Invalid IPv6 URL"),
        ("view --lisen 7480", "no option '--lisen'; did you mean '--listen'"),
        ("json --listen 7448", "json: the slave listens on port 7448 too"),
        ("json --listen 7480,view", "expected .*7480,view"),
        ("router", "router: the slave would not use it; set network.router"),
    ],
)  # fmt: skip
def test_services_that_cannot_work_are_refused(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    before = files(root)
    assert install(root, scenario, "--yes", *services(text)) == 2
    assert re.search(message, capsys.readouterr().err)
    assert files(root) == before


def test_one_service_of_several_is_removed(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], executed: list[str]
) -> None:
    on_board = ("--root", str(root))
    assert cli.main(["board", "uninstall", "--service", "view", *on_board]) == 2
    assert "nothing is installed on this machine" in capsys.readouterr().err
    assert install(root, scenario, "--yes", *services("view,record")) == 0
    assert cli.main(["board", "uninstall", "--service", "json", *on_board]) == 2
    assert cli.main(["board", "uninstall", "--yes", "--service", "view", *on_board]) == 0
    assert executed[-3].endswith("uuv-hil-view.service")
    assert ((root / UNIT[1:]).exists(), (root / path_of("view")[1:]).exists()) == (True, False)
