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
    fields = [{key: float("nan") if row[key] is None else row[key] for key in Row._fields} for row in rows]
    return HEAD + markdown([Row(**row | {"problems": tuple(row["problems"])}) for row in fields])
