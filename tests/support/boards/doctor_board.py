"""The recorded files of a board, with and without a fault, for tests of the doctor."""

import json
from pathlib import Path

import pytest

from hil.commands import doctor
from tests.support.boards.recorded import build, plant

SERIAL = """
vehicle = "paper_six"
world = "pool"
stm32 = "device"
[slave]
listen = "tcp/0.0.0.0:7447"
[master]
goal = [8, 7]
"""


PASSWD = "root:x:0:0::/root:/bin/sh\nnobody:x:65534:65534::/:/usr/sbin/nologin\n"


@pytest.fixture
def board(tmp_path: Path) -> Path:
    return build("raspberry_pi_4b", tmp_path / "root")


def examine(root: Path, capsys: pytest.CaptureFixture[str], text: str = SERIAL) -> tuple[int, list[dict[str, str]]]:
    """Return the exit code and all findings except those of level "ok"."""
    path = root.parent / "mine.toml"
    path.write_text(text)
    plant(root, "etc/passwd", PASSWD)
    code = doctor.main([str(path), "--root", str(root), "--user", "nobody", "--json"])
    found: list[dict[str, str]] = json.loads(capsys.readouterr().out)
    return code, [row for row in found if row["level"] != "ok"]
