"""`uuv-hil sim` with an autopilot as the controller: no planner runs, a ground station commands the vehicle."""

import json
import sys
import time
from argparse import Namespace
from contextlib import ExitStack
from functools import partial
from typing import Any

from hil.autopilots.run import AutopilotRun
from hil.commands.sim.watching import logged, pace
from hil.common.clock import NS_PER_S
from hil.common.errors import STOPPED, MissionError
from hil.common.streams import ProgressLine
from hil.plots.run_picture import draw_flight
from hil.scenario.config import Scenario
from sim.run_events import merge_events

SHOWN_STEPS = 200


def fly_autopilot(scenario: Scenario, options: Namespace) -> int:
    """Run vehicle and autopilot for [master] time_limit of simulated time; return the exit code."""
    line = ProgressLine()

    def report(text: str) -> None:
        line.clear()
        print(text, file=sys.stderr, flush=True)

    with ExitStack() as opened:
        run = opened.enter_context(AutopilotRun(scenario, report))
        watches = [_progress_watch(line), *pace(options, scenario, run, opened)]
        began = time.monotonic()
        interrupted = False
        draw_track = partial(draw_flight, scenario=scenario, world=run.simulation.world)
        with logged(options, run.simulation, watches, draw_track):
            try:
                run.run(scenario.master.time_limit, watches)
            except KeyboardInterrupt:
                interrupted = True
            line.clear()
            events = merge_events(run.simulation.events.events(), run.log.events())
            faults = [event for event in events if event.kind not in scenario.master.allow]
            print(_format_result(run, time.monotonic() - began, faults, options.json))
    if faults:
        raise MissionError(f"{faults[0].describe()}; if that is intended, add {faults[0].kind!r} to [master] allow")
    return STOPPED if interrupted else 0


def _format_result(run: AutopilotRun, duration: float, faults: list[Any], as_json: bool) -> str:
    figures = run.autopilot.figures
    counts = {name: getattr(figures, name) for name in figures.__slots__}
    simulated = run.simulation.time_ns / NS_PER_S
    position = run.simulation.truth().position
    folder = run.program.folder if run.program else ""
    if as_json:
        return json.dumps({
            "duration_s": simulated, "took_s": duration, "position_m": position, "silences": run.motors.silences,
            "folder": folder, "events": [event.describe() for event in faults], **counts,
        })  # fmt: skip
    where = ", ".join(f"{x:.2f}" for x in position)
    listed = ", ".join(f"{number} {name}" for name, number in counts.items())
    speed = f"{simulated / duration:.3g} times real time" if duration else ""
    kept = f"\nlogs, parameters and missions in {folder}" if folder else ""
    return (
        f"{simulated:.1f} s simulated in {duration:.2f} s: {speed}\n{run.autopilot.name}: {listed}\n"
        f"ends at {where} m{kept}"
    )


def _progress_watch(line: ProgressLine) -> Any:
    steps = 0

    def watch(run: AutopilotRun) -> None:
        nonlocal steps
        steps += 1
        if steps % SHOWN_STEPS == 0:
            depth = run.simulation.state.position[2]
            line.show(
                f"{run.simulation.time_ns / NS_PER_S:.1f} s, depth {depth:.2f} m, {' '.join(map(str, run.pwm_us))}"
            )

    return watch
