"""The documentation site: it builds without a warning and loads nothing from other hosts."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.clients.browser import open_page
from tests.support.processes import ROOT

pytestmark = pytest.mark.timeout(600)
pytest.importorskip("material", reason="the documentation needs the extra docs")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Provide the folder of the built site."""
    folder = tmp_path_factory.mktemp("site")
    process = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, timeout=400,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    return folder


def test_no_page_loads_from_other_hosts(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|link|img|iframe)\b[^>]*?(?:src|href)=\"?(https?:[^\"\s>]+)", text)
        assert not loaded, f"{page.name} loads {loaded}"
    assert (site / "search" / "search_index.js").stat().st_size > 100_000
    assert "../javascripts/iframe-worker.js" in (site / "tutorials" / "first_flight.html").read_text(encoding="utf-8")


def test_page_of_the_interface_names_the_fields_of_records(site: Path) -> None:
    page = re.sub(r"<[^>]+>", "", (site / "reference" / "python_api.html").read_text(encoding="utf-8"))
    for record in ("LaserSample(", "PlanRequest(", "Done(reason: str, reached: bool = True)"):
        assert record in page
    assert "angle_increment: float" in page


def test_first_hit_of_the_search_answers(site: Path) -> None:
    """A real browser finds the page for each question, in a page opened as a file; no other host gets a request."""
    answers = {
        "connect jetson": "tutorials/zero_to_dive", "lawnmower": "tutorials/zero_to_dive",
        "add a sensor": "tutorials/own_sensor", "own planner": "tutorials/own_planner",
        "dead reckoning": "explanation/covariances", "command delay": "explanation/delay",
        "fastdds": "how-to/ros2_bridge", "thruster fails": "how-to/disturbances", "encrypt": "how-to/certificates",
        "several vehicles": "how-to/fleets", "survey chart": "how-to/charts", "dvl noise": "reference/sensor_keys",
    }  # fmt: skip
    with open_page() as browser_page:
        page, found = browser_page.page, {}
        for question in answers:
            page.goto((site / "tutorials" / "first_flight.html").as_uri())
            page.locator(".md-search__input").first.fill(question, force=True)
            page.keyboard.press("End")  # the search looks when a key goes up
            first = page.locator(".md-search-result__link").first
            first.wait_for(state="attached")
            found[question] = str(first.evaluate("link => link.href.match(/[^/]+.[^/]+(?=.html)/)[0]"))
        assert found == answers
        assert browser_page.hosts <= {""}
