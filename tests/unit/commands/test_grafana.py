"""The dashboard for Grafana: it uses served metrics only, and its panels do not overlap."""

import json
from itertools import combinations
from typing import Any

import pytest

from hil.gateways.prometheus.endpoint import METRICS
from hil.gateways.prometheus.grafana import PANELS, dashboard, expressions

OTHERS = {"up", "cpu_share", "throttled"}  # served beside the table
TYPES = "grafana_foundation_sdk"


def test_every_query_uses_a_metric_that_is_served() -> None:
    drawn = {figure for panel in PANELS for figure in panel.curves.values()}
    assert drawn - METRICS.keys() - OTHERS == set()
    # rates of totals only, and totals that grow for hours only as rates or as counts of rare events
    for panel in PANELS:
        assert not panel.over or all(figure.endswith("_total") for figure in panel.curves.values()), panel.title


def test_queries_select_the_chosen_vehicles() -> None:
    texts = [text for panel in PANELS for text in expressions(panel).values()]
    assert all('{node=~"$node"}' in text for text in texts)
    assert 'rate(uuv_hil_commands_received_total{node=~"$node"}[1m])' in texts


def test_panels_do_not_overlap() -> None:
    panels = [panel["gridPos"] for panel in json.loads(dashboard())["panels"]]
    for one, other in combinations(panels, 2):
        beside = one["x"] + one["w"] <= other["x"] or other["x"] + other["w"] <= one["x"]
        above = one["y"] + one["h"] <= other["y"] or other["y"] + other["h"] <= one["y"]
        assert beside or above
    assert max(place["x"] + place["w"] for place in panels) <= 24


def test_grafanas_types_accept_every_key_and_unit() -> None:
    """Grafana's own types read the dashboard and write it again: a key that they do not have would be lost."""
    types = pytest.importorskip(f"{TYPES}.models.dashboard", reason="needs grafana-foundation-sdk, of Python 3.11")
    plugins, encoder = (pytest.importorskip(f"{TYPES}.cog.{name}") for name in ("plugins", "encoder"))
    plugins.register_default_plugins()
    written = json.loads(dashboard())
    read = types.Dashboard.from_json(written)
    assert lost_values(written, json.loads(json.dumps(read, cls=encoder.JSONEncoder))) == []
    query = pytest.importorskip(f"{TYPES}.models.prometheus").Dataquery
    assert all(isinstance(target, query) for panel in read.panels for target in panel.targets)
    units = vars(pytest.importorskip(f"{TYPES}.models.units")).values()
    assert {panel.unit for panel in PANELS} - {unit for unit in units if isinstance(unit, str)} == set()


def lost_values(exported: Any, read: Any, path: str = "") -> list[str]:
    """Return the keys whose values are missing after the round trip."""
    if isinstance(exported, dict):
        return [
            key_path for key, value in exported.items()
            for key_path in (lost_values(value, read[key], f"{path}.{key}") if key in read else [f"{path}.{key}"])
        ]  # fmt: skip
    if isinstance(exported, list) and len(exported) == len(read):
        return [
            key_path
            for row, (one, other) in enumerate(zip(exported, read, strict=True))
            for key_path in lost_values(one, other, f"{path}[{row}]")
        ]
    return [] if exported == read else [path]
