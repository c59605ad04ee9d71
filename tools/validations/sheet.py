"""Parts of the pictures of docs/reference/validation.md: panels, and figures that a test checks."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import NullLocator

OURS, WRONG = "tab:blue", "tab:red"
# Several lines of ours in one panel.
SHADES = ("#08306b", "#2171b5", "#6baed6", "#9ecae1")


class Finding(NamedTuple):
    """A figure of this run: description, value, bound, and whether it is within the bound."""

    what: str
    result: str
    bound: str
    holds: bool


class Sheet(NamedTuple):
    """One picture: `draw` fills `rows` x `columns` panels; its docstring is the page's text.

    Its first finding is also in the page's overview. `size` is in inches.
    """

    title: str
    draw: Callable[[Sequence[Axes]], list[Finding]]
    rows: int = 1
    columns: int = 2
    size: tuple[float, float] = (8.0, 3.2)

    @property
    def name(self) -> str:
        """Name of the picture's file, without .png."""
        return self.draw.__name__


def below(what: str, value: float, bound: float, unit: str = "") -> Finding:
    """Return a finding, such as an error, that has to be below `bound`."""
    return Finding(what, _text(value, unit), f"< {_text(bound, unit)}", value < bound)


def above(what: str, value: float, bound: float, unit: str = "") -> Finding:
    """Return a finding that has to be above `bound`."""
    return Finding(what, _text(value, unit), f"> {_text(bound, unit)}", value > bound)


def near(what: str, value: float, expected: float, unit: str = "", rel: float = 0.0, within: float = 0.0) -> Finding:
    """Return a finding that has to equal `expected` to a share of `rel` or to `within`, in its unit."""
    most = max(rel * abs(expected), within)
    margin = _text(within, unit) if within else f"{100.0 * rel:g} %"
    shown = _text(value, unit, 4)
    return Finding(what, shown, f"{_text(expected, unit, 4)} ± {margin}", abs(value - expected) <= most)


def _text(value: float, unit: str, digits: int = 3) -> str:
    return f"{value:.{digits}g} {unit}".rstrip()


def plot_own(axes: Axes, x: Sequence[float], y: Sequence[float], label: str = "ours", color: str = OURS) -> None:
    """Plot values of this simulator as a line."""
    axes.plot(x, y, color=color, label=label)


def plot_ref(axes: Axes, x: Sequence[float], y: Sequence[float], label: str, size: float = 4.0) -> None:
    """Plot reference values, others' numbers or theory, as black dots."""
    axes.plot(x, y, "k.", markersize=size, label=label)


def wrong(axes: Axes, x: Sequence[float], y: Sequence[float], label: str, style: str = "-") -> None:
    """Plot the values of a wrong formula of other software."""
    axes.plot(x, y, style, color=WRONG, label=label)


def ticks(axis: Axis, values: Sequence[float]) -> None:
    """Set ticks with plain numbers on a logarithmic axis."""
    axis.set_ticks(list(values), [f"{value:g}" for value in values])
    axis.set_minor_locator(NullLocator())


def label(axes: Axes, x: str, y: str, title: str = "", legend: str = "best") -> None:
    """Name the axes, with units; `legend` is its place, "" for none."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title)
    axes.grid(alpha=0.3)
    if legend:
        axes.legend(loc=legend)  # type: ignore[call-overload]
