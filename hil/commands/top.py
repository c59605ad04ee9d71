"""`uuv-hil top`: how every slave is doing, while it flies: its loop, processor, memory, link and network."""

import select
import shutil
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

from hil.clock import now_ns, seconds_ns
from hil.columns import aligned
from hil.commands.parser import new_parser
from hil.config import load_scenario
from hil.errors import ConfigError, NetworkError
from hil.master.health_watch import HealthWatch, Status, Unanswered
from hil.stop import StopSignals
from hil.transport.roles import dial, visit
from hil.transport.session import Session

EXAMPLES = """\
Reads the diagnostics that each slave publishes once a second (diagnostic_msgs/DiagnosticArray) and nothing else, as an
observer: it disturbs no master. Lateness is that of the last second, and that since the start. --prometheus serves the
same to a monitoring system.

examples:
  uuv-hil top --connect tcp/192.168.3.116:7447
  uuv-hil top --connect tcp/pi1:7447 --connect tcp/pi2:7447      several slaves side by side
  uuv-hil top --connect tcp/pi1:7447 --once                      one table, for a script
  uuv-hil top paper_field --prometheus 9747                      also at http://127.0.0.1:9747/metrics
"""
DEFAULT = "tcp/127.0.0.1:7447"
REDRAW_S = 0.5
MOST_WAIT_S = 1e6
STALE_S = 3.0  # after which figures are old news
RED, YELLOW, PLAIN = "\x1b[31m", "\x1b[33m", "\x1b[0m"


def main(arguments: list[str]) -> int:
    """Show until told to stop; the exit code. Raises ConfigError, NetworkError."""
    options = _parser().parse_args(arguments)
    if not 0.0 <= options.wait <= MOST_WAIT_S:
        raise ConfigError(f"--wait {options.wait:g}: expected seconds, such as 5")
    scenario = load_scenario(options.scenario) if options.scenario else None
    endpoints = options.connect or [scenario.slave.listen if scenario else DEFAULT]
    secure: dict[str, Any] = {"network": scenario.network, "security": scenario.security} if scenario else {}
    with StopSignals() as stop_fd, _session(endpoints, secure) as session, ExitStack() as stack:
        watch = HealthWatch(session)
        security = scenario.security if scenario else None
        unanswered = Unanswered(session, watch, endpoints, security.folder("master") if security else "")
        if options.prometheus:
            from hil.commands.top_prometheus import Endpoint

            endpoint = stack.enter_context(Endpoint(options.prometheus, watch))
            print(f"serving {endpoint.address}", flush=True)
        if not options.prometheus or options.once:
            _wait(watch, unanswered, endpoints, options.wait, stop_fd)
        if options.once:
            _settle(watch, options.wait, stop_fd)
            unanswered.ask()
            print("\n".join([table(watch.statuses(), watch.silent()), *_remarks(watch, unanswered)]))
            return 0
        _show(watch, unanswered, endpoints, stop_fd)
    return 0


def _parser() -> Any:
    parser = new_parser("top", __doc__, EXAMPLES)
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", help="whose [network] and [security] hold")
    parser.add_argument(
        "--connect", metavar="ENDPOINT", action="append", help=f"a slave or a router; several times [{DEFAULT}]"
    )
    parser.add_argument("--once", action="store_true", help="print one table and end")
    parser.add_argument("--prometheus", metavar="[ADDRESS:]PORT", help="serve the figures to a monitoring system too")
    parser.add_argument("--wait", metavar="S", type=float, default=5.0, help="how long for a slave [%(default)g s]")
    return parser


def _session(endpoints: list[str], secure: dict[str, Any]) -> Session:
    """A router lets only a visitor hear the others, who can be at one place only; a slave may come later."""
    if len(endpoints) == 1:
        with suppress(NetworkError):
            return visit(endpoints[0], **secure)
    return dial(*endpoints, **secure)


def _wait(watch: HealthWatch, unanswered: Unanswered, endpoints: list[str], seconds: float, stop_fd: int) -> None:
    """Until the first slave has spoken. Raises NetworkError if none does."""
    deadline = now_ns() + seconds_ns(seconds)
    while not watch.statuses():
        _pause(stop_fd, 0.05)
        if now_ns() > deadline:
            unanswered.ask()
            missing = f"no slave at {', '.join(endpoints)} told of its health within {seconds:g} s"
            remedy = "is `uuv-hil slave` running there, with --listen on an address this machine reaches?"
            raise NetworkError("; ".join([missing, *unanswered.lines, remedy]))


def _settle(watch: HealthWatch, seconds: float, stop_fd: int) -> None:
    """Until each has spoken twice, so that paces are known; some may stay silent."""
    deadline = now_ns() + seconds_ns(seconds)
    while now_ns() < deadline and (watch.silent() or not all(status.paces for status in watch.statuses())):
        _pause(stop_fd, 0.05)


def _pause(stop_fd: int, seconds: float) -> None:
    if select.select((stop_fd,), (), (), seconds)[0]:
        raise KeyboardInterrupt


