"""`uuv-hil master`: plan and fly a scenario with a slave somewhere on the network."""

import json
import os

from hil.bench.table import hil_table as table
from hil.client.client import VehicleClient
from hil.commands.listening import add_take_over, add_wait, is_routed, keys_of, own_endpoint
from hil.commands.view.opening import view_process
from hil.common.clock import NS_PER_S, now_ns
from hil.common.endpoint import LAN, no_certificates
from hil.common.errors import STOPPED, ConfigError, MissingExtraError, NetworkError
from hil.common.options import (
    DESCRIPTOR,
    add_member,
    add_output,
    add_scenario,
    add_view,
    changes_of,
    endpoint_or_lan,
    new_parser,
    scenario_words,
)
from hil.common.stop import StopSignals, pause
from hil.master.flight import Flight, Outcome, Plan, prepare, require_success
from hil.master.guidance import narrow_turn
from hil.master.mission import STOPPED as INTERRUPTED
from hil.master.mission import Mission
from hil.master.planner import topics_of
from hil.master.progress import Progress
from hil.master.recorder import RecordedClient, TrackWriter, make_folder, recorded
from hil.network.diagnosis import why_not
from hil.plots import run_picture as picture
from hil.recording.mcap_writer import require_library
from hil.recording.recorder import new_folder
from hil.ros.topics import ALL
from hil.scenario.config import Scenario, load_scenario, load_single
from hil.scenario.fleet import as_member

MIN_DELAYS = 1 << 13  # commands whose delays the table covers: 7 minutes at 20 Hz
WAIT_STEP_S = 0.02
DIAGNOSE_AFTER_S = 2.0  # without a sample, report why none arrives
EXAMPLES = """\
Start it before the slave and the start-up time is measured too.

examples:
  uuv-hil master paper_field                           its slave runs on this machine
  uuv-hil master paper_field --connect tcp/192.168.3.116:7447
  uuv-hil master mine.toml --connect tcp/127.0.0.1:7447 --output runs/today
  uuv-hil master vessel_and_auv --member auv           one vehicle of a fleet
  uuv-hil master mine.toml --connect lan               a slave with [network] discovery = true

The folder of the run then contains trajectory.png, table.json, track.csv and master.log.
"""


def main(arguments: list[str]) -> int:
    """Fly one mission; return the exit code."""
    parser = new_parser("master", __doc__, EXAMPLES)
    add_scenario(parser)
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        type=endpoint_or_lan,
        help="a slave or a router, HOST:PORT, or lan [the scenario's]",
    )
    add_member(parser)
    add_view(parser)
    add_take_over(parser)
    add_wait(parser, 60.0)
    add_output(parser, "DIR", "where to put the results [runs/SCENARIO-TIME]")
    parser.add_argument(
        "--ready-fd", metavar="N", type=DESCRIPTOR, help="write a line to this descriptor when it connects"
    )
    options = parser.parse_args(arguments)
    if options.member:
        scenario = as_member(load_scenario(options.scenario, changes_of(options)), options.member)
    else:
        scenario = load_single(options.scenario, changes_of(options))
    connect = options.connect or own_endpoint(scenario)
    if connect != LAN and not scenario.security and (problem := no_certificates(connect)):
        raise ConfigError(f"--connect: {problem}")
    if scenario.recording.master:
        require_library()
    folder = make_folder(options.output) if options.output else new_folder(options.scenario)
    plan = prepare(scenario)
    progress = Progress(os.path.join(folder, "master.log"))
    planner = plan.planner
    size = plan.request.map.resolution
    cells = f", in cells of {size:g} m" if size > scenario.master.resolution and scenario.master.map == "known" else ""
    path = f"planned {len(planner.path)} points" if planner.path else "began, without a path to show,"
    progress.print_line(f"{type(planner).__name__} {path} in {plan.duration:.2f} s{cells}")
    if warning := narrow_turn(plan.request):
        progress.print_line(f"WARNING: {warning}")
    words = scenario_words(options)
    with (
        view_process(words, [connect], options.view),
        StopSignals() as stop_fd,
        _client(connect, scenario, plan, int(options.take_over), progress) as client,
    ):
        progress.print_line(f"waiting for {scenario.slave.node} at {connect}")
        if options.ready_fd is not None:
            os.write(options.ready_fd, b"\n")
            os.close(options.ready_fd)
        _wait(client, options.wait, stop_fd, progress, scenario)
        outcome, result = _fly(scenario, plan, client, folder, progress, stop_fd)
    _report(scenario, plan, outcome, result, folder, progress)
    if outcome.reason == INTERRUPTED and not outcome.faults:
        return STOPPED
    require_success(outcome)
    return 0


