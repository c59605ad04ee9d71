"""A file system tree in which the slave is installed as a service."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from hil import cli
from hil.commands.board import service as board_service
from hil.install.changes import FOLDERS
from tests.support.boards.recorded import build, plant

SERIAL = 'vehicle = "paper_six"\nworld = "pool"\nstm32 = "device"\n[start]\ndepth = 2\n[master]\ngoal = [8, 7]\n'
CAN = SERIAL + '[link]\nport = "can:socketcan:can0"\nprotocol = "vesc"\nbitrate = 500_000\n'
# What the unit is to have, by section; systemd ignores what it does not know, so that a slip of the pen would pass.
KNOWN = {
    "Unit": "Description Wants After Before BindsTo StartLimitIntervalSec",
    "Service": """Type NotifyAccess ExecStart ExecStartPre ExecStop RemainAfterExit Environment User SupplementaryGroups
        StateDirectory CacheDirectory WorkingDirectory WatchdogSec Restart RestartSec RestartPreventExitStatus
        TimeoutStartSec TimeoutStopSec LimitRTPRIO LimitMEMLOCK LimitCORE MemoryMax TasksMax CPUWeight OOMScoreAdjust
        NoNewPrivileges CapabilityBoundingSet ProtectSystem ProtectHome PrivateTmp ProtectProc ProtectHostname
        ProtectKernelTunables ProtectKernelModules ProtectKernelLogs ProtectControlGroups RestrictNamespaces
        RestrictSUIDSGID LockPersonality SystemCallArchitectures SystemCallFilter RestrictAddressFamilies DevicePolicy
        DeviceAllow ReadWritePaths""",
    "Install": "WantedBy",
}
PASSWD = "root:x:0:0:root:/root:/bin/bash\nuuv:x:999:999::/var/lib/uuv-hil:/usr/sbin/nologin\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    root = build("raspberry_pi_4b", tmp_path / "root")
    plant(root, "etc/passwd", PASSWD)
    for folder in FOLDERS[:3]:  # those that every system has
        (root / folder[1:]).mkdir(parents=True, exist_ok=True)
    return root


@pytest.fixture
def scenario(tmp_path: Path) -> str:
    path = tmp_path / "mine.toml"
    path.write_text(SERIAL)
    return str(path)


@pytest.fixture
def executed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list of the commands that would be run on this machine, in order."""
    found: list[str] = []
    monkeypatch.setattr(board_service, "_run", lambda _, commands: found.extend(map(" ".join, commands)))
    return found


def uninstall(root: Path) -> int:
    return cli.main(["board", "uninstall", "--root", str(root), "--yes"])


def files(root: Path) -> dict[str, str]:
    return {str(path.relative_to(root)): path.read_text() for path in sorted(root.rglob("*")) if path.is_file()}


def install(root: Path, scenario: str, *options: str) -> int:
    return cli.main(["board", "install", scenario, "--root", str(root), "--user", "uuv", *options])


def settings(text: str) -> Iterator[tuple[str, str, str]]:
    """Yield section, key and value of each line of a unit; fail at any other line."""
    section = ""
    for line in text.splitlines():
        if line.startswith("["):
            section = line.strip("[]")
        elif line and not line.startswith("#"):
            key, separator, value = line.partition("=")
            assert separator, line
            yield section, key, value


def values(root: Path, path: str, key: str) -> list[str]:
    return [value for _, name, value in settings((root / path[1:]).read_text()) if name == key]
