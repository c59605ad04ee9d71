"""`uuv-hil top`: show how every slave is doing: its loop, processor, memory, link and network."""

import shutil
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

from hil.client.health_watch import HealthWatch, Status, Unanswered
from hil.commands.listening import add_connect, add_settings, add_wait, keys_of, network_of, scenario_and_endpoints
from hil.common.clock import now_ns, seconds_ns
from hil.common.columns import aligned
from hil.common.errors import NetworkError
from hil.common.options import add_json, new_parser, serving_address
from hil.common.stop import StopSignals, is_stopped, pause
from hil.common.text import json_text
from hil.network.roles import open_client_session, open_master_session
from hil.network.security import Security
from hil.network.session import Session
from hil.network.settings import Network
from hil.ros.diagnostics import Diagnostics as Health
from hil.ros.diagnostics import Figure, to_text

EXAMPLES = """\
Reads the diagnostics that each slave publishes once a second (diagnostic_msgs/DiagnosticArray) and nothing else, as an
observer: it disturbs no master. Lateness is that of the last second, and that since the start. --prometheus serves the
same to a monitoring system.

examples:
  uuv-hil top --connect tcp/192.168.3.116:7447
  uuv-hil top --connect tcp/pi1:7447 --connect tcp/pi2:7447      several slaves side by side
  uuv-hil top --once --json                                      for a script
  uuv-hil top --prometheus 9747                      also at http://127.0.0.1:9747/metrics
"""
REDRAW_S = 0.5
STALE_S = 3.0  # age at which figures count as outdated
RED, YELLOW, PLAIN = "\x1b[31m", "\x1b[33m", "\x1b[0m"


def main(arguments: list[str]) -> int:
    """Show until stopped; return the exit code. Raises ConfigError, NetworkError."""
    options = _parser().parse_args(arguments)
    options.once = options.once or options.json
    scenario, endpoints = scenario_and_endpoints(options)
    with StopSignals() as stop_fd, _session(endpoints, *network_of(scenario)) as session, ExitStack() as stack:
        watch = HealthWatch(session)
        routed = bool(scenario and scenario.network.router)
        unanswered = Unanswered(session, watch, endpoints, keys_of(scenario), routed)
        if options.prometheus:
            from hil.gateways.prometheus import Endpoint  # 30 ms and 4 MiB that a terminal does not need

            endpoint = stack.enter_context(Endpoint(options.prometheus, watch))
            print(f"serving {endpoint.address}", flush=True)
        if not options.prometheus or options.once:
            _wait(watch, unanswered, endpoints, options.wait, stop_fd)
        if options.once:
            _settle(watch, options.wait, stop_fd)
            unanswered.check_endpoints()
            if options.json:
                print(as_json(watch.statuses()))
            else:
                print("\n".join([table(watch.statuses(), watch.without_answer()), *_remarks(watch, unanswered)]))
            return 0
        _show(watch, unanswered, endpoints, stop_fd, bool(options.prometheus))
    return 0


def _parser() -> Any:
    parser = new_parser("top", __doc__, EXAMPLES)
    add_connect(parser)
    add_settings(parser)
    parser.add_argument("--once", action="store_true", help="print one table and end")
    add_json(parser)
    parser.add_argument(
        "--prometheus", metavar="[HOST:]PORT", type=serving_address, help="serve the figures to a monitoring system too"
    )
    add_wait(parser, 10.0, "a slave")
    return parser


def _session(endpoints: list[str], network: Network, security: Security | None) -> Session:
    """Open the session: as a client at one endpoint, which may be a router, else as a master of several."""
    if len(endpoints) == 1:
        with suppress(NetworkError):
            return open_client_session(endpoints[0], network, security)
    return open_master_session(*endpoints, network=network, security=security)


