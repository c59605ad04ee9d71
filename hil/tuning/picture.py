"""Draw the result of a tuning: the step responses of each axis before and after."""

from collections.abc import Sequence

from hil.common.palette import COMMANDED, NAVIGATION, TRACK
from hil.plots.plotting import add_legend, pyplot, save_figure
from hil.tuning.search import Tuned
from hil.tuning.step_response import AXES


def draw(title: str, results: Sequence[Tuned], path: str) -> None:
    """Write the picture to `path`. Raises ConfigError, MissingExtraError."""
    plt = pyplot()
    columns = min(2, len(results))
    rows = -(-len(results) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(6.5 * columns, 2.8 * rows), layout="constrained", squeeze=False)
    for panel in axes.flat[len(results) :]:
        panel.set_axis_off()
    for panel, tuned in zip(axes.flat, results, strict=False):
        panel.axhline(tuned.before.size, color=COMMANDED, linewidth=0.8, linestyle="--", label="commanded")
        panel.plot(tuned.before.times, tuned.before.values, label="before", color=NAVIGATION)
        panel.plot(tuned.after.times, tuned.after.values, label="after", color=TRACK)
        panel.set_ylabel(f"{tuned.axis} ({AXES[tuned.axis].unit})")
        panel.set_xlabel("time since the step (s)")
    add_legend(axes.flat[len(results) - 1])
    figure.suptitle(title)
    save_figure(figure, path)
