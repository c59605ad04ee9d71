"""Start, query and stop the slaves of a fleet: on this machine by the shell, on other hosts by `ssh HOST`.

A member is a process in a separate session, which first writes its process id into a file on its machine. A state file
on this machine lists the started members and their hosts. It is written before each start, so that `stop` also ends a
member whose start was interrupted. After the start it gets the kernel's start time of the process, so that another
process that gets the same id later is never signalled.
"""

import json
import os
import shlex
import subprocess
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from hil.common.errors import ConfigError, DeviceError
from hil.common.tables import PRIVATE, state_path, write_atomically

SSH = "ssh -o BatchMode=yes -o ConnectTimeout=10"
HOST_TIMEOUT_S = 60.0  # longest wait for a command on a host, more than GRACE_S
GRACE_S = 10  # from SIGTERM to SIGKILL
INTERRUPTED_S = 2  # wait for the process id of an interrupted start

# Field 22 of /proc/PID/stat is the start time of the process. The name before it may contain blanks, and ends at ')'.
BEGAN = "began() { sed 's/.*) //' /proc/$1/stat 2>/dev/null | cut -d' ' -f1,20; }"
ALIVE = 'alive() { set -- $(began $1) $2; test -n "$3" && test "$1" != Z && test "$2" = "$3"; }'
WAIT = "n=0; while ! test -s {member}.pid && test $n -lt {tenths}; do sleep 0.1; n=$((n + 1)); done"
START = """\
{began}
mkdir -p {folder} && cd {folder} && rm -f {member}.pid && cat > {member}.toml && : > {member}.log || exit 1
setsid sh -c 'echo $$ > "$0.pid"; exec "$@"' {member} {command} < /dev/null >> {member}.log 2>&1 &
{wait}
sleep 1
set -- $(cat {member}.pid)
set -- $1 $(began $1)
echo "${{1:-0}} ${{3:-0}}"
"""
STATUS = """\
{began}
{alive}
if alive {pid} {start}; then echo running; else echo ended; fi
tail -n 1 {folder}/{member}.log 2>/dev/null
true
"""
STOP = """\
{began}
{alive}
cd {folder} 2>/dev/null || {{ echo ended; exit; }}
pid={pid} start={start}
if test $pid = 0; then
    {wait}
    pid=$(cat {member}.pid 2>/dev/null) || pid=0
    set -- $(began $pid)
    start=${{2:-0}}
fi
if alive $pid $start; then kill -TERM $pid; fi
n=0; while alive $pid $start && test $n -lt {tenths}; do sleep 0.1; n=$((n + 1)); done
if alive $pid $start; then kill -KILL -$pid; echo killed; else echo ended; fi
rm -f {member}.toml {member}.pid
"""


class Started(NamedTuple):
    """A started member: its host ("": this machine), process id, start time in clock ticks since boot, and folder.

    The process id is 0 while the member is being started.
    """

    member: str
    host: str
    pid: int
    start: int
    folder: str


class MemberState(NamedTuple):
    """State of a member: "running", "ended" or "unreachable", and the last line of its log."""

    member: str
    host: str
    state: str
    last: str


def state_file(scenario: str) -> str:
    """Return the path of the file that lists the started members of a scenario."""
    return state_path("fleets", f"{os.path.splitext(os.path.basename(scenario))[0]}.json")


def start(
    scenario: str,
    text: str,
    hosts: Mapping[str, str],
    programs: Mapping[str, Sequence[str]],
    ssh: str = SSH,
    options: Sequence[str] = (),
) -> list[Started]:
    """Start a slave for each member in `hosts` (member -> host). If one does not start, all are stopped.

    `scenario` is the path of its file, and `text` its content, which is copied to each host. `programs`: host -> the
    command for `uuv-hil` there. `options`: further options of each slave.

    Raises ConfigError if the fleet was started already, DeviceError if a host or a member fails.
    """
    path = state_file(scenario)
    if os.path.exists(path):
        running = _load(path)["scenario"]
        which = "this fleet" if running == scenario else "another fleet of this name"
        raise ConfigError(f"{path}: {which} is already started; stop it first: uuv-hil fleet down {running}")
    folder = f".cache/uuv-hil/fleet-{os.path.splitext(os.path.basename(path))[0]}"
    started: list[Started] = []
    try:
        for member, host in hosts.items():
            member_folder = os.path.expanduser(f"~/{folder}") if not host else folder
            file = f"{member}.toml" if host else scenario
            command = shlex.join([*programs[host], "slave", file, "--member", member, *options])
            started.append(Started(member, host, 0, 0, member_folder))
            script = _fill_script(START, started[-1], GRACE_S, command)
            _save_started(scenario, started, ssh)
            pid, start_ticks = map(int, _run(host, script, ssh, text).split())
            started[-1] = Started(member, host, pid, start_ticks, member_folder)
            _save_started(scenario, started, ssh)
        for state in query_states(started, ssh):
            if state.state != "running":
                where = f" on {state.host}" if state.host else ""
                raise DeviceError(f"{state.member}{where} {state.state}: {state.last or 'no output'}")
    except BaseException as error:
        stop(scenario, started, ssh, forget_incomplete=isinstance(error, DeviceError))
        raise
    return started


