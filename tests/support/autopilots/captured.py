"""Recordings of real autopilots beside the project: gzip, a JSON object a line with `t`, `dir` and `hex` or `text`."""

import gzip
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

FOLDER = os.environ.get("UUV_HIL_CAPTURES", "")
needs_captures = pytest.mark.skipif(not FOLDER, reason="UUV_HIL_CAPTURES does not say where the recordings are")


class Row(NamedTuple):
    """One read or write: seconds, "ap>sim" or the like, and its bytes."""

    t: float
    direction: str
    data: bytes


def rows(name: str) -> Iterator[Row]:
    """Yield the rows of a recording."""
    with gzip.open(Path(FOLDER) / f"{name}.jsonl.gz", "rt", encoding="utf-8") as file:
        for line in file:
            row = json.loads(line)
            data = bytes.fromhex(row["hex"]) if "hex" in row else row["text"].encode()
            yield Row(row["t"], row["dir"], data)
