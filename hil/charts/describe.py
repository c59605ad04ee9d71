"""Describe a gridded seabed as text: its sources and its quality."""

from collections import Counter

from hil.charts.build import BuiltSeabed, Report
from hil.charts.grid import Grid
from hil.charts.sources.survey import Survey
from sim.environment.obstacles import STANDING, Box, Cylinder
from sim.environment.things.bottom_map import UNKNOWN
from sim.environment.things.natures import NATURES

Facts = tuple[tuple[str, str], ...]  # name, text

BRIDGES = "; bridges are drawn, but their decks are above the water"


def describe(survey: Survey, built: BuiltSeabed) -> Facts:
    """Return facts on the sources, quality and contents of a world."""
    report = built.report
    obstacles: tuple[Cylinder | Box, ...] = (*built.model.cylinders, *built.model.boxes)
    floating = sum(obstacle.bottom < STANDING for obstacle in obstacles)
    return (
        ("source", survey.source),
        *([("rasters", _used(report))] if report.beds else []),
        *facts(built.model.grid, report),
        ("area", f"{percent(report.water)} water, {percent(report.land)} land, {percent(report.unknown)} unknown"),
        ("limits", f"{percent(report.clamped)} of the water moved into the limits of depth areas; "
                   f"{report.off_limits} soundings deeper than the limit of their area"),
        ("obstacles", f"{len(obstacles) - floating} standing on the bed (bed lowered below {report.beds_under} of "
                      f"them), {floating} floating"
                      + (BRIDGES if survey.bridges else "")),
        *_charted_facts(built),
    )  # fmt: skip


def _used(report: Report) -> str:
    """Return the share of the nodes that each raster gave, as text."""
    shares = [f"{percent(share)} of the nodes by {name}" for name, share in report.beds]
    others = max(0.0, 1.0 - report.unknown - sum(share for _, share in report.beds))  # rounding leaves -1e-17
    return ", ".join([*shares, f"{percent(others)} by other sources"])


def _charted_facts(built: BuiltSeabed) -> Facts:
    """Return facts on pipelines, cables, zones and the nature of the bed."""
    charted, bottom = built.model.charted, built.model.bottom
    lines = Counter(f"{pipeline.kind}s" for pipeline in charted.pipelines)
    zones = Counter(f"{zone.kind} areas" for zone in charted.zones)
    facts: list[tuple[str, str]] = []
    if lines or zones:
        facts.append(("charted", ", ".join(f"{count} {kind}" for kind, count in (*lines.items(), *zones.items()))))
    if bottom is not None:
        names = {nature.code: name for name, nature in NATURES.items()}
        shares = [(float((bottom.codes == code).mean()), name) for code, name in names.items()]
        kinds = ", ".join(f"{percent(share)} {name}" for share, name in sorted(shares, reverse=True) if share > 0.0)
        facts.append(("bottom", f"{kinds}; {percent(float((bottom.codes == UNKNOWN).mean()))} unknown"))
    return tuple(facts)


def facts(grid: Grid, report: Report) -> Facts:
    """Return facts on a bed: its grid, its data, and the error at the soundings that were held out."""
    rows, columns = grid.depths.shape
    size = ("grid", f"{rows} x {columns} nodes of {grid.resolution:g} m, deepest {grid.deepest:.1f} m")
    notes = tuple(("note", note) for note in report.notes)
    if not report.soundings:
        data = "rasters only: nothing is interpolated between them"
        if report.guides:
            data = f"{report.guides} points on contours and coasts"
        return (size, ("data", f"{data}, no soundings held out"), *notes)
    return (
        size,
        *notes,
        ("data", f"{report.soundings} soundings, {report.guides} points on contours and coasts"),
        ("held out", f"error {report.rmse:.3g} m RMS at {report.held_out} soundings, {report.linear_rmse:.3g} m by "
                     "linear interpolation of the same soundings and contours within the same limits; "
                     f"{abs(report.bias):.3g} m too {'deep' if report.bias > 0.0 else 'shoal'} on average"),
    )  # fmt: skip


def percent(share: float) -> str:
    """Return a share, 0 to 1, as text in percent."""
    return f"{100.0 * share:.1f} %"
