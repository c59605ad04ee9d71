"""The health of slaves as a Prometheus endpoint: text format 0.0.4 over HTTP.

prometheus_client would replace 60 of these lines. Its import takes twice the processor time of http.server and 4 MiB
more, and it would be one more extra to install.
"""

from collections.abc import Iterable
from typing import Any

from hil.client.health_watch import HealthWatch, Status
from hil.common.errors import NetworkError
from hil.common.web.plain_server import PlainHandler, PlainHttpServer
from hil.ros.diagnostics import Diagnostics as Health
from hil.ros.diagnostics import Figure

FIGURES = (
    "cpu_s", "pss_mib", "loop_rate_hz", "lateness_p50_us", "lateness_p99_us", "lateness_max_us",
    "lateness_recent_p50_us", "lateness_recent_p99_us", "lateness_recent_max_us", "steps_skipped", "real_time_factor",
    "messages_sent", "commands_received", "commands_stale", "commands_refused", "commands_malformed",
    "commands_unanswered", "deadman_trips", "watchdog_trips", "link_losses", "link_checksum_errors", "contacts",
    "run_events", "clock_offset_ms", "clock_uncertainty_ms", "temperature_c", "load_1min", "memory_available_mib",
    "network_received_bytes", "network_sent_bytes",
)  # fmt: skip
BASE_UNITS = {"s": "seconds", "us": "seconds", "ms": "seconds", "mib": "bytes", "hz": "hertz", "c": "celsius"}


def _metric_name(figure: Figure[Any]) -> str:
    """Return the name of a figure with its base unit: cpu_seconds_total of cpu_s."""
    stem, _, unit = figure.name.rpartition("_")
    name = f"{stem}_{BASE_UNITS[unit]}" if unit in BASE_UNITS else figure.name
    return f"{name}_total" if figure.is_counter else name


METRICS: dict[str, Figure[Any]] = {_metric_name(figure): figure for figure in map(Health.FIGURES.__getitem__, FIGURES)}


def exposition(statuses: Iterable[Status]) -> str:
    """Return the metrics of these slaves as text; a slave that is lost has only `uuv_hil_up` 0."""
    slaves = list(statuses)
    present = [slave for slave in slaves if slave.present]
    lines = _metric(
        "up", "gauge", "whether the slave is connected", [(slave, float(slave.present)) for slave in slaves]
    )
    slow = [
        (slave, None if slave.figures.throttled is None else float(slave.figures.throttled != "no"))
        for slave in present
    ]
    lines += _metric("throttled", "gauge", "whether the processor is slowed down", slow)
    shares = [(slave, slave.pace(Health.cpu_s)) for slave in present]
    lines += _metric("cpu_share", "gauge", "share of one core that the slave uses", shares)
    for metric, figure in METRICS.items():
        values = [(slave, _in_base_unit(figure, slave)) for slave in present]
        lines += _metric(metric, "counter" if figure.is_counter else "gauge", figure.meaning, values)
    return "\n".join(lines) + "\n"


def _in_base_unit(figure: Figure[Any], slave: Status) -> float | None:
    value = figure.read(slave.figures)
    return None if value is None else value * figure.base_factor


def _metric(name: str, kind: str, text: str, values: list[tuple[Status, float | None]]) -> list[str]:
    """Return the lines of a metric; none if no slave reported it."""
    rows = [f"uuv_hil_{name}{_labels(slave)} {value:.10g}" for slave, value in values if value is not None]
    return [f"# HELP uuv_hil_{name} {text}", f"# TYPE uuv_hil_{name} {kind}", *rows] if rows else []


def _labels(status: Status) -> str:
    board = (status.figures.board or "").replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")
    return f'{{node="{status.node}",board="{board}"}}'


class Endpoint:
    """Serves `http://HOST:PORT/metrics`, `where` being HOST and PORT. Use as a context. Raises NetworkError."""

    def __init__(self, where: tuple[str, int], watch: HealthWatch) -> None:
        try:
            self._server = PlainHttpServer("prometheus", where, _handler(watch))
        except OSError as error:
            name = f"{where[0]}:{where[1]}"
            raise NetworkError(f"cannot serve at {name}: {error.strerror}; choose another with --prometheus") from None
        address = str(self._server.server_address[0])
        self.address = f"http://{f'[{address}]' if ':' in address else address}:{self._server.server_port}/metrics"

    def __enter__(self) -> "Endpoint":
        self._server.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop()


def _handler(watch: HealthWatch) -> type[PlainHandler]:
    class Handler(PlainHandler):
        """HTTP handler of /metrics; other paths get a hint."""

        def do_GET(self) -> None:  # noqa: N802 - http.server's name
            """Answer a request with the metrics."""
            known = self.path.partition("?")[0] == "/metrics"
            body = (exposition(watch.statuses()) if known else "see /metrics\n").encode()
            self.send_response(200 if known else 404)
            self.send_header("Content-Type", "text/plain; version=0.0.4; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

    return Handler
