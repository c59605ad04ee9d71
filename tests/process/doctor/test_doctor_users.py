"""`uuv-hil doctor`: the rights of the user who runs the slave, and what it cannot determine about them."""

import os
import pty
from collections.abc import Iterator
from pathlib import Path

import pytest

from boards.tree import Tree
from hil.commands import doctor
from hil.commands.board import service as board_service
from hil.common.errors import ConfigError
from hil.doctor import board as doctor_board
from hil.doctor import links as doctor_links
from hil.doctor import software as doctor_software
from hil.doctor.findings import Account, Case, User, accounts
from hil.scenario.config import Scenario, load_scenario
from tests.support.boards.recorded import plant

LIMITS = """\
Limit                     Soft Limit           Hard Limit           Units
Max locked memory         {locked:<20} 8388608              bytes
Max realtime priority     {priority:<20} 0
"""
STATUS = "Name:\tcat\nCapEff:\t{:016x}\n"
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root may start a process as another user")


class Runner(Tree):
    """This machine, where starting a process as another user gives the output that the test sets."""

    def __init__(self, output: str | None, files: dict[str, str] | None = None) -> None:
        super().__init__("/")
        self.output, self.files = output, files or {}
        self.requested: list[tuple[str, ...]] = []

    def text(self, name: str) -> str:
        return self.files.get(name, "")

    def run(self, *command: str) -> str | None:
        self.requested.append(command)
        return self.output


def scenario(port: str = "pty:") -> Scenario:
    plain = load_scenario("paper_field")
    return plain._replace(link=plain.link._replace(port=port))


@pytest.fixture
def account(monkeypatch: pytest.MonkeyPatch) -> User:
    """Return another user, for root."""
    monkeypatch.setattr("os.getuid", lambda: 0)
    monkeypatch.setattr("os.geteuid", lambda: 0)
    return User("uuv", 4711, (4711,))


@pytest.mark.parametrize(
    ("priority", "locked", "capabilities", "levels"),
    [
        ("0", "8388608", 0, ["problem", "note"]),
        ("40", "unlimited", 0, ["ok", "ok"]),
        ("0", "8388608", 1 << 23 | 1 << 14, []),  # CAP_SYS_NICE, CAP_IPC_LOCK: limits do not matter
    ],
)
def test_root_determines_the_limits_of_another_user(
    account: User, priority: str, locked: str, capabilities: int, levels: list[str]
) -> None:
    """Root's own capabilities grant everything; those of the other's process count."""
    tree = Runner(
        LIMITS.format(priority=priority, locked=locked) + STATUS.format(capabilities),
        {
            "/proc/self/status": STATUS.format(~0 & 0xFFFFFFFF),
            "/proc/self/limits": LIMITS.format(priority=99, locked=9),
        },
    )
    found = list(doctor_board.check_realtime_limits(Case(tree, None, scenario(), account)))
    assert [row.level for row in found] == levels
    assert tree.requested == [("runuser", "-u", "uuv", "--", "cat", "/proc/self/limits", "/proc/self/status")]


def test_without_root_the_limits_of_others_cannot_be_determined(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.getuid", lambda: 1000)
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    case = Case(Runner(None), None, scenario(), User("uuv", 4711, ()))
    (found,) = doctor_board.check_realtime_limits(case)
    assert (found.level, found.text) == ("note", "the limits of uuv cannot be determined")
    assert found.remedy == "run the same command with sudo and --user uuv"
    assert not list(doctor_software.check_scheduling(case))


@as_root
def test_the_limits_of_the_user_nobody_are_read(capsys: pytest.CaptureFixture[str]) -> None:
    """The session is that of nobody, without root's capabilities."""
    case = Case(Tree("/"), None, scenario(), doctor.find_user(Tree("/"), "nobody"))
    (found, *_) = doctor_board.check_realtime_limits(case)
    assert found.topic == "real time"
    assert "is permitted, but the slave's loop needs 40" in found.text
    assert (
        "SCHED_FIFO"
        in next(doctor_software.check_scheduling(case._replace(user=doctor.find_user(Tree("/"), None)))).text
    )


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
