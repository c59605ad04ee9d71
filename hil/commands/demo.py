"""`uuv-hil demo`: slave and master on this machine, one run, the HIL table."""

import os
import select
import signal
import subprocess
import sys

from hil.clock import now_ns
from hil.commands.parser import new_parser
from hil.config import load_scenario
from hil.errors import NetworkError
from hil.master.recorder import make_folder, new_folder
from hil.stop import StopSignals

EXAMPLES = """\
examples:
  uuv-hil demo                         the source paper's field
  uuv-hil demo mine.toml --run-dir out
"""
GRACE_S = 10.0


def main(arguments: list[str]) -> int:
    """Run slave and master as two processes; the master's exit code."""
    parser = new_parser("demo", __doc__, EXAMPLES)
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", default="paper_field")
    parser.add_argument("--run-dir", metavar="DIR", help="where to put the results [runs/SCENARIO-TIME]")
    options = parser.parse_args(arguments)
    endpoint = load_scenario(options.scenario).slave.listen
    folder = make_folder(options.run_dir) if options.run_dir else new_folder(options.scenario)
    log_path = os.path.join(folder, "slave.log")
    with StopSignals() as stop_fd, open(log_path, "w") as log:
        master, ready_fd = _start_master(options.scenario, endpoint, folder)
        slave = None
        try:
            if not _dials(ready_fd, stop_fd):
                return master.wait(GRACE_S)
            print(f"starting the slave (its log: {log_path})", flush=True)
            slave = _start_slave(options.scenario, log)
            return _watch(master, slave, stop_fd, log_path)
        finally:
            for process in (master, slave):
                if process:
                    _end(process)


def _start_master(scenario: str, endpoint: str, folder: str) -> tuple[subprocess.Popen[bytes], int]:
    read_fd, write_fd = os.pipe()
    command = [sys.executable, "-m", "hil.cli", "master", scenario, "--connect", endpoint, "--run-dir", folder]
    master = subprocess.Popen([*command, "--ready-fd", str(write_fd)], pass_fds=[write_fd], start_new_session=True)
    os.close(write_fd)
    return master, read_fd


def _dials(ready_fd: int, stop_fd: int) -> bool:
    """Wait until the master dials: only then is the slave's start-up time the slave's alone.

    False if the master ended instead. Raises KeyboardInterrupt when the user ends us.
    """
    try:
        if stop_fd in select.select((ready_fd, stop_fd), (), ())[0]:
            raise KeyboardInterrupt
        return os.read(ready_fd, 1) != b""
    finally:
        os.close(ready_fd)


def _start_slave(scenario: str, log: object) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "hil.cli", "slave", scenario]
    environment = os.environ | {"UUV_HIL_EXEC_NS": str(now_ns())}
    return subprocess.Popen(command, stderr=log, env=environment, start_new_session=True)  # type: ignore[call-overload, no-any-return]


def _watch(master: subprocess.Popen[bytes], slave: subprocess.Popen[bytes], stop_fd: int, log_path: str) -> int:
    while master.poll() is None:
        if select.select((stop_fd,), (), (), 0.1)[0]:
            raise KeyboardInterrupt
        if slave.poll() is not None and master.poll() is None:
            with open(log_path) as log:
                last = (log.read().strip().splitlines() or ["no message"])[-1]
            raise NetworkError(f"the slave ended with exit code {slave.returncode}: {last}")
    return master.returncode


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
