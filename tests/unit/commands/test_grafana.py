"""The dashboard for Grafana: only figures that are served, and panels that do not cover each other."""

import json
from itertools import combinations

from hil.commands.top.grafana import PANELS, dashboard, expressions
from hil.commands.top.prometheus import METRICS

OTHERS = {"up", "cpu_share", "throttled"}  # served beside the table


def test_every_curve_is_a_figure_that_is_served() -> None:
    drawn = {figure for panel in PANELS for figure in panel.curves.values()}
    assert drawn - METRICS.keys() - OTHERS == set()
    # rates of totals only, and totals that grow for hours only as rates or as counts of rare events
    for panel in PANELS:
        assert not panel.over or all(figure.endswith("_total") for figure in panel.curves.values()), panel.title


def test_queries_are_of_the_chosen_vehicles() -> None:
    texts = [text for panel in PANELS for text in expressions(panel).values()]
    assert all('{node=~"$node"}' in text for text in texts)
    assert 'rate(uuv_hil_commands_received_total{node=~"$node"}[1m])' in texts


def test_panels_do_not_cover_each_other() -> None:
    places = [panel["gridPos"] for panel in json.loads(dashboard())["panels"]]
    for one, other in combinations(places, 2):
        beside = one["x"] + one["w"] <= other["x"] or other["x"] + other["w"] <= one["x"]
        above = one["y"] + one["h"] <= other["y"] or other["y"] + other["h"] <= one["y"]
        assert beside or above
    assert max(place["x"] + place["w"] for place in places) <= 24
