"""Results of a benchmark as a file: figures with all their values, and the machine."""

import json
import statistics
import time
from collections.abc import Iterable, Sequence
from math import isfinite, nan
from typing import Any, Literal, NamedTuple, get_args

from hil.bench.machine import describe
from hil.common.errors import ConfigError
from hil.common.quantiles import quantile
from hil.common.tables import read_bytes, save_text
from hil.common.text import json_text

FORMAT = "uuv-hil bench 1"
LARGEST = 256 << 20  # bytes of a file; an hour of values takes a tenth
Better = Literal["lower", "higher", ""]


class Figure(NamedTuple):
    """One quantity: its values, one for each repetition or sample, and whether a lower or a higher one is better."""

    values: list[float]
    unit: str
    better: Better = "lower"

    @property
    def median(self) -> float:
        """Median of the values; nan without values."""
        return median(self.values)

    @property
    def finite(self) -> "Figure":
        """Return the figure without nan values."""
        return self._replace(values=list(filter(isfinite, self.values)))

    @property
    def spread(self) -> float:
        """The range of the middle half."""
        return spread(self.values)

    def at(self, share: float) -> float:
        """Return the quantile of that share (0..1)."""
        return quantile(sorted(self.values), share)


class Record(NamedTuple):
    """One run of a benchmark. `kind` is its name, `settings` its options, `details` other findings.

    `labels` are the conditions under which the figures do not stand for the bare machine: emulated, limited.
    """

    kind: str
    settings: dict[str, Any]
    figures: dict[str, Figure]
    labels: tuple[str, ...] = ()
    details: dict[str, Any] = {}  # noqa: RUF012 - never changed
    machine: dict[str, Any] = {}  # noqa: RUF012 - never changed
    made: str = ""

    @property
    def footer(self) -> str:
        """Machine, date and labels of the figures, as text below a picture."""
        machine = self.machine
        where = f"{machine['name']}: {machine['board'] or machine['cpu']}, {machine['usable_cores']} processors"
        return "\n".join([f"{where}; {self.made}", "; ".join(self.labels)]).strip()


def new_record(
    kind: str,
    settings: dict[str, Any],
    figures: dict[str, Figure],
    labels: Iterable[str] = (),
    details: dict[str, Any] | None = None,
) -> Record:
    """Return a record with the present time and this machine, without nan values."""
    machine, own_labels = describe()
    finite = {name: figure.finite for name, figure in figures.items()}
    made = time.strftime("%Y-%m-%dT%H:%M:%S%z")
    return Record(kind, settings, finite, (*own_labels, *labels), details or {}, machine, made)


def save(record: Record, path: str) -> None:
    """Write it as JSON. Raises ConfigError."""
    figures = {name: figure._asdict() | _summary(figure) for name, figure in record.figures.items()}
    text = json_text({"format": FORMAT, **record._asdict(), "figures": figures}, indent=1)
    save_text(path, text + "\n")


def load(path: str) -> Record:
    """Read what `save` wrote. Raises ConfigError."""
    try:
        table = json.loads(read_bytes(path, LARGEST))
        if table.pop("format") != FORMAT:
            raise KeyError("format")
        if not isinstance(table["labels"], list):
            raise TypeError("labels")
        figures = {name: _figure(row) for name, row in table.pop("figures").items()}
        record = Record(**{**table, "labels": tuple(table["labels"])}, figures=figures)
        _check(record)
        return record
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        raise ConfigError(f"{path}: is not a result of `uuv-hil bench`; write one with --output FILE") from None


def _summary(figure: Figure) -> dict[str, float]:
    return {"count": len(figure.values), "median": figure.median, "spread": figure.spread}


def _figure(row: dict[str, Any]) -> Figure:
    """Return one figure of a record. Raises ValueError and others."""
    values = row["values"]
    if not all(type(value) in (int, float) and isfinite(value) for value in values):
        raise ValueError("values")
    if not isinstance(row["unit"], str) or row["better"] not in get_args(Better):
        raise ValueError("unit, better")
    return Figure([float(value) for value in values], row["unit"], row["better"])


def _check(record: Record) -> None:
    """Check the types of a record. Raises ValueError."""
    tables = (record.settings, record.details, record.machine)
    if not all(isinstance(table, dict) for table in tables):
        raise ValueError("settings, details, machine")
    if not all(isinstance(word, str) for word in (record.kind, record.made, *record.labels)):
        raise ValueError("kind, made, labels")


def median(values: Sequence[float]) -> float:
    """Return the middle value, or the mean of the two middle ones; nan without values."""
    return statistics.median(values) if values else nan


def spread(values: Sequence[float]) -> float:
    """Return the range of the middle half of the values (the interquartile range); nan without values."""
    ordered = sorted(values)
    return quantile(ordered, 0.75) - quantile(ordered, 0.25)