def _client(endpoint: str, scenario: Scenario, plan: Plan, rank: int, progress: Progress) -> RecordedClient:
    return RecordedClient(
        endpoint,
        scenario.slave.node,
        rank=rank,
        network=scenario.network,
        security=scenario.security,
        report=progress.print_line,
        topics=(ALL,) if scenario.recording.master else topics_of(plan.planner),
    )


def _wait(client: VehicleClient, seconds: float, stop_fd: int, progress: Progress, scenario: Scenario) -> None:
    """Wait until the vehicle has sent a sample and its diagnostics, and accepts our commands."""
    began = now_ns()
    is_reported = False
    while not (client.has_samples and client.diagnostics() and not client.in_doubt):
        pause(stop_fd, WAIT_STEP_S)
        waited = (now_ns() - began) / NS_PER_S
        if not is_reported and waited > min(DIAGNOSE_AFTER_S, seconds):
            is_reported = True
            progress.print_line(f"no sample from {client.node} yet: {_why_silent(client, scenario)}")
        if waited > seconds:
            raise NetworkError(
                f"no vehicle {client.node!r} answered at {client.endpoint} within {seconds:g} s "
                f"({_why_silent(client, scenario)}); is "
                "`uuv-hil slave` running there, with --listen on an address this machine reaches, and the same "
                "[slave] node?"
            )
    client.require_acceptance(pause=lambda step: pause(stop_fd, step))


def _why_silent(client: VehicleClient, scenario: Scenario) -> str:
    """Return why no sample arrives. Raises NetworkError if waiting longer cannot help."""
    security = scenario.security
    fault = why_not(client.endpoint, keys_of(scenario), is_routed(scenario), client.session)
    if fault and fault.lasting:
        raise NetworkError(f"{client.endpoint}: {fault.text}")
    if fault:
        return fault.text
    allowed = f", or its may_listen does not name {security.name('master')!r}" if security else ""
    return f"{client.endpoint} answers, but there is no {client.node!r}{allowed}"


def _fly(
    scenario: Scenario, plan: Plan, client: RecordedClient, folder: str, progress: Progress, stop_fd: int
) -> tuple[Outcome, table.HilTable]:
    first_cpu = table.mark_cpu(client)
    client.delays.store(MIN_DELAYS)
    progress.print_line(f"flying: {scenario.description}")
    with TrackWriter(folder, progress.print_line) as track, recorded(client, scenario, folder, progress.print_limited):
        flight = Flight(scenario, plan)
        outcome = Mission(flight, scenario.master.command_period, client, track, progress).fly(stop_fd)
    return outcome, table.build(client, outcome, first_cpu)


def _report(
    scenario: Scenario, plan: Plan, outcome: Outcome, result: table.HilTable, folder: str, progress: Progress
) -> None:
    progress.print_line(f"{outcome.verdict} after {outcome.duration:.1f} s: {outcome.summary}")
    progress.print_line("\n" + table.render(result, plan.world.name) + "\n")
    try:
        with open(os.path.join(folder, "table.json"), "w", encoding="utf-8") as file:
            json.dump(table.to_json(result, outcome), file, indent=2)
        picture.draw(folder, scenario, plan, outcome.events)
    except (MissingExtraError, OSError) as error:  # the flight counts, also on a full disk
        progress.print_line(f"results are missing: {error}")
    progress.print_line(f"results in {folder}/: {', '.join(sorted(os.listdir(folder)))}")
    progress.close()