def _show(watch: HealthWatch, unanswered: Unanswered, endpoints: list[str], stop_fd: int) -> None:
    live = sys.stdout.isatty()
    told = ""
    while not select.select((stop_fd,), (), (), REDRAW_S)[0]:
        statuses, silent = watch.statuses(), watch.silent()
        text = table(statuses, silent, live) if statuses else f"waiting for a slave at {', '.join(endpoints)}"
        remarks = _remarks(watch, unanswered)
        text = "\n".join([text, *remarks])
        if live:
            width, height = shutil.get_terminal_size()
            lines = [line if "\x1b" in line else line[:width] for line in text.splitlines()]
            print("\x1b[H\x1b[2J" + "\n".join(fitting(lines, height - 1, len(remarks))), flush=True)
        elif text != told:
            print(text + "\n", flush=True)
        told = text


def _remarks(watch: HealthWatch, unanswered: Unanswered) -> list[str]:
    """What has to be known besides the table."""
    mixed = [
        f"{number} slaves are called {name}, and their figures are mixed: give each a [slave] node of its own"
        for name, number in watch.mixed().items()
    ]
    return [*mixed, *unanswered.lines]


def fitting(lines: list[str], room: int, last: int) -> list[str]:
    """As many as there is room for, among them the `last` ones, and how many are missing."""
    if len(lines) <= room:
        return lines
    kept = max(room - last - 1, 0)
    end = lines[len(lines) - last :]
    return [*lines[:kept], f"... {len(lines) - last - kept} more lines in a higher window", *end][: max(room, 1)]


def _figure(name: str, form: str = "{:.0f}", factor: float = 1.0) -> Callable[[Status], str]:
    def cell(status: Status) -> str:
        value = status.number(name)
        return form.format(value * factor) if value is not None else "-"

    return cell


def _counts(*names: str) -> Callable[[Status], str]:
    return lambda status: ", ".join([status.values.get(name, "-") or "0" for name in names])


def _memory(status: Status) -> str:
    used, all_ = status.number("pss_mib"), status.number("ram_mib")
    return f"{used:.1f} MiB, {used / all_:.2%}" if used is not None and all_ else "-"


def _lateness(when: str) -> Callable[[Status], str]:
    def cell(status: Status) -> str:
        told = [_figure(f"lateness_{when}{name}_us")(status) for name in ("p50", "p99", "max")]
        return " / ".join(told) if set(told) != {"-"} else "-"

    return cell


def _traffic(status: Status) -> str:
    return " / ".join([_figure(f"network_{way}_bytes_s", "{:.1f}", 1e-3)(status) for way in ("received", "sent")])


# What each row says, and of which figures; a row without any figure is left out.
ROWS: dict[str, Callable[[Status], str]] = {
    "board": lambda status: status.values.get("board", "-"),
    "its figures are of": lambda status: status.values.get("labels", "-"),
    "state": lambda status: status.message if status.present else "GONE",
    "commanded by": lambda status: status.values.get("commander") or "-",
    "loop (Hz)": _figure("loop_rate_hz"),
    "late p50 / p99 / max (us)": _lateness("recent_"),  # of the last second
    "the same since its start": _lateness(""),
    "steps skipped": _counts("steps_skipped"),
    "real-time factor": _figure("real_time_factor", "{:.4f}"),
    "CPU (of a core)": _figure("cpu", "{:.1%}"),
    "memory (PSS)": _memory,
    "temperature (°C)": _figure("temperature_c", "{:.1f}"),
    "throttled": lambda status: status.values.get("throttled", "-"),
    "load of the machine": _figure("load_1min", "{:.2f}"),
    "link": lambda status: f"{status.values.get('link_protocol', '-')} {status.values.get('link_port', '')}",
    "link losses, damaged frames": _counts("link_losses", "link_checksum_errors"),
    "watchdog, deadman trips": _counts("watchdog_trips", "deadman_trips"),
    "commands (1/s)": _figure("commands_hz", "{:.1f}"),
    "stale, refused, malformed": _counts("commands_stale", "commands_refused", "commands_malformed"),
    "messages sent (1/s)": _figure("messages_hz", "{:.1f}"),
    "clock offset (ms)": _figure("clock_offset_ms", "{:+.3f}"),
    "machine's net in / out (kB/s)": _traffic,
    "heard (s ago)": lambda status: f"{status.age_s:.1f}",
}


def table(statuses: list[Status], silent: list[str], colour: bool = False) -> str:
    """Rows of figures, a column a slave; in `colour` what is wrong stands out."""
    head = ["", *[status.node for status in statuses]]
    rows = [[name, *[cell(status) for status in statuses]] for name, cell in ROWS.items()]
    lines = aligned([head, *[row for row in rows if any(cell != "-" for cell in row[1:])]], rule=True)
    if colour:
        lines = [_coloured(line, statuses) for line in lines]
    return "\n".join([*lines, *([f"there, but silent: {', '.join(silent)}"] if silent else [])])


def _coloured(line: str, statuses: list[Status]) -> str:
    gone = any(not status.present or status.age_s > STALE_S for status in statuses)
    hot = any(status.values.get("throttled", "no") != "no" for status in statuses)
    if (line.startswith("state") and gone) or (line.startswith("throttled") and hot):
        return f"{RED}{line}{PLAIN}"
    skipped = any((status.number("steps_skipped") or 0) > 0 for status in statuses)
    return f"{YELLOW}{line}{PLAIN}" if line.startswith("steps skipped") and skipped else line
