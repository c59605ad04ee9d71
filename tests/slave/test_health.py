"""What the slave says of its health: how late it is now, and what its machine is called."""

import os
import tty
from contextlib import suppress
from pathlib import Path

import pytest

from boards.emulation import labels
from boards.tree import Tree
from hil.autonomy.control import VelocityCommand
from hil.bench.harness import Bench, await_vehicle
from hil.bench.machine import describe
from hil.clock import NS_PER_MS, NS_PER_S, Histogram
from hil.master.health_watch import HealthWatch
from hil.slave.health import RecentLateness, own_name
from hil.transport.roles import dial
from tests.processes import wait_for


def test_what_a_histogram_counted_since_a_look() -> None:
    lateness = Histogram()
    for value in (5, 900, 40_000_000):
        lateness.add(value)
    bins = list(lateness.bins)
    nothing = lateness.since(bins)
    assert (nothing.count, nothing.maximum, nothing.quantile(0.99)) == (0, 0, 0)
    for value in (100, 101, 7000):
        lateness.add(value)
    recent = lateness.since(bins)
    assert recent.count == 3
    assert 7000 <= recent.maximum <= 7000 * 1.25, "known to its bin, and never flattering"
    assert lateness.count == 6
    assert lateness.since([0] * 256).maximum == 40_000_000


def test_a_loop_that_was_late_long_ago_is_well_now() -> None:
    lateness, recent = Histogram(), RecentLateness()
    for _ in range(400):
        lateness.add(29 * NS_PER_MS)
    began = NS_PER_S
    assert float(recent.figures(lateness, began)["lateness_recent_p99_us"]) >= 29_000
    for _ in range(400):
        lateness.add(50_000)
    soon = recent.figures(lateness, began + 100 * NS_PER_MS)
    assert float(soon["lateness_recent_p99_us"]) >= 29_000, "there was news: the same second still"
    now = recent.figures(lateness, began + NS_PER_S)
    assert 50 <= float(now["lateness_recent_p50_us"]) <= float(now["lateness_recent_max_us"]) <= 63
    for _ in range(400):
        lateness.add(71 * NS_PER_MS)
    assert float(recent.figures(lateness, began + 2 * NS_PER_S)["lateness_recent_max_us"]) >= 71_000


def test_a_machine_that_is_no_known_board_has_its_own_name() -> None:
    assert own_name() == f"{os.uname().machine} machine {os.uname().nodename}"


def test_a_slave_tells_what_its_machine_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UUV_HIL_EMULATED", "a test")
    assert labels(Tree(), os.uname().machine) == describe()[1]
    with Bench("paper_field", {"slave.realtime": False}) as bench:
        slave = bench.start_slave()
        with bench.client() as client:
            await_vehicle(client, slave)
            assert client.diagnostics()["labels"].split("; ")[0] == "emulated: a test"


def test_a_real_machine_needs_no_label(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("UUV_HIL_EMULATED", raising=False)
    assert labels(Tree(str(tmp_path)), "aarch64") == ()


def test_a_silent_stm32_is_an_error() -> None:
    """A port at which nobody is: what a wrong wire, baud or protocol looks like."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    changes = {"slave.realtime": False, "stm32": "device", "link.port": os.ttyname(theirs)}
    try:
        with Bench("paper_field", changes) as bench, dial(bench.endpoint) as session:
            slave, watch = bench.start_slave(), HealthWatch(session)
            with bench.client() as client:
                await_vehicle(client, slave)
                assert wait_for(watch.statuses, 5)
                assert {status.level for status in watch.statuses()} == {1}, "nothing was asked of it yet"

                def told() -> bool:
                    client.command(VelocityCommand(surge=0.3))
                    return any(status.level == 2 and "does not answer" in status.message for status in watch.statuses())

                assert wait_for(told, 10)
            (status,) = watch.statuses()
            assert status.values["stm32_silent"] == "true"
            assert slave.said.count("has not answered for 0.5 s; check wiring, baud, protocol") == 1
            os.close(theirs)
            os.close(ours)  # as if the adapter were pulled out
            assert wait_for(lambda: any("is gone" in status.message for status in watch.statuses()), 10)
    finally:
        for descriptor in (ours, theirs):
            with suppress(OSError):
                os.close(descriptor)
