"""`uuv-hil demo`: slave and master on this machine, one run, the HIL table."""

import argparse
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec

from hil.clock import now_ns
from hil.commands.parser import new_parser
from hil.config import load_scenario
from hil.errors import MissingExtraError, NetworkError
from hil.master.recorder import make_folder
from hil.ports import free_ports
from hil.stop import StopSignals
from hil.transport.recording import new_folder
from hil.transport.settings import split

EXAMPLES = """\
examples:
  uuv-hil demo                         the source paper's field
  uuv-hil demo mine.toml --run-dir out
  uuv-hil demo --listen tcp/127.0.0.1:9000    beside a slave that runs already
  uuv-hil demo --world US5AK5SI.000    over the seabed of a chart, with laser, sonar and camera
  uuv-hil demo --world US5AK5SI.000 --start 59.6032,-151.4117 --goal 59.6032,-151.4101 --depth 6
A chart's folder of results also has report.md, report.html and what the vehicle saw.
"""
GRACE_S = 10.0


def main(arguments: list[str]) -> int:
    """Run slave and master as two processes; the master's exit code."""
    parser = new_parser("demo", __doc__, EXAMPLES)
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", default="paper_field")
    parser.add_argument("--run-dir", metavar="DIR", help="where to put the results [runs/SCENARIO-TIME]")
    parser.add_argument("--listen", metavar="ENDPOINT", help="of its slave, tcp/ADDRESS:PORT [the scenario's]")
    over = parser.add_argument_group("over a seabed of your own")
    over.add_argument("--world", metavar="CHART.000", help="a chart, soundings, or a world's .toml or name")
    over.add_argument("--start", metavar="LAT,LON", type=_place, help="degrees, with --goal [where there is relief]")
    over.add_argument("--goal", metavar="LAT,LON", type=_place, help="in sight of it: the way is planned")
    over.add_argument("--depth", metavar="M", type=float, help="how deep to dive [over the highest place of the way]")
    over.add_argument(
        "--length", metavar="M", type=float, default=70.0, help="of the way if none is given [%(default)g]"
    )
    options = parser.parse_args(arguments)
    if options.world:
        return _dive(options)
    scenario = load_scenario(options.scenario)
    endpoint = options.listen or scenario.slave.listen
    require_free(endpoint, routed=scenario.network.mode == "routed")
    folder = make_folder(options.run_dir) if options.run_dir else new_folder(options.scenario)
    return _run(options.scenario, endpoint, folder, lambda: None)


def _place(text: str) -> tuple[float, float]:
    latitude, longitude = map(float, text.split(","))
    return latitude, longitude


def _dive(options: argparse.Namespace) -> int:
    """Make a world and a way, fly there, and report what was seen."""
    _require_extras()
    from hil.charts.dive import Wish, prepare_dive
    from hil.charts.dive_watch import DiveWatch

    endpoint = options.listen or Wish().listen
    require_free(endpoint)  # now: to find a place takes long
    folder = make_folder(options.run_dir) if options.run_dir else new_folder(options.world)
    print(f"looking for a place to dive in {options.world}", flush=True)
    wish = Wish(options.start, options.goal, options.depth, options.length, endpoint)
    path = prepare_dive(options.world, wish, folder)
    scenario = load_scenario(path)
    require_free(endpoint)
    with DiveWatch(scenario) as watch:
        code = _run(path, endpoint, folder, watch.look)
    from hil.charts.dive_report import write_report

    files = write_report(folder, scenario, watch.looks, watch.figures())
    print(f"what it saw: {files[-1]}")
    return code


def _require_extras() -> None:
    """Raise MissingExtraError unless there is what a dive over a chart needs."""
    missing = [name for name in ("numpy", "scipy", "matplotlib", "PIL") if find_spec(name) is None]
    if missing:
        raise MissingExtraError(
            f"a chart's seabed needs {', '.join(missing)}: pip install 'uuv-hil[master,chart,imaging]'"
        )


def require_free(endpoint: str, routed: bool = False) -> None:
    """Raise NetworkError unless a slave of this machine can listen at `endpoint`; unless `routed` on the next port too.

    Otherwise the demo's master would arm and command the vehicle of whoever is there.
    """
    _, host, port = split(endpoint)
    for number in (port,) if routed else (port, port + 1):
        try:
            family, *_, address = socket.getaddrinfo(host.strip("[]"), number, type=socket.SOCK_STREAM)[0]
            with socket.socket(family) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # the last demo's connections do not count
                probe.bind(address)
        except OSError as error:
            raise NetworkError(
                f"{endpoint} is not free for the demo's slave (port {number}: {error.strerror}), and a vehicle of "
                "others it must not command; end what runs there, or choose another place: "
                f"--listen tcp/127.0.0.1:{free_ports(1)[0]}"
            ) from None


def _run(scenario: str, endpoint: str, folder: str, look: Callable[[], None]) -> int:
    """Run both processes; the master's exit code. `look` is called again and again meanwhile."""
    log_path = os.path.join(folder, "slave.log")
    with StopSignals() as stop_fd, open(log_path, "w") as log:
        master, ready_fd = _start_master(scenario, endpoint, folder)
        slave = None
        try:
            if not _dials(ready_fd, stop_fd):
                return master.wait(GRACE_S)
            print(f"starting the slave (its log: {log_path})", flush=True)
            slave = _start_slave(scenario, endpoint, log)
            return _watch(master, slave, stop_fd, log_path, look)
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


def _start_slave(scenario: str, endpoint: str, log: object) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "hil.cli", "slave", scenario, "--listen", endpoint]
    environment = os.environ | {"UUV_HIL_EXEC_NS": str(now_ns())}
    return subprocess.Popen(command, stderr=log, env=environment, start_new_session=True)  # type: ignore[call-overload, no-any-return]


def _watch(
    master: subprocess.Popen[bytes],
    slave: subprocess.Popen[bytes],
    stop_fd: int,
    log_path: str,
    look: Callable[[], None],
) -> int:
    while master.poll() is None:
        look()
        if select.select((stop_fd,), (), (), 0.1)[0]:
            raise KeyboardInterrupt
        if slave.poll() is not None and master.poll() is None:
            master.kill()  # told to end it would print the table of a run that was none
            if sys.stdout.isatty():
                print()  # after its line of progress
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
