"""What the slave says of its health: how late it is now, and what its machine is called."""

import os
import tty
from contextlib import suppress
from pathlib import Path

import pytest

from boards.emulation import labels
from boards.tree import Tree
from hil.autonomy.control.controller import VelocityCommand
from hil.bench.harness import Bench, await_vehicle
from hil.bench.machine import describe
from hil.client.health_watch import HealthWatch
from hil.common.clock import NS_PER_MS, NS_PER_S, Histogram
from hil.network.roles import open_master_session
from hil.ros.diagnostics import Diagnostics, or_nan
from hil.slave.health.reporter import RecentLateness, own_name
from tests.support.processes import wait_for

NO_ANSWER = "has not answered for 0.5 s; check wiring, baud, protocol"


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

    def looked(now: int) -> tuple[float, float, float]:
        said = Diagnostics()
        recent.add_figures(said, lateness, now)
        figures = said.lateness_recent_p50_us, said.lateness_recent_p99_us, said.lateness_recent_max_us
        return or_nan(figures[0]), or_nan(figures[1]), or_nan(figures[2])

    for _ in range(400):
        lateness.add(29 * NS_PER_MS)
    began = NS_PER_S
    assert looked(began)[1] >= 29_000
    for _ in range(400):
        lateness.add(50_000)
    assert looked(began + 100 * NS_PER_MS)[1] >= 29_000, "there was news: the same second still"
    p50, _, worst = looked(began + NS_PER_S)
    assert 50 <= p50 <= worst <= 63
    for _ in range(400):
        lateness.add(71 * NS_PER_MS)
    assert looked(began + 2 * NS_PER_S)[2] >= 71_000


def test_a_machine_that_is_no_known_board_has_its_own_name() -> None:
    assert own_name() == f"{os.uname().machine} machine {os.uname().nodename}"


def test_a_slave_tells_what_its_machine_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UUV_HIL_EMULATED", "a test")
    assert labels(Tree(), os.uname().machine) == describe()[1]
    with Bench("paper_field", {"slave.realtime": False}) as bench:
        slave = bench.start_slave()
        with bench.client() as client:
            await_vehicle(client, slave)
            assert (client.diagnostics().labels or ("",))[0] == "emulated: a test"


def test_a_real_machine_needs_no_label(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("UUV_HIL_EMULATED", raising=False)
    assert labels(Tree(str(tmp_path)), "aarch64") == ()


def test_a_silent_stm32_is_an_error() -> None:
    """A port at which nobody is: what a wrong wire, baud or protocol looks like."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    changes = {"slave.realtime": False, "stm32": "device", "link.port": os.ttyname(theirs)}
    try:
        with Bench("paper_field", changes) as bench, open_master_session(bench.endpoint) as session:
            slave, watch = bench.start_slave(), HealthWatch(session)
            with bench.client() as client:
                await_vehicle(client, slave)
                assert wait_for(watch.statuses)
                assert {status.level for status in watch.statuses()} == {1}, "nothing was asked of it yet"

                def told() -> bool:
                    client.command(VelocityCommand(surge=0.3))
                    return any(status.level == 2 and "does not answer" in status.message for status in watch.statuses())

                assert wait_for(told)
            (status,) = watch.statuses()
            assert status.figures.stm32_silent is True
            # The log is written before the status is published, but of an instant before.
            assert wait_for(lambda: NO_ANSWER in slave.output)
            assert slave.output.count(NO_ANSWER) == 1
            os.close(theirs)
            os.close(ours)  # as if the adapter were pulled out
            assert wait_for(lambda: any("is gone" in status.message for status in watch.statuses()))
    finally:
        for descriptor in (ours, theirs):
            with suppress(OSError):
                os.close(descriptor)
