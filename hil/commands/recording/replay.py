"""`uuv-hil recording replay`: replay a recording on the network, or bit for bit in the simulator."""

import argparse

from hil.commands.listening import add_wait
from hil.commands.recording.options import add_recording
from hil.commands.view.opening import open_view
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import STOPPED, MissionError
from hil.common.options import ENDPOINT, OUTPUT_FILE, Number, new_parser
from hil.common.stop import StopSignals, is_stopped
from hil.gateways.foxglove.recording import write_for_foxglove
from hil.network.opening import listen
from hil.recording.check import check
from hil.recording.player import Player, pace
from hil.recording.reader import read_about, read_messages
from hil.recording.run import read_run
from hil.ros import dialect
from hil.view.sources.recorded import RecordedSource

EXAMPLES = """\
examples:
  uuv-hil recording replay recordings/dive7                                    for masters that connect to this machine
  uuv-hil recording replay dive7.mcap --listen tcp/0.0.0.0:7447 --speed 10     ten times as fast
  uuv-hil recording replay dive7 --view                                        in a browser, with a slider
  uuv-hil recording replay dive7 --foxglove dive7_foxglove.mcap                for `uuv-hil gateway foxglove --layout`
  uuv-hil recording replay dive7 --check                                       that the simulator repeats it bit for bit

--check needs a slave's own recording ([recording] slave = true). It runs the simulator with the recorded pulses of
the thrusters, step by step, and compares every sensor message with the recorded one; exit code 6 at a difference.
The recording's scenario can name classes for forces and sensors, and loading a class runs its code: this is refused
without --own-classes, which is for your own recordings.
"""
LISTEN = "tcp/127.0.0.1:7447"
WAIT_STEP_S = 0.02
SPEED = Number(0.001, 1000.0, also=(0,))


def main(arguments: list[str]) -> int:
    """Replay in the chosen mode; return the exit code."""
    parser = new_parser("recording replay", __doc__, EXAMPLES)
    add_recording(parser)
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument(
        "--listen", metavar="ENDPOINT", type=ENDPOINT, default=LISTEN, help="publish it at this endpoint [%(default)s]"
    )
    mode.add_argument("--check", action="store_true", help="repeat it without network and clock")
    mode.add_argument(
        "--foxglove",
        metavar="FILE.mcap",
        type=OUTPUT_FILE,
        help="write one file for Foxglove, with seabed and vehicle; its folder must be there",
    )
    mode.add_argument("--view", action="store_true", help="show it in a browser")
    parser.add_argument(
        "--speed", metavar="X", type=SPEED, default=1.0, help="speed factor; 0: as fast as possible [%(default)g]"
    )
    add_wait(parser, 0.0, "a subscriber")
    options = parser.parse_args(arguments)
    if options.check:
        return _check(options.recording, options.own_classes)
    if options.foxglove:
        copied = write_for_foxglove(options.recording, options.foxglove, options.own_classes)
        print(f"{options.foxglove}: {copied} messages of {options.recording}, and the scene")
        return 0
    with StopSignals() as stop_fd:
        if options.view:
            return _show(options.recording, options.own_classes, stop_fd)
        return _play(options, stop_fd)


def _check(path: str, own_classes: bool) -> int:
    began = now_ns()
    compared, steps, difference = check(path, own_classes)
    took = (now_ns() - began) / NS_PER_S
    if difference:
        raise MissionError(f"{path}: {compared} messages are the same, then the simulator differs: {difference}")
    print(f"the same bit for bit: {compared} messages of {steps} steps, repeated in {took:.2f} s")
    return 0


def _play(options: argparse.Namespace, stop_fd: int) -> int:
    read_about(options.recording)  # raises for a bad file before the network is opened
    messages = read_messages(options.recording)
    with listen(options.listen) as session:
        print(f"playing {options.recording} at {options.listen}; Ctrl-C ends it", flush=True)
        deadline = now_ns() + round(options.wait * NS_PER_S)
        has_subscribers = session.watch_keys(f"{dialect.domain()}/**")
        while not has_subscribers() and now_ns() < deadline:
            if is_stopped(stop_fd, WAIT_STEP_S):
                return STOPPED
        player = Player(session)
        began = now_ns()
        seconds = pace(messages, options.speed, stop_fd, player.send)
    print(f"{player.sent} messages of {seconds:.1f} s played in {(now_ns() - began) / NS_PER_S:.1f} s")
    if player.unknown:
        print(f"left out, of types unknown here: {', '.join(sorted(player.unknown))}")
    return 0


def _show(path: str, own_classes: bool, stop_fd: int) -> int:
    from hil.view.live_view import PERIOD_S
    from hil.view.scene.content import SceneContent

    source = RecordedSource(path)
    run = read_run(read_about(path), path, own_classes)
    content = SceneContent()
    if run:
        master = run.scenario.master
        content = SceneContent(run.world, dict.fromkeys(source.names, run.vehicle), (), master.depth, master.goal)
    with open_view(source, content) as view:
        while not is_stopped(stop_fd, PERIOD_S):
            view.update()
    return 0