def load_started(scenario: str, name: str) -> tuple[list[Started], str]:
    """Return the started members and the ssh command; `name` is what the user calls the scenario at path `scenario`.

    Raises ConfigError if there are none, or the file is damaged.
    """
    path = state_file(scenario)
    table = _load(path) if os.path.exists(path) else {}
    if table and table["scenario"] == scenario:
        return table["members"], table["ssh"]
    other = f" ({table['scenario']} was: another fleet of this name)" if table else ""
    raise ConfigError(f"no member of {name} was started from this machine{other}; start them: uuv-hil fleet up {name}")


def query_states(members: Sequence[Started], ssh: str) -> list[MemberState]:
    """Return the state of each member."""
    states = []
    for one in members:
        try:
            state, _, last = _run(one.host, _fill_script(STATUS, one), ssh).partition("\n")
            states.append(MemberState(one.member, one.host, state, last.strip()))
        except DeviceError as error:
            states.append(MemberState(one.member, one.host, "unreachable", str(error)))
    return states


def stop(scenario: str, members: Sequence[Started], ssh: str, forget_incomplete: bool = False) -> list[MemberState]:
    """Stop the slaves by SIGTERM, and after GRACE_S by SIGKILL. Unreachable ones stay in the state file.

    With `forget_incomplete`, an unreachable member whose start was not complete is removed from the file.
    """
    states, unreachable = [], []
    for one in members:
        try:
            states.append(MemberState(one.member, one.host, _run(one.host, _fill_script(STOP, one), ssh).strip(), ""))
        except DeviceError as error:
            states.append(MemberState(one.member, one.host, "unreachable", str(error)))
            unreachable += [one] if one.pid or not forget_incomplete else []
    if unreachable:
        _save_started(scenario, unreachable, ssh)
    elif os.path.exists(state_file(scenario)):
        os.unlink(state_file(scenario))
    return states


def _fill_script(script: str, one: Started, wait: int = INTERRUPTED_S, command: str = "") -> str:
    """Return a script filled with the fields of a member. It waits up to `wait` s for the member's process id."""
    fields = {"began": BEGAN, "alive": ALIVE, "tenths": GRACE_S * 10, "command": command}
    return script.format(wait=WAIT.format(member=one.member, tenths=wait * 10), **fields, **one._asdict())


def _run(host: str, script: str, ssh: str, text: str = "") -> str:
    """Run a script on a host with `text` as standard input; return its standard output. Raises DeviceError."""
    command = [*shlex.split(ssh), host, f"sh -c {shlex.quote(script)}"] if host else ["sh", "-c", script]
    try:
        result = subprocess.run(
            command, input=text, capture_output=True, text=True, check=False, timeout=HOST_TIMEOUT_S
        )
    except FileNotFoundError:
        raise DeviceError(f"{command[0]}: no such program (sudo apt install openssh-client)") from None
    except subprocess.TimeoutExpired:
        raise DeviceError(f"{host or 'this machine'}: no answer within {HOST_TIMEOUT_S:g} s") from None
    if result.returncode:
        last = (result.stderr.strip() or f"exit code {result.returncode}").splitlines()[-1]
        raise DeviceError(f"{host or 'this machine'}: {last}; try: {shlex.join(command[:-1])} true")
    return result.stdout


def _load(path: str) -> dict[str, Any]:
    """Return what `_save_started` has written. Raises ConfigError if the file is damaged."""
    try:
        with open(path, encoding="utf-8") as file:
            table = json.load(file)
        members = [Started(**entry) for entry in table["members"]]
        return {"scenario": str(table["scenario"]), "ssh": str(table["ssh"]), "members": members}
    except (ValueError, TypeError, KeyError):
        raise ConfigError(f"{path}: is damaged; stop the slaves by hand and remove it") from None


def _save_started(scenario: str, members: Sequence[Started], ssh: str) -> None:
    path = state_file(scenario)
    try:
        table = {"scenario": scenario, "ssh": ssh, "members": [one._asdict() for one in members]}
        write_atomically(path, json.dumps(table, indent=1), PRIVATE)
    except OSError as error:
        raise DeviceError(f"{path}: cannot be written: {error.strerror}") from None
