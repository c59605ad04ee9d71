"""Assemble and run the slave; at the end, stop the thrusters."""

import gc
import sys
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING

from hil.common import clock
from hil.common.clock import now_ns, seconds_ns, to_wall_ns
from hil.common.stop import StopSignals
from hil.network.opening import Listening
from hil.ros.topics import TOPICS
from hil.scenario.config import AUTOPILOTS, Scenario, build_simulation
from hil.slave.command_receiver import CommandReceiver
from hil.slave.command_source import CommandSource
from hil.slave.drivers.driver import open_driver, stop_thrusters
from hil.slave.drivers.ends import check_line_rate
from hil.slave.log import Log
from hil.slave.loop import Loop
from hil.slave.pilot import build_pilot
from hil.slave.pilot_source import PilotSource
from hil.slave.publishing import DEPTH, RECORDED_DEPTH, PublishingThread
from hil.slave.sample_publisher import MessageContent, SamplePublisher
from sim.environment.world import load_world
from sim.sensors.variances import error_variances
from sim.vehicle.vehicle import load_vehicle

if TYPE_CHECKING:
    from boards import Board
    from hil.network.session import Session
    from hil.slave.imaging.sensors import Imaging
    from hil.slave.slave_recorder import SlaveRecorder


def run(
    scenario: Scenario, board: "Board | None", network: Listening, startup: dict[str, int], notes: list[str]
) -> None:
    """Run the slave until SIGINT or SIGTERM.

    `network` is the session that is being opened. `startup` maps names of start-up stages to monotonic times (ns), with
    "exec" among them; this function adds the later ones. `notes` are the results of the real-time setup so far.
    Raises ConfigError, DeviceError, and NetworkError, for example if another slave with the same name is running.
    """
    log = Log("slave")
    with ExitStack() as stack:
        stop_fd = stack.enter_context(StopSignals())
        stack.callback(log.flush)
        has_instruments = scenario.slave.instruments and any(each.instrument for each in scenario.sensors.values())
        imaging = _make_imaging(scenario, log.write_line)
        if imaging:
            scenario = imaging.scenario
        loop, receiver = _assemble(scenario, board, network, stack, log, startup)
        loop.begin()
        startup["ready"] = now_ns()
        log.write_line(_ready_message(scenario, loop, startup))
        log.flush()
        from hil.slave.notify import notify  # this and later imports load after the vehicle is ready, to start faster

        notify("READY=1")
        notes = [*notes, *_settle_realtime(scenario)]
        for note in notes:
            log.write_line(note)
        from hil.slave.contacts import Contacts
        from hil.slave.health.reporter import Health
        from hil.slave.ros.node import RosNode

        board, session = board or _detect_board(), network.session()
        loop.ros = ros = RosNode(session, scenario, loop, log.write_line)
        log.publish = ros.publish_line
        stack.callback(ros.close)
        loop.sample_publisher.declare(fitted.topic for fitted in scenario.sensors.values() if not fitted.offloaded)
        ends = session, scenario.slave.node, receiver, loop.sample_publisher
        contacts = Contacts(*ends, log.write_line, scenario.security, scenario.network.lease)
        _watch_network(session, scenario, log.write_line)
        if imaging:
            imaging.start(loop.sample_publisher.stamps, loop.sample_publisher.graph.identity)
            stack.callback(imaging.close)
        if scenario.mavlink and scenario.mavlink.start:
            stack.callback(_start_program(scenario, "gateway", "mavlink"))
        if has_instruments:
            stack.callback(_start_program(scenario, "instruments"))
        with Health(loop, (receiver, ros), log, startup, notes, board, scenario.link, contacts, imaging):
            try:
                loop.run(stop_fd)
                notify("STOPPING=1")
                log.write_line("stopping")
                if contacts.conflict:
                    raise contacts.conflict
            finally:
                neutral = stop_thrusters(loop.driver, loop.source.next_sequence())
                log.write_line(
                    "thrusters neutral" if neutral else "WARNING: the STM32 did not confirm neutral thrusters"
                )


def _watch_network(session: "Session", scenario: Scenario, report: Callable[[str], None]) -> None:
    """Report a router that is not reached, and answer searches, as the scenario requests."""
    if scenario.network.router:
        from hil.slave.router_watch import watch_router

        watch_router(session, scenario.network.router, scenario.security, report)
    if scenario.network.discovery:
        from hil.network.responder import answer_searches

        answer_searches(session, scenario.slave.listen, scenario.network, bool(scenario.security))


def _start_program(scenario: Scenario, *command: str) -> Callable[[], None]:
    """Start a command for this vehicle in its own process, off the slave's timing; return the function that ends it."""
    from hil.common.text import toml_text
    from hil.slave.spawn import start_program

    at = "--connect", scenario.slave.listen, "--vehicle", scenario.slave.node
    changed = [word for key, value in scenario.changes.items() for word in ("--set", f"{key}={toml_text(value)}")]
    return start_program(*command, scenario.path, *at, *changed)


