"""Describe in words what a gridded bed was made of and how good it is."""

from collections import Counter

from hil.charts.build import Built, Report
from hil.charts.grid import Grid
from hil.charts.sources.survey import Survey
from sim.environment.obstacles import STANDING, Box, Cylinder
from sim.environment.things.bottom_map import UNKNOWN
from sim.environment.things.natures import NATURES

Facts = tuple[tuple[str, str], ...]  # name, text

BRIDGES = "; bridges are drawn, but their decks are above the water"


def describe(survey: Survey, built: Built) -> Facts:
    """Return what a world was made of and how good it is."""
    report = built.report
    obstacles: tuple[Cylinder | Box, ...] = (*built.placed.cylinders, *built.placed.boxes)
    floating = sum(obstacle.bottom < STANDING for obstacle in obstacles)
    return (
        ("source", survey.source),
        *([("rasters", _used(report))] if report.beds else []),
        *facts(built.placed.grid, report),
        ("area", f"{percent(report.water)} water, {percent(report.land)} land, {percent(report.unknown)} unknown"),
        ("limits", f"{percent(report.clamped)} of the water held by depth areas; "
                   f"{report.off_limits} soundings deeper than theirs"),
        ("obstacles", f"{len(obstacles) - floating} standing on the bed, {report.beds_under} of which the bed was "
                      f"lowered for; {floating} floating"
                      + (BRIDGES if survey.bridges else "")),
        *_charted_facts(built),
    )  # fmt: skip


def _used(report: Report) -> str:
    """Return how much of the bed is that of each raster."""
    shares = [f"{percent(share)} of the nodes by {name}" for name, share in report.beds]
    others = max(0.0, 1.0 - report.unknown - sum(share for _, share in report.beds))  # rounding leaves -1e-17
    return ", ".join([*shares, f"{percent(others)} by others"])


def _charted_facts(built: Built) -> Facts:
    """Return what else was charted."""
    charted, bottom = built.placed.charted, built.placed.bottom
    lines = Counter(f"{pipeline.kind}s" for pipeline in charted.pipelines)
    zones = Counter(f"{zone.kind} areas" for zone in charted.zones)
    facts: list[tuple[str, str]] = []
    if lines or zones:
        facts.append(("charted", ", ".join(f"{count} {kind}" for kind, count in (*lines.items(), *zones.items()))))
    if bottom is not None:
        names = {nature.code: name for name, nature in NATURES.items()}
        shares = [(float((bottom.codes == code).mean()), name) for code, name in names.items()]
        kinds = ", ".join(f"{percent(share)} {name}" for share, name in sorted(shares, reverse=True) if share > 0.0)
        facts.append(("bottom", f"{kinds}; nothing is known of {percent(float((bottom.codes == UNKNOWN).mean()))}"))
    return tuple(facts)


def facts(grid: Grid, report: Report) -> Facts:
    """Return what is known of a bed: its grid, its data, and the error of soundings that were held out."""
    rows, columns = grid.depths.shape
    size = ("grid", f"{rows} x {columns} nodes of {grid.resolution:g} m, deepest {grid.deepest:.1f} m")
    notes = tuple(("note", note) for note in report.notes)
    if not report.soundings:
        return (size, ("data", "rasters alone: nothing between them is interpolated, and nothing held out"), *notes)
    return (
        size,
        *notes,
        ("data", f"{report.soundings} soundings, {report.guides} places on contours and coasts"),
        ("held out", f"error {report.rmse:.3g} m RMS of {report.held_out} soundings, {report.linear_rmse:.3g} m by "
                     "linear interpolation between the same soundings and contours within the same limits; "
                     f"{abs(report.bias):.2g} m too {'deep' if report.bias > 0.0 else 'shoal'} in the mean"),
    )  # fmt: skip


def percent(share: float) -> str:
    """Return a share of 1 in percent."""
    return f"{100.0 * share:.1f} %"
