"""The health of slaves as a Prometheus endpoint: text format 0.0.4 over HTTP."""

import socket
import threading
from collections.abc import Iterable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

from hil.errors import ConfigError, NetworkError
from hil.master.health_watch import HealthWatch, Status

# metric -> figure of the diagnostics or pace, type, help, factor to the base unit
METRICS = {
    "cpu_share": ("cpu", "gauge", "share of one core that the slave uses", 1.0),
    "cpu_seconds_total": ("cpu_s", "counter", "processor time of the slave", 1.0),
    "pss_bytes": ("pss_mib", "gauge", "memory of the slave, proportional set size", 2.0**20),
    "loop_rate_hertz": ("loop_rate_hz", "gauge", "rate of the real-time loop", 1.0),
    "loop_lateness_p50_seconds": ("lateness_p50_us", "gauge", "lateness of the loop, median since start", 1e-6),
    "loop_lateness_p99_seconds": ("lateness_p99_us", "gauge", "lateness of the loop, 99 % since start", 1e-6),
    "loop_lateness_max_seconds": ("lateness_max_us", "gauge", "lateness of the loop, worst since start", 1e-6),
    "loop_lateness_recent_p50_seconds": (
        "lateness_recent_p50_us",
        "gauge",
        "lateness, median of the last second",
        1e-6,
    ),
    "loop_lateness_recent_p99_seconds": ("lateness_recent_p99_us", "gauge", "lateness, 99 % of the last second", 1e-6),
    "loop_lateness_recent_max_seconds": ("lateness_recent_max_us", "gauge", "lateness, worst of the last second", 1e-6),
    "loop_steps_skipped_total": ("steps_skipped", "counter", "steps the loop came too late for", 1.0),
    "real_time_factor": ("real_time_factor", "gauge", "simulated over real time", 1.0),
    "messages_sent_total": ("messages_sent", "counter", "messages sent", 1.0),
    "commands_received_total": ("commands_received", "counter", "commands that came", 1.0),
    "commands_stale_total": ("commands_stale", "counter", "commands dropped as too old", 1.0),
    "commands_refused_total": ("commands_refused", "counter", "commands of masters that have no right", 1.0),
    "commands_malformed_total": ("commands_malformed", "counter", "commands that could not be decoded", 1.0),
    "commands_unanswered_total": ("commands_unanswered", "counter", "commands the STM32 did not answer", 1.0),
    "deadman_trips_total": ("deadman_trips", "counter", "times that commands stopped", 1.0),
    "watchdog_trips_total": ("watchdog_trips", "counter", "times that the STM32 stopped by itself", 1.0),
    "link_losses_total": ("link_losses", "counter", "times that the thruster link went away", 1.0),
    "link_checksum_errors_total": ("link_checksum_errors", "counter", "damaged frames on the thruster link", 1.0),
    "contacts_total": ("contacts", "counter", "touches of seabed and obstacles", 1.0),
    "clock_offset_seconds": ("clock_offset_ms", "gauge", "clock of the master minus that of the slave", 1e-3),
    "clock_uncertainty_seconds": ("clock_uncertainty_ms", "gauge", "uncertainty of that", 1e-3),
    "temperature_celsius": ("temperature_c", "gauge", "of the processor", 1.0),
    "load_1min": ("load_1min", "gauge", "load of the machine", 1.0),
    "memory_available_bytes": ("memory_available_mib", "gauge", "of the machine", 2.0**20),
    "network_received_bytes_total": ("network_received_bytes", "counter", "by all interfaces of the machine", 1.0),
    "network_sent_bytes_total": ("network_sent_bytes", "counter", "by all interfaces of the machine", 1.0),
}


def exposition(statuses: Iterable[Status]) -> str:
    """The metrics of these slaves as text; a slave that is gone has only `uuv_hil_up` 0."""
    slaves = list(statuses)
    lines = ["# HELP uuv_hil_up whether the slave is there", "# TYPE uuv_hil_up gauge"]
    lines += [f"uuv_hil_up{_labels(slave)} {int(slave.present)}" for slave in slaves]
    lines += ["# HELP uuv_hil_throttled whether the processor is slowed down", "# TYPE uuv_hil_throttled gauge"]
    there = [slave for slave in slaves if slave.present]
    told = [(slave, slave.values["throttled"]) for slave in there if "throttled" in slave.values]
    lines += [f"uuv_hil_throttled{_labels(slave)} {int(value != 'no')}" for slave, value in told]
    for metric, (figure, kind, text, factor) in METRICS.items():
        rows = [(slave, slave.number(figure)) for slave in there]
        rows = [(slave, value) for slave, value in rows if value is not None]
        if rows:
            lines += [f"# HELP uuv_hil_{metric} {text}", f"# TYPE uuv_hil_{metric} {kind}"]
            lines += [
                f"uuv_hil_{metric}{_labels(slave)} {value * factor:.10g}" for slave, value in rows if value is not None
            ]
    return "\n".join(lines) + "\n"


def _labels(status: Status) -> str:
    board = status.values.get("board", "").replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
    return f'{{node="{status.node}",board="{board}"}}'


class _Server6(ThreadingHTTPServer):
    address_family = socket.AF_INET6


class Endpoint:
    """Serves `http://ADDRESS:PORT/metrics`. Use as a context. Raises ConfigError, NetworkError."""

    def __init__(self, where: str, watch: HealthWatch) -> None:
        host, _, port = where.rpartition(":")
        if not port.isdigit() or not 0 <= int(port) < 65536:
            raise ConfigError(f"--prometheus {where!r}: expected [ADDRESS:]PORT, such as 9747 or 0.0.0.0:9747")
        try:
            self._server = (_Server6 if ":" in host else ThreadingHTTPServer)(
                (host.strip("[]") or "127.0.0.1", int(port)), _handler(watch)
            )
        except OSError as error:
            raise NetworkError(f"cannot serve at {where}: {error.strerror}; choose another with --prometheus") from None
        self._server.daemon_threads = True
        address = str(self._server.server_address[0])
        self.address = f"http://{f'[{address}]' if ':' in address else address}:{self._server.server_port}/metrics"
        self._thread = threading.Thread(target=self._server.serve_forever, name="prometheus", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(2.0)


def _handler(watch: HealthWatch) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """Answers for /metrics, and points others there."""

        timeout = 5.0

        def do_GET(self) -> None:
            """One page."""
            known = self.path.partition("?")[0] == "/metrics"
            body = (exposition(watch.statuses()) if known else "see /metrics\n").encode()
            self.send_response(200 if known else 404)
            self.send_header("Content-Type", "text/plain; version=0.0.4; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Say nothing of each request."""

    return Handler
