"""`uuv-hil demo`: run slave and master on this machine for one mission, and print the HIL table."""

import argparse
import errno
import os
import select
import signal
import socket
import sys
from collections.abc import Callable
from importlib.util import find_spec

from hil.bench.harness import GRACE_S, Process, program
from hil.charts.dive.watch import DiveWatch
from hil.commands.gridding import add_reading, show_progress
from hil.commands.listening import is_routed
from hil.commands.view.opening import view_process
from hil.common.clock import NS_PER_S, now_ns
from hil.common.endpoint import no_certificates, split_endpoint
from hil.common.errors import ConfigError, MissingExtraError, NetworkError
from hil.common.options import (
    Number,
    add_listen,
    add_output,
    add_scenario,
    add_view,
    changes_of,
    lat_lon,
    new_parser,
    scenario_words,
)
from hil.common.ports import free_ports
from hil.common.stop import StopSignals, pause
from hil.master.recorder import make_folder
from hil.recording.recorder import new_folder
from hil.scenario.attitude_warning import attitude_warning
from hil.scenario.config import load_scenario, load_single

EXAMPLES = """\
examples:
  uuv-hil demo                         the reference platform's field
  uuv-hil demo mine.toml --output out
  uuv-hil demo --view                  also show it in a browser
  uuv-hil demo --listen tcp/127.0.0.1:9000    beside a slave that runs already
  uuv-hil demo --world US5AK5SI.000    over the seabed of a chart, with laser, sonar and camera
  uuv-hil demo --world US5AK5SI.000 --start 59.6032,-151.4117 --goal 59.6032,-151.4101 --depth 6
With --world the results also contain report.html and pictures of the sensors.
"""
FIRST_PICTURE_TIMEOUT_S = 60  # after a short dive: a busy board draws the first pictures late
DEPTH = Number(0.0, 11_000.0, "m")
LENGTH = Number(1.0, 100_000.0, "m")


def main(arguments: list[str]) -> int:
    """Run slave and master as two processes; return the master's exit code."""
    parser = new_parser("demo", __doc__, EXAMPLES)
    add_scenario(parser)
    add_output(parser, "DIR", "where to put the results [runs/SCENARIO-TIME]")
    add_view(parser)
    add_listen(parser)
    seabed = parser.add_argument_group("over a seabed of your own")
    seabed.add_argument("--world", metavar="CHART.000", help="a chart, soundings, or a world's .toml or name")
    seabed.add_argument("--start", metavar="LAT,LON", type=lat_lon, help="degrees, with --goal [a place with relief]")
    seabed.add_argument("--goal", metavar="LAT,LON", type=lat_lon, help="goal of the dive; the path to it is planned")
    seabed.add_argument(
        "--depth", metavar="M", type=DEPTH, help="depth of the dive [above the highest place of the path]"
    )
    seabed.add_argument(
        "--length", metavar="M", type=LENGTH, default=70.0, help="length of the path without --goal [%(default)g]"
    )
    add_reading(seabed)
    options = parser.parse_args(arguments)
    if options.world:
        if options.set:
            raise ConfigError("--set changes a scenario, but --world makes its own: leave one of them out")
        return _dive(options)
    scenario = load_single(options.scenario, changes_of(options))
    warning = attitude_warning(scenario)
    if warning:
        print(f"WARNING: {warning}", file=sys.stderr, flush=True)
    endpoint = options.listen or scenario.slave.listen
    if not scenario.security and (problem := no_certificates(endpoint)):
        raise ConfigError(f"--listen: {problem}")
    require_free(endpoint, routed=is_routed(scenario))
    folder = make_folder(options.output) if options.output else new_folder(options.scenario)
    words = scenario_words(options)
    with view_process(words, [endpoint], options.view):
        return _run(words, endpoint, folder, lambda: True)


