"""`uuv-hil fleet`: slaves run from `up` until `down`, here and on other hosts, and none is left then."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from hil.common.children import ROOT
from hil.common.schema import find_preset
from tests.support.processes import free_port, wait_for

MEMBERS = ("uuv1", "uuv2")
HEAD = Path(find_preset("hil/scenario/presets", "target_hunting")).read_text().partition("[[member]]")[0]
DOWN = f"{sys.executable} -c 'import sys; sys.exit(\"down\")'"


class Command:
    """The command with a home folder of its own."""

    def __init__(self, home: Path) -> None:
        self.environment = {**os.environ, "HOME": str(home), "XDG_STATE_HOME": str(home), "PYTHONPATH": ROOT}
        self.scenario = home / "pair.toml"
        rows = [HEAD]
        for number, name in enumerate(MEMBERS):
            rows.append(f'[[member]]\nnode = "{name}"\nnorth = {number}.0\neast = 0.0\n')
            rows.append(f'listen = "tcp/127.0.0.1:{free_port()}"\nagent = "tcp/127.0.0.1:{free_port()}"\n')
        self.scenario.write_text("".join(rows))

    def run(self, *words: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-m", "hil", "fleet", words[0], str(self.scenario), *words[1:]]
        return subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=100)

    def slaves(self) -> list[psutil.Process]:
        processes = []
        for process in psutil.process_iter(["cmdline", "environ"]):
            words, variables = process.info["cmdline"] or [], process.info["environ"] or {}
            if "--member" in words and variables.get("HOME") == self.environment["HOME"]:
                processes.append(process)
        return processes


@pytest.fixture
def command(tmp_path: Path) -> Iterator[Command]:
    made = Command(tmp_path)
    yield made
    for process in made.slaves():
        process.kill()


def test_up_starts_status_shows_and_down_ends_the_slaves(command: Command) -> None:
    up = command.run("up")
    assert up.returncode == 0, up.stderr
    assert len(command.slaves()) == 2
    status = command.run("status", "--json")
    assert [(row["member"], row["state"]) for row in json.loads(status.stdout)] == [(m, "running") for m in MEMBERS]
    again = command.run("up")
    assert again.returncode == 2
    assert "fleet down" in again.stderr
    command.slaves()[0].send_signal(signal.SIGKILL)
    assert wait_for(lambda: command.run("status").returncode == 3)
    down = command.run("down")
    assert down.returncode == 0, down.stderr
    assert not command.slaves()
    assert command.run("status").returncode == 2


def test_a_fleet_of_the_same_name_in_another_folder_is_another_fleet(command: Command, tmp_path: Path) -> None:
    assert command.run("up").returncode == 0
    first, folder = command.scenario, tmp_path / "other"
    folder.mkdir()
    command.scenario = folder / first.name
    command.scenario.write_text(first.read_text())
    for action in ("status", "down"):
        done = command.run(action)
        assert (done.returncode, f"{first} was: another fleet of this name" in done.stderr) == (2, True), done.stderr
    up = command.run("up")
    assert up.returncode == 2
    assert f"another fleet of this name is already started; stop it first: uuv-hil fleet down {first}" in up.stderr
    assert len(command.slaves()) == 2
    command.scenario = first
    assert command.run("down").returncode == 0


def test_set_changes_keys_of_the_scenario(command: Command) -> None:
    wrong = command.run("up", "--set", "slave.realtime=7")
    assert wrong.returncode == 2
    assert "realtime: expected true or false" in wrong.stderr
    assert not command.slaves()
    changes = ("--set", "slave.realtime=false", "--set", "master.speed=0.3")
    up = command.run("up", *changes)
    assert up.returncode == 0, up.stderr
    assert [tuple(slave.cmdline()[-4:]) for slave in command.slaves()] == [changes] * 2


def test_no_slave_is_left_when_one_cannot_be_started(command: Command) -> None:
    """The second host cannot be reached."""
    up = command.run("up", "--on", "uuv2=nobody.invalid", "--ssh", DOWN)
    assert up.returncode == 3
    assert "nobody.invalid: down; try: " in up.stderr
    assert not command.slaves()
    assert "no member of" in command.run("down").stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_start_that_is_interrupted_leaves_nothing(command: Command, number: int) -> None:
    """No slave is left after Ctrl-C, or by `down` after SIGKILL, nor one whose number was not reported yet."""
    up = subprocess.Popen(
        [sys.executable, "-m", "hil", "fleet", "up", str(command.scenario)],
        env=command.environment,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    assert wait_for(command.slaves)
    os.killpg(up.pid, number)  # as a terminal does: the shell that starts the member is hit, too
    _, errors = up.communicate(timeout=100)
    assert up.returncode == (130 if number == signal.SIGINT else -number)
    assert not errors
    if number == signal.SIGKILL:
        assert command.run("up").returncode == 2
        assert command.run("down").returncode == 0
    assert not command.slaves()
    assert "no member of" in command.run("down").stderr


def test_down_retains_the_members_of_an_unreachable_host(command: Command, tmp_path: Path) -> None:
    """Its member stays recorded, and the others end."""
    gone, ssh, program = tmp_path / "gone", tmp_path / "ssh", tmp_path / "program"
    ssh.write_text(  # a real ssh starts in the home folder too
        f'#!/bin/sh\ntest ! -e {gone} || {{ echo "No route to host" >&2; exit 255; }}\ncd && exec sh -c "$2"\n'
    )
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m hil "$@"\n')
    for script in (ssh, program):
        script.chmod(0o755)
    up = command.run("up", "--on", "uuv2=there", "--ssh", str(ssh), "--program", str(program))
    assert up.returncode == 0, up.stderr
    gone.touch()
    status = command.run("status")
    assert status.returncode == 3
    assert "unreachable  there: No route to host" in status.stdout
    down = command.run("down")
    assert down.returncode == 3
    assert "uuv2: not stopped, still listed in " in down.stderr
    assert len(command.slaves()) == 1
    gone.unlink()
    assert command.run("down").returncode == 0
    assert not command.slaves()


def test_another_process_with_the_recorded_number_is_not_signalled(command: Command) -> None:
    assert command.run("up").returncode == 0
    note = next(command.scenario.parent.glob("uuv-hil/fleets/*.json"))
    table = json.loads(note.read_text())
    table["members"][0]["start"] += 1
    note.write_text(json.dumps(table))
    assert command.run("down").returncode == 0
    assert len(command.slaves()) == 1