def _wait(watch: HealthWatch, unanswered: Unanswered, endpoints: list[str], seconds: float, stop_fd: int) -> None:
    """Wait for the first diagnostics of a slave. Raises NetworkError if none come."""
    deadline = now_ns() + seconds_ns(seconds)
    while not watch.statuses():
        pause(stop_fd, 0.05)
        if now_ns() > deadline:
            unanswered.check_endpoints()
            missing = f"no slave at {', '.join(endpoints)} reported its health within {seconds:g} s"
            remedy = "is `uuv-hil slave` running there, with --listen on an address this machine reaches?"
            raise NetworkError("; ".join([missing, *(unanswered.lines or [remedy])]))


def _settle(watch: HealthWatch, seconds: float, stop_fd: int) -> None:
    """Wait up to `seconds` until each slave has sent two diagnostics, from which rates are computed."""
    deadline = now_ns() + seconds_ns(seconds)
    while now_ns() < deadline and (watch.without_answer() or not all(status.paces for status in watch.statuses())):
        pause(stop_fd, 0.05)


def _show(watch: HealthWatch, unanswered: Unanswered, endpoints: list[str], stop_fd: int, served: bool) -> None:
    live = sys.stdout.isatty()
    printed = ""
    while not is_stopped(stop_fd, REDRAW_S):
        statuses, without_answer = watch.statuses(), watch.without_answer()
        text = table(statuses, without_answer, live) if statuses else f"waiting for a slave at {', '.join(endpoints)}"
        remarks = _remarks(watch, unanswered)
        text = "\n".join([text, *remarks])
        if live:
            width, height = shutil.get_terminal_size()
            lines = [line if "\x1b" in line else line[:width] for line in text.splitlines()]
            print("\x1b[H\x1b[2J" + "\n".join(fit_lines(lines, height - 1, len(remarks))), flush=True)
        elif text != printed and not served:  # as a service beside a slave it would fill the journal
            print(text + "\n", flush=True)
        printed = text


def _remarks(watch: HealthWatch, unanswered: Unanswered) -> list[str]:
    """Return warnings and errors, to be printed below the table."""
    mixed = [
        f"{number} slaves are called {name}, and their figures are mixed: give each a [slave] node of its own"
        for name, number in watch.mixed().items()
    ]
    return [*mixed, *unanswered.lines]


def fit_lines(lines: list[str], max_lines: int, last: int) -> list[str]:
    """Return at most `max_lines` lines: the first ones, how many are left out, and the `last` ones."""
    if len(lines) <= max_lines:
        return lines
    count = max(max_lines - last - 1, 0)
    end = lines[len(lines) - last :]
    return [*lines[:count], f"... {len(lines) - last - count} more lines in a higher window", *end][: max(max_lines, 1)]


def _figure(figure: Figure[float], form: str = ".0f") -> Callable[[Status], str]:
    return lambda status: to_text(figure.read(status.figures), form)


def _pace(counter: Figure[int] | Figure[float], form: str = ".1f") -> Callable[[Status], str]:
    return lambda status: to_text(status.pace(counter), form)


def _counts(*figures: Figure[int]) -> Callable[[Status], str]:
    return lambda status: ", ".join([to_text(figure.read(status.figures)) for figure in figures])


def _text(figure: Figure[str]) -> Callable[[Status], str]:
    return lambda status: figure.read(status.figures) or "-"


def _memory(status: Status) -> str:
    used, all_ = status.figures.pss_mib, status.figures.ram_mib
    return f"{used:.1f} MiB, {used / all_:.2%}" if used is not None and all_ else "-"


def _several(*figures: Figure[float]) -> Callable[[Status], str]:
    def cell(status: Status) -> str:
        values = [to_text(figure.read(status.figures), ".0f") for figure in figures]
        return " / ".join(values) if set(values) != {"-"} else "-"

    return cell


def _traffic(status: Status) -> str:
    paces = [status.pace(figure) for figure in (Health.network_received_bytes, Health.network_sent_bytes)]
    return " / ".join([to_text(None if pace is None else pace * 1e-3, ".1f") for pace in paces])