def _settle_realtime(scenario: Scenario) -> list[str]:
    """Lock memory and tune the interpreter as the scenario requests; return a note on each setting."""
    if not scenario.slave.realtime:
        gc.enable()
        return []
    sys.setswitchinterval(0.0005)  # other threads give the interpreter back to the loop sooner
    notes = [clock.lock_memory().text, clock.quiet_garbage_collector()]
    return [*notes, clock.stay_awake()] if scenario.slave.stay_awake else notes


def _make_imaging(scenario: Scenario, report: Callable[[str], None]) -> "Imaging | None":
    """Return the client of the imaging process; None, with nothing imported, if no sensor is offloaded."""
    if not any(fitted.offloaded for fitted in scenario.sensors.values()):
        return None
    from hil.slave.imaging.sensors import Imaging

    return Imaging(scenario, report)


def _detect_board() -> "Board | None":
    """Return the detected board, or None. Called late, because loading the board table lengthens the start."""
    from boards import detect

    return detect()


def _assemble(
    scenario: Scenario,
    board: "Board | None",
    network: Listening,
    stack: ExitStack,
    log: Log,
    startup: dict[str, int],
) -> tuple[Loop, CommandReceiver]:
    slave, report = scenario.slave, log.write_line
    vehicle, control = load_vehicle(scenario.vehicle)
    world = load_world(scenario.world)
    simulation = build_simulation(scenario, vehicle, world)
    startup["simulator"] = now_ns()
    link = scenario.link
    if scenario.stm32 == "device" and link.port == "pty:":
        board = board or _detect_board()
        link = link._replace(port=board.uart or link.port) if board else link
    builtin, ours = scenario.controller == "builtin", scenario.controller != "external"
    if builtin:
        check_line_rate(link, len(vehicle.channels), 1.0 / slave.control_period)
    driver = open_driver(scenario.stm32, link, len(vehicle.channels), ours, scenario.seed, report)
    stack.callback(driver.close)
    startup["link"] = now_ns()
    limits = seconds_ns(slave.command_age_limit), seconds_ns(slave.deadman), scenario.network.command_rate
    receiver = CommandReceiver(*limits, len(vehicle.thrusters), log.wakeup)
    receiver.move = simulation.move_accessories if simulation.accessories else None
    stack.callback(receiver.close)
    session = network.session()
    stack.callback(network.close)
    for note in network.notes:
        report(note)
    startup["session"] = now_ns()
    epoch_ns = to_wall_ns(now_ns()) - simulation.time_ns
    recorder = _open_recorder(scenario, board, epoch_ns, report, stack) if scenario.recording.slave else None
    record, depth = (recorder.record_published, RECORDED_DEPTH) if recorder else (None, DEPTH)
    thread = PublishingThread(depth)
    stack.callback(thread.close)
    excluded_topics = () if scenario.ros.transforms else ("/tf",)
    content = MessageContent(scenario.ros.frame_prefix, excluded_topics, error_variances(scenario.sensors, world))
    publisher = SamplePublisher(session, slave.node, epoch_ns, content, thread=thread, record=record)
    source = CommandSource(driver)
    step_ns = seconds_ns(slave.step)
    if builtin:
        pilot, periods = build_pilot(scenario, vehicle, control, world), (seconds_ns(slave.control_period), step_ns)
        pilot.watch_thrusters(simulation.thruster_reports)
        source = PilotSource(pilot, driver, receiver, *periods, publisher.publish_trace, report)
        deliver = recorder.record_received(receiver.on_message) if recorder else receiver.on_message
        session.subscribe(slave.node, "cmd_$*", deliver, depth=8)
        publisher.graph.subscribes(TOPICS["cmd_vel"], slave.node)
    elif scenario.controller in AUTOPILOTS:
        from hil.slave.autopilot_port import AutopilotPort  # not needed with our own controller

        source = AutopilotPort(scenario, vehicle, world, driver, report)
    stack.callback(source.close)
    loop = Loop(simulation, driver, source, publisher, step_ns, report)
    loop.observers += [recorder] if recorder else []
    return loop, receiver


def _open_recorder(
    scenario: Scenario, board: "Board | None", epoch_ns: int, report: Callable[[str], None], stack: ExitStack
) -> "SlaveRecorder":
    from hil.slave.health.reporter import own_name
    from hil.slave.slave_recorder import open_recorder  # not needed by most runs

    board = board or _detect_board()
    return open_recorder(scenario, board.name if board else own_name(), epoch_ns, report, stack)


def _ready_message(scenario: Scenario, loop: Loop, startup: dict[str, int]) -> str:
    milliseconds = (startup["ready"] - startup["exec"]) / clock.NS_PER_MS
    hands = f"; waiting for {loop.source.software}" if loop.source.software else ""
    return (
        f"ready {milliseconds:.0f} ms after exec: node {scenario.slave.node}, listening on {scenario.slave.listen}, "
        f"STM32 {scenario.stm32} on {loop.driver.port}{hands}"
    )
