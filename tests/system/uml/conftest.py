"""Tests of this folder that use `guest` run in User Mode Linux, all in one instance that is started for the first.

They are collected, selected and reported here as any others, but run with a kernel that has CAN, network faults and
namespaces (tools/uml.py). In the guest pytest runs the same files and writes its reports as lines of JSON. They are
skipped, with the reason, unless selected by the marker, or where User Mode Linux cannot run.

    pytest -m uml    all of them
    pytest -m uml -rP    with the times that they measure
"""

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from hil.common.errors import DeviceError
from tools import uml

MODULES = ("can-raw", "vcan", "vxcan", "slcan", "veth", "sch-netem", "sch-tbf")
HERE = Path(__file__).parent
INSIDE = "UUV_HIL_UML_REPORTS"  # in there, the file for the reports
MAX_SECONDS = 900.0
REPORTS = pytest.StashKey[dict[str, list[Any]]]()


@pytest.fixture
def guest() -> None:
    """Mark tests that need the other kernel."""


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "uml: runs in User Mode Linux; needs user-mode-linux, busybox-static, gcc")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    own = [item for item in items if item.path.is_relative_to(HERE)]
    reason = _why_not(config) if own and INSIDE not in os.environ else ""
    for item in own:
        item.add_marker("uml")
        item.add_marker(pytest.mark.timeout(MAX_SECONDS + 60.0))  # the first one waits for all of them
        if reason:
            item.add_marker(pytest.mark.skip(reason=reason))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> bool | None:
    """Forward the report from the guest instead of running the test here."""
    if INSIDE in os.environ or not _needs_guest(item) or item.get_closest_marker("skip"):
        return None
    stash = item.session.stash
    if REPORTS not in stash:
        chosen = [other.nodeid for other in item.session.items if _needs_guest(other)]
        stash[REPORTS] = _run_inside(item.config, chosen)
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for report in stash[REPORTS][item.nodeid]:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Write a report to the file of reports when running in the guest."""
    if INSIDE in os.environ:
        with Path(os.environ[INSIDE]).open("a") as file:
            print(json.dumps(report._to_json()), file=file)


def _why_not(config: pytest.Config) -> str:
    """Return why the tests of this folder are skipped; "" if they are run."""
    if "uml" not in " ".join(map(str, config.invocation_params.args)):
        return "takes a minute; run it with: pytest -m uml"
    if not shutil.which("tc", path="/usr/sbin:/sbin:" + os.environ.get("PATH", "")):
        return "there is no tc: sudo apt install iproute2"
    reason = uml.unavailable_reason()
    return reason and f"User Mode Linux: {reason}"


def _needs_guest(item: pytest.Item) -> bool:
    return "guest" in getattr(item, "fixturenames", ())


def _run_inside(config: pytest.Config, chosen: Sequence[str]) -> dict[str, list[Any]]:
    """Run these tests in the guest; return their reports by name. Tests without a report get a failure."""
    with tempfile.TemporaryDirectory() as share:
        file = Path(share, "reports")
        file.touch()
        command = [sys.executable, "-m", "pytest", "--quiet", "-p", "no:cacheprovider", *chosen]
        variables = {INSIDE: str(file), "PYTHONDONTWRITEBYTECODE": "1"}
        try:
            ended = uml.run(command, MODULES, share, variables, MAX_SECONDS, cwd=str(config.rootpath))
            message = f"pytest ended with {ended.status} in User Mode Linux:\n{ended.output}"
        except DeviceError as error:
            message = str(error)
        reports: dict[str, list[Any]] = {name: [] for name in chosen}
        for report in _read(file):
            reports[report.nodeid].append(report)
    for name in chosen:
        if not any(report.when == "teardown" for report in reports[name]):
            reports[name].append(_failure(name, message))
    return reports


def _read(file: Path) -> Iterator[pytest.TestReport]:
    for line in file.read_text().splitlines():
        yield pytest.TestReport._from_json(json.loads(line))


def _failure(name: str, message: str) -> pytest.TestReport:
    location = (name.partition("::")[0], 0, name)
    return pytest.TestReport(name, location, {}, "failed", message, "call")
