"""A Grafana dashboard of the figures that `uuv-hil top --prometheus` serves, as JSON to import."""

import json
from typing import Any, NamedTuple

SOURCE = {"type": "prometheus", "uid": "${source}"}
WIDTH, HEIGHT = 8, 7  # of a panel, in Grafana's grid of 24 columns
OF_NODES = '{node=~"$node"}'


class Panel(NamedTuple):
    """A panel over time: its curves by label, each a figure of `hil.gateways.prometheus.endpoint` or a rate of one.

    `unit` is a unit's name of Grafana. `over`, a span such as "1m", makes curves of the rise a second during it.
    """

    title: str
    unit: str
    curves: dict[str, str]
    over: str = ""


PANELS = (
    Panel("Slaves that answer (1) and that are lost (0)", "none", {"": "up"}),
    Panel("Processor time of the slave, of one core", "percentunit", {"": "cpu_share"}),
    Panel("Memory of the slave (PSS)", "bytes", {"": "pss_bytes"}),
    Panel("Rate of the loop", "hertz", {"": "loop_rate_hertz"}),
    Panel("Lateness of the loop in the last second", "s", {
        "p50": "loop_lateness_recent_p50_seconds", "p99": "loop_lateness_recent_p99_seconds",
        "max": "loop_lateness_recent_max_seconds",
    }),
    Panel("Steps that the loop skipped, a second", "none", {"": "loop_steps_skipped_total"}, "1m"),
    Panel("Real-time factor", "none", {"": "real_time_factor"}),
    Panel("Commands a second", "none", {
        "received": "commands_received_total", "stale": "commands_stale_total", "refused": "commands_refused_total",
        "malformed": "commands_malformed_total", "unanswered": "commands_unanswered_total",
    }, "1m"),
    Panel("Messages published a second", "none", {"": "messages_sent_total"}, "1m"),
    Panel("Trips and faults since the start", "none", {
        "deadman": "deadman_trips_total", "watchdog": "watchdog_trips_total", "link lost": "link_losses_total",
        "checksum": "link_checksum_errors_total",
    }),
    Panel("Contacts and events since the start", "none", {"contacts": "contacts_total", "events": "run_events_total"}),
    Panel("Clock of the slave minus that of the master", "s", {
        "offset": "clock_offset_seconds", "uncertainty": "clock_uncertainty_seconds",
    }),
    Panel("Network of the board", "Bps", {
        "received": "network_received_bytes_total", "sent": "network_sent_bytes_total",
    }, "1m"),
    Panel("Temperature of the board", "celsius", {"": "temperature_celsius"}),
    Panel("Load of the board, and whether it is slowed down", "none", {"load": "load_1min", "slowed": "throttled"}),
    Panel("Memory left on the board", "bytes", {"": "memory_available_bytes"}),
)  # fmt: skip


def dashboard() -> str:
    """Return the dashboard as JSON; it has variables for the Prometheus server and the vehicles."""
    nodes = {
        "name": "node", "label": "vehicle", "type": "query", "datasource": SOURCE, "refresh": 2, "multi": True,
        "query": {"query": "label_values(uuv_hil_up, node)", "refId": "node"}, "includeAll": True, "allValue": ".*",
    }  # fmt: skip
    source = {"name": "source", "label": "Prometheus server", "type": "datasource", "query": "prometheus"}
    return json.dumps(
        {
            "title": "uuv-hil",
            "uid": "uuv-hil",
            "schemaVersion": 39,
            "refresh": "5s",
            "time": {"from": "now-15m", "to": "now"},
            "templating": {"list": [source, nodes]},
            "panels": [_panel(number, panel) for number, panel in enumerate(PANELS)],
        },
        indent=2,
    )


def expressions(panel: Panel) -> dict[str, str]:
    """Return the queries of a panel in the language of Prometheus, by their labels."""
    figures = {label: f"uuv_hil_{figure}{OF_NODES}" for label, figure in panel.curves.items()}
    return {label: f"rate({text}[{panel.over}])" if panel.over else text for label, text in figures.items()}


def _panel(number: int, panel: Panel) -> dict[str, Any]:
    across = 24 // WIDTH
    return {
        "id": number + 1,
        "type": "timeseries",
        "title": panel.title,
        "datasource": SOURCE,
        "gridPos": {"w": WIDTH, "h": HEIGHT, "x": WIDTH * (number % across), "y": HEIGHT * (number // across)},
        "fieldConfig": {"defaults": {"unit": panel.unit, "custom": {"spanNulls": False}}, "overrides": []},
        "targets": [
            {"refId": chr(ord("A") + place), "expr": text, "legendFormat": f"{{{{node}}}} {label}".strip()}
            for place, (label, text) in enumerate(expressions(panel).items())
        ],
    }