def _run_events(status: Status) -> str:
    """Return the number of the vehicle's events since the start of its slave, and the latest one."""
    events, count = status.figures.run_event_list, to_text(status.figures.run_events)
    if not events:
        return count
    return f"{count}, last {max(events, key=lambda event: event.end_ns).name}"


# The text of each row, and its figures; a row without any figure is left out.
ROWS: dict[str, Callable[[Status], str]] = {
    "board": _text(Health.board),
    "conditions": lambda status: "; ".join(status.figures.labels or ()) or "-",
    "state": lambda status: status.message if status.present else "GONE",
    "commanded by": _text(Health.commander),
    "loop (Hz)": _figure(Health.loop_rate_hz),
    "late p50 / p99 / max (us)": _several(
        Health.lateness_recent_p50_us, Health.lateness_recent_p99_us, Health.lateness_recent_max_us
    ),
    "the same since the start": _several(Health.lateness_p50_us, Health.lateness_p99_us, Health.lateness_max_us),
    "steps skipped": _counts(Health.steps_skipped),
    "real-time factor": _figure(Health.real_time_factor, ".4f"),
    "CPU (of a core)": _pace(Health.cpu_s, ".1%"),
    "memory (PSS)": _memory,
    "temperature (°C)": _figure(Health.temperature_c, ".1f"),
    "throttled": _text(Health.throttled),
    "services beside it": _text(Health.services),
    "load of the machine": _figure(Health.load_1min, ".2f"),
    "link": lambda status: f"{to_text(status.figures.link_protocol)} {status.figures.link_port or ''}",
    "link losses, damaged frames": _counts(Health.link_losses, Health.link_checksum_errors),
    "events of the run": _run_events,
    "watchdog, deadman trips": _counts(Health.watchdog_trips, Health.deadman_trips),
    "commands (1/s)": _pace(Health.commands_received),
    "stale, refused, malformed": _counts(Health.commands_stale, Health.commands_refused, Health.commands_malformed),
    "messages sent (1/s)": _pace(Health.messages_sent),
    "clock offset (ms)": _figure(Health.clock_offset_ms, "+.3f"),
    "machine's net in / out (kB/s)": _traffic,
    "last report (s ago)": lambda status: f"{status.age_s:.1f}",
}


def as_json(statuses: list[Status]) -> str:
    """Return the diagnostics of each slave by its node, as JSON."""
    return json_text({
        status.node: {"present": status.present, "message": status.message, "age_s": status.age_s,
                      "paces": {**status.paces},
                      "figures": status.figures.as_dict()}
        for status in statuses
    })  # fmt: skip


def table(statuses: list[Status], silent: list[str], colour: bool = False) -> str:
    """Return rows of figures, one column for each slave; with `colour`, problems are highlighted."""
    head = ["", *[status.node for status in statuses]]
    rows = [[name, *[cell(status) for status in statuses]] for name, cell in ROWS.items()]
    lines = aligned([head, *[row for row in rows if any(cell != "-" for cell in row[1:])]], rule=True)
    if colour:
        lines = [_coloured(line, statuses) for line in lines]
    return "\n".join([*lines, *([f"connected, but silent: {', '.join(silent)}"] if silent else [])])


def _coloured(line: str, statuses: list[Status]) -> str:
    is_lost = any(not status.present or status.age_s > STALE_S for status in statuses)
    hot = any(status.figures.throttled not in (None, "no") for status in statuses)
    down = any(status.figures.services not in (None, "running") for status in statuses)
    alarms = {"state": is_lost, "throttled": hot, "services": down}
    if any(line.startswith(name) for name, is_on in alarms.items() if is_on):
        return f"{RED}{line}{PLAIN}"
    skipped = any((status.figures.steps_skipped or 0) > 0 for status in statuses)
    if line.startswith("events of") and any((status.figures.run_events or 0) > 0 for status in statuses):
        return f"{RED}{line}{PLAIN}"
    return f"{YELLOW}{line}{PLAIN}" if line.startswith("steps skipped") and skipped else line
