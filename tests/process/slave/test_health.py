"""Diagnostics of the slave: lateness, counters, state, and the name of its machine."""

import os
import re
import signal
import time
import tty
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from boards.emulation import labels
from boards.tree import Tree
from hil.autonomy.control.controller import VelocityCommand
from hil.bench.harness import Bench, await_vehicle
from hil.bench.machine import describe
from hil.client.health_watch import HealthWatch
from hil.common.clock import NS_PER_MS, NS_PER_S, Histogram
from hil.network import services
from hil.network.roles import open_master_session
from hil.ros.diagnostics import Diagnostics, or_nan
from hil.slave.health.reporter import SKIPPED_PERIOD_NS, RecentLateness, SkippedSteps
from tests.support.processes import Program, wait_for, write_scenario

NO_ANSWER = "has not answered for 0.5 s; check wiring, baud, protocol"


def test_a_histogram_counts_since_an_earlier_state() -> None:
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


def test_skipped_steps_are_reported_at_once_and_then_once_a_minute() -> None:
    skipped, start_ns = SkippedSteps(), 5 * NS_PER_S
    assert not skipped.line(0, 0, start_ns)
    assert "651 steps skipped, 651 since the start, at most 917 ms late" in skipped.line(651, 917 * NS_PER_MS, start_ns)
    assert not skipped.line(651, 917 * NS_PER_MS, start_ns + SKIPPED_PERIOD_NS)
    assert skipped.line(700, 917 * NS_PER_MS, start_ns + SKIPPED_PERIOD_NS)
    assert not skipped.line(710, 917 * NS_PER_MS, start_ns + SKIPPED_PERIOD_NS + NS_PER_S)
    assert "30 steps skipped, 730" in skipped.line(730, 917 * NS_PER_MS, start_ns + 2 * SKIPPED_PERIOD_NS)


def test_a_paused_slave_reports_its_skipped_steps(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")

        def stop_and_look() -> bool:
            """Pause the slave; return whether skipped steps were reported. Its loop starts after "ready"."""
            slave.process.send_signal(signal.SIGSTOP)
            time.sleep(0.6)  # it makes up for 0.4 s
            slave.process.send_signal(signal.SIGCONT)
            return bool(
                wait_for(lambda: re.search(r"not get the processor in time: \d+ steps skipped", slave.output), 2.0)
            )

        assert wait_for(stop_and_look), slave.output


def test_no_python_thread_has_a_lower_scheduling_class_than_the_loop(tmp_path: Path) -> None:
    """A thread with the interpreter's lock would hold up the loop when other programs take its processor."""
    scenario, port = write_scenario(tmp_path)
    with Program(tmp_path, "slave", scenario) as slave, open_master_session(f"tcp/127.0.0.1:{port}") as session:
        assert wait_for(session.others)
        slave.expect("memory: ")
        pid = slave.process.pid

        def classes() -> dict[int, int]:
            """Return the scheduling class of each thread that runs our code, and none of the library's, as rx-0."""
            process, figures = psutil.Process(pid), {}
            for thread, *_ in process.threads():
                with suppress(psutil.Error, OSError):  # it has just ended
                    if not re.fullmatch(r"[a-z]+-\d+", psutil.Process(thread).name()):
                        figures[thread] = os.sched_getscheduler(thread)
            return figures

        assert wait_for(lambda: len(classes()) >= 4 and len(set(classes().values())) == 1), classes()
        below = [os.sched_getparam(thread).sched_priority for thread in classes()]
        assert max(below) == os.sched_getparam(pid).sched_priority


def test_recent_lateness_covers_only_the_last_period() -> None:
    lateness, recent = Histogram(), RecentLateness()

    def figures_at(now: int) -> tuple[float, float, float]:
        output = Diagnostics()
        recent.add_figures(output, lateness, now)
        figures = output.lateness_recent_p50_us, output.lateness_recent_p99_us, output.lateness_recent_max_us
        return or_nan(figures[0]), or_nan(figures[1]), or_nan(figures[2])

    for _ in range(400):
        lateness.add(29 * NS_PER_MS)
    start_ns = NS_PER_S
    assert figures_at(start_ns)[1] >= 29_000
    for _ in range(400):
        lateness.add(50_000)
    assert figures_at(start_ns + 100 * NS_PER_MS)[1] >= 29_000, "there was news: the same second still"
    p50, _, worst = figures_at(start_ns + NS_PER_S)
    assert 50 <= p50 <= worst <= 63
    for _ in range(400):
        lateness.add(71 * NS_PER_MS)
    assert figures_at(start_ns + 2 * NS_PER_S)[2] >= 71_000


def test_a_slave_reports_that_its_machine_is_emulated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UUV_HIL_EMULATED", "a test")
    assert labels(Tree(), os.uname().machine) == describe()[1]
    with Bench("paper_field", {"slave.realtime": False}) as bench:
        slave = bench.start_slave()
        with bench.client() as client:
            await_vehicle(client, slave)
            assert (client.diagnostics().labels or ("",))[0] == "emulated: a test"


def test_a_silent_stm32_is_an_error(tmp_path: Path) -> None:
    """The port is open but nothing answers, as with a wrong wire, baud rate or protocol.

    No master needs to command for that: while the slave waits for commands, it sends neutral ones.
    """
    near_end, far_end = os.openpty()
    tty.setraw(far_end)
    # A name of its own: once the pty is closed, the next pty of any program gets its number.
    port = tmp_path / "adapter"
    port.symlink_to(os.ttyname(far_end))
    changes = {"slave.realtime": False, "stm32": "device", "link.port": str(port)}
    try:
        with Bench("paper_field", changes) as bench, open_master_session(bench.endpoint) as session:
            slave, watch = bench.start_slave(), HealthWatch(session)

            def reported() -> bool:
                return any(status.level == 2 and "does not answer" in status.message for status in watch.statuses())

            assert wait_for(reported), slave.output
            (status,) = watch.statuses()
            assert status.figures.stm32_silent is True
            # The log is written before the status is published, but of an instant before.
            assert wait_for(lambda: NO_ANSWER in slave.output)
            assert slave.output.count(NO_ANSWER) == 1
            port.unlink()
            os.close(far_end)
            os.close(near_end)  # as if the adapter were pulled out
            assert wait_for(lambda: any("is lost" in status.message for status in watch.statuses()))
    finally:
        for descriptor in (near_end, far_end):
            with suppress(OSError):
                os.close(descriptor)


def test_injected_faults_and_called_services_are_counted_in_the_diagnostics() -> None:
    """A quarter of the messages is doubled on the host's end of the link, and one service is called once."""
    changes = {"slave.realtime": False, "link.faults.duplicate": 0.25}
    with Bench("paper_field", changes) as bench:
        slave = bench.start_slave()
        with bench.client() as client:
            await_vehicle(client, slave)
            assert client.diagnostics().services_answered == 0
            services.call(client.session, f"/{client.node}/arm", "std_srvs/srv/SetBool", {"data": True})

            def counted() -> bool:
                client.command(VelocityCommand(surge=0.3))
                figures = client.diagnostics()
                ends = figures.link_faults_sent or {}, figures.link_faults_received or {}
                return all(faults.get("duplicated") for faults in ends) and figures.services_answered == 1

            assert wait_for(counted), client.diagnostics().raw
            faults = client.diagnostics().link_faults_received or {}
            assert faults["duplicated"] < faults["chunks"]
            assert faults["dropped"] == 0
