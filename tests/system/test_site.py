"""The documentation builds without a warning, and what it builds loads nothing from elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.processes import ROOT

pytest.importorskip("material", reason="the documentation needs the extra docs")


def test_the_site_builds_and_reads_offline(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)],
        cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, timeout=110,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|link|img|iframe)\b[^>]*?(?:src|href)=\"?(https?:[^\"\s>]+)", text)
        assert not loaded, f"{page.name} loads {loaded}"
    assert (tmp_path / "search" / "search_index.js").stat().st_size > 100_000
    assert "../javascripts/iframe-worker.js" in (tmp_path / "tutorials" / "first_flight.html").read_text(
        encoding="utf-8"
    )
