"""`uuv-hil doctor`: the rights of the user who runs the slave, and what it cannot determine about them."""

import os
import pty
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from boards.tree import Tree
from hil.commands import doctor
from hil.commands.board import service as board_service
from hil.common.clock import LOOP_PRIORITY
from hil.common.errors import ConfigError
from hil.doctor import links as doctor_links
from hil.doctor import software as doctor_software
from hil.doctor.findings import Account, Case, User, accounts
from hil.install.units import UNIT
from hil.scenario.config import Scenario, load_scenario
from tests.support.boards.recorded import plant


def scenario(port: str = "pty:") -> Scenario:
    plain = load_scenario("paper_field")
    return plain._replace(link=plain.link._replace(port=port))


def test_without_root_the_scheduling_of_others_cannot_be_determined(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.getuid", lambda: 1000)
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    (found,) = doctor_software.check_scheduling(Case(Tree("/"), None, scenario(), User("uuv", 4711, ())))
    assert (found.level, found.text) == ("note", "that of uuv cannot be determined")
    assert found.remedy == "run the same command with sudo and --user uuv"


def test_a_unit_that_grants_real_time_is_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user's own processes have none; the installed service of that user, and of no other, has it."""
    denied = '[[false, "scheduling: normal; SCHED_FIFO not permitted"], [false, "memory: not locked"]]'
    done = subprocess.CompletedProcess([], 0, denied, "")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    case = Case(Tree(str(tmp_path)), None, scenario(), User("uuv", os.getuid(), ()))

    def levels() -> list[str]:
        return [f"{found.topic}: {found.level}" for found in doctor_software.check_scheduling(case)]

    assert levels() == ["scheduling: problem", "memory: note"]
    for user, level in (("other", "problem"), ("uuv", "note")):
        plant(tmp_path, UNIT[1:], f"[Service]\nUser={user}\nLimitRTPRIO={LOOP_PRIORITY}\n")
        assert levels() == [f"scheduling: {level}", "memory: note"]


PASSWD = "odd\npi:x:1000:1000:,,,:/home/pi:/bin/bash\npilot:x:4242:many::\n"
GROUP = "dialout:x:20:uuv,pi\nodd\nvideo:x:44:pilot\nlarge:x:99999999999:pi\n"


@pytest.mark.parametrize(
    ("name", "uid", "user"),
    [
        ("pi", 0, User("pi", 1000, (1000, 20))),
        ("pilot", 0, User("pilot", 4242, (44,))),
        (None, 1000, User("pi", 1000, (1000, 20))),
        (None, 7, User("7", 7, ())),
    ],
)
def test_users_of_a_recorded_machine_are_read_from_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str | None, uid: int, user: User
) -> None:
    """Users of this machine may have the same names and other groups."""
    monkeypatch.setattr("os.getuid", lambda: uid)
    plant(tmp_path, "etc/passwd", PASSWD)
    plant(tmp_path, "etc/group", GROUP)
    assert doctor.find_user(Tree(str(tmp_path)), name) == user
    with pytest.raises(ConfigError, match=f"no user 'nobody' in {tmp_path}/etc/passwd"):
        doctor.find_user(Tree(str(tmp_path)), "nobody")


BROKEN = """
odd
::
:x:0:0
few:x:7
word:x:seven:7::
large:x:99999999999:7::
+::::::
#old:x:5:5::
 pi:x:1000:1000:\u2028seen:x:6:6:/home/pi:/bin/sh
\0\ufffd"""


def test_comments_and_broken_lines_are_no_accounts(tmp_path: Path) -> None:
    """Comments and broken lines are no accounts, whoever reads the file; blanks before a name are none of it."""
    plant(tmp_path, "etc/passwd", BROKEN)
    tree = Tree(str(tmp_path))
    assert accounts(tree, "/etc/passwd") == [Account("pi", 1000, "1000")]
    board_service.check_user(tree, "pi")
    for name in ("odd", "few", "word", "large", "seen", "old"):
        with pytest.raises(ConfigError, match=f"there is no user '{name}'"):
            board_service.check_user(tree, name)
        with pytest.raises(ConfigError, match=f"there is no user '{name}'"):
            doctor.find_user(tree, name)


@pytest.fixture
def port() -> Iterator[str]:
    master, slave = pty.openpty()
    yield os.ttyname(slave)
    os.close(slave)
    os.close(master)


def test_only_root_can_see_all_processes_that_hold_a_port(port: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def findings_of(user: User, uid: int) -> list[tuple[str, str]]:
        monkeypatch.setattr("os.geteuid", lambda: uid)
        rows = doctor_links.check_port_users(Case(Tree("/"), None, scenario(port), user))
        return [(row.level, row.remedy) for row in rows]

    monkeypatch.setattr(doctor_links, "find_openers", lambda *_: [])
    owner = User("pilot", os.stat(port).st_uid, ())
    assert findings_of(owner, 0) == []
    assert findings_of(owner, 1000) == [("note", "run the same command with sudo and --user pilot")]
    os.chmod(port, 0)
    assert findings_of(User("outsider", 4711, ()), 1000) == [], "the port is not theirs anyway"
    monkeypatch.setattr(doctor_links, "find_openers", lambda *_: [os.getpid()])
    assert [level for level, _ in findings_of(owner, 1000)] == ["problem"]
