"""The limits on new connections that a board gets with the slave's service."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from hil.install.units import FIREWALL, FIREWALL_UNIT
from tests.support.boards.installed_service import files, install, root, scenario, uninstall, values
from tests.support.boards.recorded import plant

__all__ = ["root", "scenario"]  # the fixtures


@pytest.mark.parametrize("listen", ["tcp/0.0.0.0:7500", "tcp/[::]:7500", "tcp/192.168.3.116:7500"])
def test_new_connections_are_limited_by_a_firewall(
    root: Path, scenario: str, capsys: pytest.CaptureFixture[str], listen: str
) -> None:
    before = files(root)
    assert install(root, scenario, "--yes", "--listen", listen) == 0
    assert "sudo apt install nftables" in capsys.readouterr().out
    rules = (root / FIREWALL[1:]).read_text()
    assert "tcp dport { 7500, 7501 } ct state new jump arrivals" in rules
    chain = rules.partition("chain arrivals")[2]
    assert re.search(r"ip saddr limit rate over \d+/second burst \d+ packets } drop", chain), "one address"
    assert re.search(r"ip saddr ct count over \d+ } reject", chain), "one address, at one time"
    assert re.search(r"^ *limit rate over \d+/second burst \d+ packets drop$", chain, flags=re.MULTILINE), "all"
    assert not re.search("@[a-z_]+@", rules), "everything is filled in"
    assert values(root, FIREWALL_UNIT, "ExecStart") == [f"/usr/sbin/nft -f {FIREWALL}"]
    assert values(root, FIREWALL_UNIT, "ExecStop") == ["-/usr/sbin/nft delete table inet uuv_hil"]
    assert values(root, FIREWALL_UNIT, "ConditionFileIsExecutable") == ["/usr/sbin/nft"]
    assert "uuv-hil.service" in values(root, FIREWALL_UNIT, "WantedBy")[0].split(), "it starts with the slave"
    plant(root, "usr/sbin/nft", "")
    assert install(root, scenario, "--dry-run", "--listen", listen) == 0
    assert "apt install nftables" not in capsys.readouterr().out
    assert uninstall(root) == 0
    (root / "usr/sbin/nft").unlink()
    assert files(root) == before


@pytest.mark.parametrize("listen", ["tcp/127.0.0.1:7500", "tcp/localhost:7500", "tcp/[::1]:7500"])
def test_a_loopback_endpoint_gets_no_firewall(root: Path, scenario: str, listen: str) -> None:
    assert install(root, scenario, "--yes", "--listen", listen) == 0
    assert not (root / FIREWALL[1:]).exists()
    assert not (root / FIREWALL_UNIT[1:]).exists()


@pytest.mark.skipif(not shutil.which("nft") or os.geteuid() != 0, reason="needs nftables, and root")
def test_the_kernel_accepts_the_firewall_rules(root: Path, scenario: str) -> None:
    """The rules are loaded twice, in their own network namespace."""
    assert install(root, scenario, "--yes", "--listen", "tcp/0.0.0.0:7500") == 0
    path = root / FIREWALL[1:]
    script = f"nft -f {path} && nft -f {path} && nft list table inet uuv_hil && nft delete table inet uuv_hil"
    done = subprocess.run(["unshare", "-n", "sh", "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "tcp dport { 7500, 7501 }" in done.stdout
