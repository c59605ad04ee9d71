"""Records of the doctor: its findings, and the subject that it examines."""

import os
import re
from typing import Literal, NamedTuple

from boards import Board
from boards.tree import Tree
from hil.common.clock import LOOP_PRIORITY
from hil.install.units import LIMITS, serial_device
from hil.scenario.config import Scenario

Level = Literal["ok", "note", "problem"]


class Finding(NamedTuple):
    """Result of one check: its level, its topic, the state as text, and the remedy."""

    level: Level
    topic: str
    text: str
    remedy: str = ""


class User(NamedTuple):
    """The user that runs the slave."""

    name: str
    uid: int
    groups: tuple[int, ...]


class Account(NamedTuple):
    """A line of /etc/passwd or /etc/group. `fourth` is the fourth field: the user's group, or the group's members."""

    name: str
    number: int
    fourth: str


class Case(NamedTuple):
    """Subject of the checks. Without a scenario nothing is required, so no finding is a problem."""

    tree: Tree
    board: Board | None
    scenario: Scenario | None
    user: User

    @property
    def severity(self) -> Level:
        """Level of a finding about something that a run requires."""
        return "problem" if self.scenario else "note"

    @property
    def remote(self) -> bool:
        """True if masters on other machines are expected."""
        scenario = self.scenario
        return scenario is not None and bool(scenario.network.router or not _is_local(scenario.slave.listen))

    @property
    def device(self) -> str:
        """The serial port of the scenario's link, or without a scenario the board's port; empty if there is none."""
        if self.scenario:
            return serial_device(self.scenario, self.board)
        uart = self.board.uart if self.board else ""
        return uart if uart and self.tree.exists(self.tree.resolve(uart)) else ""


def accounts(tree: Tree, file: str) -> list[Account]:
    """Return the users or groups in a machine's /etc/passwd or /etc/group.

    Comments and malformed lines are left out.
    """
    rows = re.findall(r"^[ \t]*([^:#\s][^:\n]*):[^:\n]*:([0-9]{1,10}):([^:\n]*)", tree.text(file), re.MULTILINE)
    return [Account(name, int(number), fourth) for name, number, fourth in rows]


def realtime_remedy(case: Case) -> str:
    """Return how the user's session gets real-time scheduling and locked memory."""
    if f"{case.user.name} - rtprio {LOOP_PRIORITY}" in case.tree.text(LIMITS).splitlines():
        return f"log in again: new sessions get it from {LIMITS}"
    return "uuv-hil board install grants it to the service and its user; for a shell: see /etc/security/limits.d"


def may_open(status: os.stat_result, user: User) -> bool:
    """Return whether `user` may read and write a file, by its mode; root always may."""
    return user.uid == 0 or permits(status, user, 6)


def permits(status: os.stat_result, user: User, bits: int) -> bool:
    """Return whether the mode of a file permits `user` all of the `bits`: 4 to read, 2 to write, 1 to enter."""
    shift = 6 if status.st_uid == user.uid else 3 if status.st_gid in user.groups else 0
    return status.st_mode >> shift & bits == bits


def user_prefix(user: User) -> list[str] | None:
    """Return the prefix of a command that is run as `user`, with that user's limits; None if this is not permitted.

    It uses runuser, not setuid, because runuser opens a session, in which limits.conf(5) applies.
    """
    if user.uid == os.getuid():
        return []
    return ["runuser", "-u", user.name, "--"] if os.geteuid() == 0 else None


def parse_hexadecimal(text: str) -> int | None:
    """Return a hexadecimal number of the kernel's files; None if the text is no number."""
    try:
        return int(text, 16)
    except ValueError:
        return None


def _is_local(listen: str) -> bool:
    host = listen.partition("/")[2].rpartition(":")[0].strip("[]")
    return host.startswith("127.") or host in ("localhost", "::1")
