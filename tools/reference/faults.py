"""Reference page of the fault campaign's rows, from the file of its last run."""

import json
from pathlib import Path
from typing import Any

from tools.faults.report import markdown
from tools.faults.rows import Row

FILE = Path(__file__).parents[2] / "docs" / "explanation" / "reliability" / "faults.json"
HEAD = """\
# Rows of the fault campaign

What the columns mean and how a row is measured: [Reliability](../explanation/reliability.md#the-fault-campaign). This
page is made by `python -m tools.reference` from the file `faults.json` of a run of the whole campaign.

"""


def page() -> str:
    """Return the page."""
    rows: list[dict[str, Any]] = json.loads(FILE.read_text(encoding="utf-8"))["rows"]
    return HEAD + markdown([_row(row) for row in rows])


def _row(values: dict[str, Any]) -> Row:
    known: dict[str, Any] = {key: float("nan") if values[key] is None else values[key] for key in Row._fields}
    return Row(**known | {"problems": tuple(known["problems"])})