def _dive(options: argparse.Namespace) -> int:
    """Build a world and a path, fly the path, and report what the sensors saw."""
    _require_extras()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the linear systems are small: more threads only wait
    from hil.charts.dive.prepare import DiveOptions, prepare_dive  # numpy, which a flight without a chart does not need
    from hil.charts.sources.sign import Declared

    endpoint = options.listen or DiveOptions().listen
    require_free(endpoint)  # checked before the search for a place, which takes long
    folder = make_folder(options.output) if options.output else new_folder(options.world)
    print(f"searching {options.world} for a place to dive", flush=True)
    dive = DiveOptions(
        options.start,
        options.goal,
        options.depth,
        options.length,
        endpoint,
        options.resolution,
        Declared(options.positive, options.crs, options.unit, options.layer),
    )
    try:
        path, bed = prepare_dive(options.world, dive, folder, show_progress)
    finally:
        show_progress(1.0)
    if bed:
        print(f"seabed: {bed[0][1]} (--resolution for another grid)", flush=True)
    scenario = load_scenario(path)
    require_free(endpoint)
    with view_process([path], [endpoint], options.view), DiveWatch(scenario) as watch:
        code = _run([path], endpoint, folder, watch.observe)
    from hil.charts.dive.report import write_report

    files = write_report(folder, scenario, watch.observations, watch.diagnostics(), bed)
    print(f"report of the sensors: {files[-1]}")
    return code


def _require_extras() -> None:
    """Raise MissingExtraError if a library that a dive over a chart needs is not installed."""
    missing = [name for name in ("numpy", "scipy", "matplotlib", "PIL") if find_spec(name) is None]
    if missing:
        raise MissingExtraError(
            f"a chart's seabed needs {', '.join(missing)}: pip install 'uuv-hil[master,chart,imaging]'"
        )


def _try_to_bind(host: str, port: int) -> None:
    """Raise OSError if `port` is in use at any address of `host`, or if this machine has none of them.

    "localhost" often has an address of IPv6 too, even where the machine has no IPv6.
    """
    problems: list[OSError] = []
    addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    for family, *_, address in addresses:
        try:
            with socket.socket(family) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # the last demo's connections do not count
                probe.bind(address)
        except OSError as error:
            problems.append(error)
    for problem in problems:
        if problem.errno == errno.EADDRINUSE or len(problems) == len(addresses):
            raise problem


def require_free(endpoint: str, routed: bool = False) -> None:
    """Raise NetworkError unless a slave here can listen at `endpoint`; unless `routed`, on the next port too.

    Otherwise the demo's master would arm and command the vehicle of another slave on this port.
    """
    _, host, port = split_endpoint(endpoint)
    for number in (port,) if routed else (port, port + 1):
        try:
            _try_to_bind(host.strip("[]"), number)
        except OSError as error:
            raise NetworkError(
                f"{endpoint} is not free for the demo's slave (port {number}: {error.strerror}), and the demo "
                "must not command the vehicle of another slave; end what runs there, or choose another endpoint: "
                f"--listen tcp/127.0.0.1:{free_ports(1)[0]}"
            ) from None


def _run(scenario: list[str], endpoint: str, folder: str, observe: Callable[[], bool]) -> int:
    """Run both processes; return the master's exit code. `scenario` are the words of the command line that name it.

    The slave starts when the master connects, so that the measured start-up time is the slave's alone. `observe` is
    called often meanwhile, and returns True once a sensor has seen something. Then the slave is ended.
    """
    log = os.path.join(folder, "slave.log")
    read_fd, write_fd = os.pipe()
    command = [*program(), "master", *scenario, "--connect", endpoint, "--output", folder, "--ready-fd", str(write_fd)]
    with StopSignals() as stop_fd, os.fdopen(read_fd, "rb") as ready:
        processes = [Process(command, pass_fds=(write_fd,))]
        os.close(write_fd)
        try:
            if stop_fd in select.select((read_fd, stop_fd), (), ())[0]:
                raise KeyboardInterrupt
            if not ready.read(1):
                return processes[0].wait(GRACE_S)
            print(f"starting the slave (its log: {log})", flush=True)
            processes.append(Process([*program(), "slave", *scenario, "--listen", endpoint], log))
            return _wait_for_master(processes[0], processes[1], stop_fd, observe)
        finally:
            for process in processes:
                process.stop()


def _wait_for_master(master: Process, slave: Process, stop_fd: int, observe: Callable[[], bool]) -> int:
    while master.running:
        observe()
        pause(stop_fd, 0.1)
        if not slave.running and master.running:
            os.kill(master.pid, signal.SIGKILL)  # ended by SIGTERM, it would print the table of a run that never began
            if sys.stdout.isatty():
                print()  # below the master's line of progress
            raise NetworkError(f"the slave {slave.ending}")
    code = master.wait(GRACE_S)
    deadline_ns = now_ns() + FIRST_PICTURE_TIMEOUT_S * NS_PER_S
    while code == 0 and not observe() and now_ns() < deadline_ns:
        pause(stop_fd, 0.1)
    return code
