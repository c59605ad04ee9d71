"""`uuv-hil recording make`: record what vehicles publish and receive, for Foxglove, PlotJuggler and rosbag2."""

import os
import sys

from hil.commands.listening import add_connect, add_settings, network_of, scenario_and_endpoints
from hil.common.clock import NS_PER_S, now_ns, seconds_ns
from hil.common.errors import DeviceError, NetworkError
from hil.common.options import YEAR_S, Number, add_output, new_parser
from hil.common.stop import StopSignals, is_stopped
from hil.recording.mcap_writer import require_library
from hil.recording.recorder import Recorder, describe, new_folder
from hil.recording.tap import Tap, save_resources
from hil.scenario.config import Scenario
from hil.scenario.records import Recording

EXAMPLES = """\
The folder holds MCAP files and an index; it is a rosbag2 bag. Every file is readable at any time: a recorder that is
killed loses at most its last second. A scenario gives the node's name, the keys of a secured network and the limits of
[recording], and is stored in the files, for pictures with a map.

examples:
  uuv-hil recording make --connect tcp/192.168.3.116:7447                       until Ctrl-C, into recordings/
  uuv-hil recording make --scenario paper_field -o dive7
  uuv-hil recording make --connect tcp/10.0.0.1:7447 --connect tcp/10.0.0.2:7447 --seconds 60
"""
POLL_S = 0.1
SECONDS = Number(0.001, YEAR_S, "s")
REPORT_PERIOD_NS = NS_PER_S


def main(arguments: list[str]) -> int:
    """Record until stopped; return the exit code."""
    parser = new_parser("recording make", __doc__, EXAMPLES)
    add_connect(parser)
    add_settings(parser)
    add_output(parser, "DIR", "a folder for the recording [recordings/NAME-TIME]")
    parser.add_argument("--seconds", metavar="S", type=SECONDS, help="duration [until Ctrl-C]")
    options = parser.parse_args(arguments)
    scenario, endpoints = scenario_and_endpoints(options)
    recording = scenario.recording if scenario else Recording()
    about, files = _about(scenario, endpoints)
    save_resources()
    tap = Tap(endpoints, *network_of(scenario))
    require_library()  # before the folder is made
    folder = options.output or new_folder(scenario.slave.node if scenario else "record", recording.folder)
    recorder = Recorder(folder, recording, about, files, source=tap.receive)  # raises before the network is opened
    with StopSignals() as stop_fd, tap, recorder:
        print(f"recording {', '.join(endpoints)} into {folder}; Ctrl-C ends it", flush=True)
        _wait(recorder, tap, options.seconds, stop_fd)
    if recorder.failure:
        raise DeviceError(recorder.failure)
    if not recorder.written:
        raise NetworkError(f"nothing was recorded: {_why_nothing(endpoints, tap)}")
    losses = ", ".join(f"{n} {word}" for n, word in ((tap.missed, "not received"), (recorder.lost, "not written")) if n)
    print(
        f"{recorder.written} messages recorded{'; ' + losses if losses else ', none lost'}: {_size(folder)} in {folder}"
    )
    return 0


def _about(scenario: Scenario | None, endpoints: list[str]) -> tuple[dict[str, str], dict[str, str]]:
    about, files = describe(scenario, "recorder") if scenario else ({"recorded_by": "recorder"}, {})
    return about | {"endpoints": " ".join(endpoints)}, files


def _why_nothing(endpoints: list[str], tap: Tap) -> str:
    where = ", ".join(endpoints)
    if tap.connected:
        return f"{where} answered but sent no sample; `uuv-hil topic list --connect ENDPOINT` lists its topics"
    return (
        f"no answer from {where}; is `uuv-hil slave` running there, with --listen on an address this machine reaches?"
    )


def _wait(recorder: Recorder, tap: Tap, seconds: float | None, stop_fd: int) -> None:
    """Wait until the end, and report the progress."""
    end = now_ns() + seconds_ns(seconds) if seconds else None
    reported_ns = now_ns()
    while not (recorder.failure or (end and now_ns() > end) or is_stopped(stop_fd, POLL_S)):
        if text := tap.complaint():
            print(("\r\x1b[K" if sys.stdout.isatty() else "") + text, flush=True)
        if sys.stdout.isatty() and now_ns() - reported_ns > REPORT_PERIOD_NS:
            reported_ns = now_ns()
            print(f"\r{recorder.written} messages, {len(tap.connected)} connected", end="\x1b[K", flush=True)
    if sys.stdout.isatty():
        print("\r\x1b[K", end="")


def _size(folder: str) -> str:
    size = sum(entry.stat().st_size for entry in os.scandir(folder))
    return f"{size / (1 << 20):.1f} MiB"
