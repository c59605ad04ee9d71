"""`uuv-hil master`: plan and fly a scenario with a slave somewhere on the network."""

import json
import os
import select

from hil.bench import picture, table
from hil.clock import NS_PER_S, now_ns
from hil.commands.parser import new_parser
from hil.config import Scenario, load_scenario
from hil.errors import MissingExtraError, NetworkError
from hil.master.client import VehicleClient
from hil.master.flight import Flight, Outcome, Plan, prepare, require_success
from hil.master.mission import Mission, topics_of
from hil.master.progress import Progress
from hil.master.recorder import RecordedClient, TrackWriter, make_folder, recorded
from hil.stop import StopSignals
from hil.topics import ALL
from hil.transport.recording import new_folder
from hil.transport.recording_mcap import require_library

WAIT_STEP_S = 0.02
ASK_AFTER_S = 2.0  # without a word, look why
EXAMPLES = """\
Start it before the slave and the start-up time is measured too.

examples:
  uuv-hil master paper_field --connect tcp/192.168.3.116:7447
  uuv-hil master mine.toml --connect tcp/127.0.0.1:7447 --run-dir runs/today
  uuv-hil master mine.toml --connect lan               a slave with [network] discovery = true

The folder of the run then holds trajectory.png, table.json, track.csv and master.log.
"""


def main(arguments: list[str]) -> int:
    """Fly one mission; the exit code."""
    parser = new_parser("master", __doc__, EXAMPLES)
    parser.add_argument("scenario", metavar="SCENARIO")
    parser.add_argument(
        "--connect", metavar="ENDPOINT", required=True, help="slave or router, tcp/ADDRESS:PORT; or lan"
    )
    parser.add_argument("--take-over", action="store_true", help="command even if another master does already")
    parser.add_argument("--wait", metavar="S", type=float, default=60.0, help="how long to wait for it [%(default)s s]")
    parser.add_argument("--run-dir", metavar="DIR", help="where to put the results [runs/SCENARIO-TIME]")
    parser.add_argument("--ready-fd", metavar="N", type=int, help="write a line to this descriptor when dialling")
    options = parser.parse_args(arguments)
    scenario = load_scenario(options.scenario)
    if scenario.recording.master:
        require_library()
    folder = make_folder(options.run_dir) if options.run_dir else new_folder(options.scenario)
    plan = prepare(scenario)
    progress = Progress(os.path.join(folder, "master.log"))
    planner = plan.planner
    progress.say(f"{type(planner).__name__} planned a way of {len(planner.path)} points in {plan.duration:.2f} s")
    where = options.connect if options.connect != "lan" else _look_around(options.wait)
    with StopSignals() as stop_fd, _client(where, scenario, plan, int(options.take_over), progress) as client:
        progress.say(f"waiting for {scenario.slave.node} at {where}")
        if options.ready_fd is not None:
            os.write(options.ready_fd, b"\n")
            os.close(options.ready_fd)
        _wait(client, options.wait, stop_fd, progress, scenario)
        outcome, result = _fly(scenario, plan, client, folder, progress, stop_fd)
    _report(scenario, plan, outcome, result, folder, progress)
    require_success(outcome)
    return 0


def _client(where: str, scenario: Scenario, plan: Plan, rank: int, progress: Progress) -> RecordedClient:
    return RecordedClient(
        where,
        scenario.slave.node,
        rank=rank,
        network=scenario.network,
        security=scenario.security,
        report=progress.say,
        topics=(ALL,) if scenario.recording.master else topics_of(plan.planner),
    )


def _look_around(seconds: float) -> str:
    """The endpoint of whoever answers by multicast. Raises NetworkError when nobody does, or several do."""
    from hil.transport.discovery import find

    found = find(seconds)
    if len(found) == 1:
        return found[0]
    if found:
        raise NetworkError(f"several answer in this network: {', '.join(found)}; choose one with --connect")
    raise NetworkError(
        f"nobody answered by multicast within {seconds:g} s; the slave's scenario needs discovery = true in its "
        "[network] section and an address of this network in listen; many access points block multicast: --connect "
        "tcp/ADDRESS:PORT always works"
    )


def _wait(client: VehicleClient, seconds: float, stop_fd: int, progress: Progress, scenario: Scenario) -> None:
    """Until the vehicle has sent a sample and its figures of health, and is ours to command."""
    began = now_ns()
    asked, reason = False, ""
    while not (client.first_sample_wall_ns and client.diagnostics() and not client.in_doubt):
        if select.select((stop_fd,), (), (), WAIT_STEP_S)[0]:
            raise KeyboardInterrupt
        waited = (now_ns() - began) / NS_PER_S
        if not asked and waited > min(ASK_AFTER_S, seconds):
            asked, reason = True, _why_silent(client, scenario)
            progress.say(f"no word from {client.node} yet: {reason}")
        if waited > seconds:
            raise NetworkError(
                f"no vehicle {client.node!r} answered at {client.endpoint} within {seconds:g} s ({reason}); is "
                "`uuv-hil slave` running there, with --listen on an address this machine reaches, and the same "
                "[slave] node?"
            )
    refusal = client.refusal()
    if refusal:
        raise NetworkError(refusal)


def _why_silent(client: VehicleClient, scenario: Scenario) -> str:
    """What stands in the way. Raises NetworkError when that does not pass by waiting."""
    from hil.transport.diagnosis import why_not

    security = scenario.security
    routed = scenario.network.mode == "routed"
    fault = why_not(client.endpoint, security.folder("master") if security else "", routed)
    if fault and fault.lasting:
        raise NetworkError(f"{client.endpoint}: {fault.text}")
    if fault:
        return fault.text
    allowed = f", or its may_listen does not name {security.name('master')!r}" if security else ""
    return f"{client.endpoint} answers, but there is no {client.node!r}{allowed}"


def _fly(
    scenario: Scenario, plan: Plan, client: RecordedClient, folder: str, progress: Progress, stop_fd: int
) -> tuple[Outcome, table.HilTable]:
    health = client.diagnostics()
    first_cpu = (float(health.get("cpu_s", 0.0)), client.latest["diagnostics"].received_ns / NS_PER_S)
    progress.say(f"flying: {scenario.description}")
    with TrackWriter(folder, progress.say) as track, recorded(client, scenario, folder, progress.note):
        flight = Flight(scenario, plan)
        outcome = Mission(flight, scenario.master.command_period, client, track, progress).fly(stop_fd)
    return outcome, table.build(client, outcome, first_cpu)


def _report(
    scenario: Scenario, plan: Plan, outcome: Outcome, result: table.HilTable, folder: str, progress: Progress
) -> None:
    progress.say(f"{outcome.reason} after {outcome.duration:.1f} s: {outcome.summary}")
    progress.say("\n" + table.render(result) + "\n")
    try:
        with open(os.path.join(folder, "table.json"), "w") as file:
            json.dump(table.to_json(result, outcome), file, indent=2)
        picture.draw(folder, scenario, plan)
    except (MissingExtraError, OSError) as error:  # a full disk takes nothing back of what was flown
        progress.say(f"results are missing: {error}")
    progress.say(f"results in {folder}/: {', '.join(sorted(os.listdir(folder)))}")
    progress.close()
