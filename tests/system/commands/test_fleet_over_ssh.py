"""`uuv-hil fleet` over a real sshd on this machine, in a home folder of its own."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.common.children import ROOT
from tests.support.processes import free_port, wait_for
from tests.system.commands.test_fleet_command import Command

SSHD = shutil.which("sshd", path=f"{os.environ['PATH']}:/usr/sbin")


@pytest.fixture
def ssh(tmp_path: Path) -> Iterator[str]:
    """Return the ssh command that connects to it."""
    if not SSHD or not shutil.which("ssh"):
        pytest.skip("no openssh-server")
    for name in ("host", "user"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(tmp_path / name)], check=True)
    port = free_port()
    os.makedirs("/run/sshd", exist_ok=True)  # where it gives its rights up, which Debian's unit makes
    options = {
        "ListenAddress": f"127.0.0.1:{port}", "HostKey": tmp_path / "host", "PidFile": "none", "UsePAM": "no",
        "AuthorizedKeysFile": tmp_path / "user.pub", "StrictModes": "no", "PermitRootLogin": "yes",
        "SetEnv": f"HOME={tmp_path} PYTHONPATH={ROOT} XDG_CACHE_HOME={tmp_path}",
    }  # fmt: skip
    words = [word for key, value in options.items() for word in ("-o", f"{key}={value}")]
    server = subprocess.Popen([SSHD, "-D", "-e", "-f", "/dev/null", *words], stderr=subprocess.DEVNULL)
    client = f"ssh -F none -p {port} -i {tmp_path / 'user'} -o BatchMode=yes -o StrictHostKeyChecking=no"
    client += f" -o UserKnownHostsFile={tmp_path / 'known'} -o LogLevel=ERROR"
    try:
        assert wait_for(
            lambda: subprocess.run([*client.split(), "127.0.0.1", "true"], capture_output=True).returncode == 0
        )
        yield client
    finally:
        server.terminate()
        server.wait(10)


def test_members_run_here_and_over_ssh(ssh: str, tmp_path: Path) -> None:
    command = Command(tmp_path)
    program = tmp_path / "there"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m hil "$@"\n')
    program.chmod(0o755)
    try:
        up = command.run("up", "--on", "uuv2=127.0.0.1", "--ssh", ssh, "--program", str(program))
        assert up.returncode == 0, up.stderr
        assert "uuv2: started on 127.0.0.1" in up.stdout
        assert len(command.slaves()) == 2
        status = command.run("status")
        assert status.returncode == 0, status.stdout
        assert "127.0.0.1  running" in status.stdout
        down = command.run("down")
        assert down.returncode == 0, down.stderr + down.stdout
        assert not command.slaves()
    finally:
        for process in command.slaves():
            process.kill()


def test_a_host_without_the_program_is_reported(ssh: str, tmp_path: Path) -> None:
    command = Command(tmp_path)
    up = command.run("up", "--on", "uuv1=127.0.0.1", "--ssh", ssh, "--program", "no-such-uuv-hil")
    assert up.returncode == 3
    assert "uuv1 on 127.0.0.1 ended" in up.stderr
    assert "no-such-uuv-hil: not found" in up.stderr
    assert not command.slaves()
