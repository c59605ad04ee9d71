"""Links and sessions over a network with delay, reordering, loss and interruption."""

import select
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from statistics import median
from typing import NamedTuple

import pytest

from firmware_stub.stub import Stm32, Stm32End
from hil.common.clock import NS_PER_S, now_ns
from hil.common.errors import DeviceError
from hil.links.address import open_address
from hil.links.contract import ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.links.protocols import open_protocol
from tests.support.busy import retry_when_busy
from tests.support.links.link_contract import wait_readable
from tests.system.uml.network import interface, ip, namespace, shaped, within

pytestmark = pytest.mark.usefixtures("guest")

POOR = "netem delay 20ms 8ms loss 5%"
ALL_LOST = "netem loss 100%"
INTERRUPTION_S = 3.0
PULSES = (1600, 1400)
BUSY_GUEST = "the guest has its turn when the host gives it one"
PERIOD_S = 0.01  # between commands


class Bench(NamedTuple):
    """Both ends of a thruster link, on two computers that a cable joins, and the reports that the host has received."""

    host: ThrusterLink
    end: Stm32End
    received: list[tuple[float, ThrusterTelemetry]]

    def run(self, seconds: float, first: int = 1) -> dict[int, float]:
        """Send a command every period, numbered from `first`; return the times of sending."""
        sent: dict[int, float] = {}
        begin = time.monotonic()
        while time.monotonic() < begin + seconds:
            number = len(sent) + first
            sent[number] = time.monotonic()
            self.host.send(ThrusterCommand(number, True, PULSES))
            self.wait(begin + len(sent) * PERIOD_S)
        return sent

    def wait(self, until_s: float) -> None:
        """Serve both ends until that time."""
        while (left := until_s - time.monotonic()) > 0:
            due = (self.end.deadline_ns - now_ns()) / NS_PER_S
            select.select([self.host.wire.fileno(), self.end.fileno()], [], [], max(0.0, min(left, due)))
            self.end.service(now_ns())
            for report in self.host.receive():
                assert isinstance(report, ThrusterTelemetry)
                self.received.append((time.monotonic(), report))


@pytest.fixture(scope="module", autouse=True)
def _cable() -> Iterator[None]:
    """Join the vehicle's namespace by a cable."""
    with namespace("vehicle"), interface("shore", "veth peer name vehicle netns vehicle"):
        ip("address add 10.9.0.1/24 dev shore")
        ip("-n vehicle address add 10.9.0.2/24 dev vehicle")
        ip("-n vehicle link set vehicle up")
        yield


def open_bench(kind: str) -> Bench:
    with within("vehicle"):
        device = open_address(f"{kind}://10.9.0.2:5760", "device")
    end = Stm32End(Stm32(2), ThrusterLink(device, open_protocol("frame", "device", 2)))
    host = open_address(f"{kind}://10.9.0.2:5760", "host")
    assert wait_readable(device), "it hears who calls"
    return Bench(ThrusterLink(host, open_protocol("frame", "host", 2)), end, [])


@contextmanager
def benched(kind: str = "udp") -> Iterator[Bench]:
    """Provide a bench that is closed whatever happens: the next attempt needs its port."""
    made = open_bench(kind)
    with closing(made.host), closing(made.end.link):
        yield made


def on_a_bench(judge: Callable[[Bench], None]) -> Callable[[], None]:
    """Return a test that checks a bench, and repeats this with a new one when the machine was late."""

    def test() -> None:
        def attempt() -> None:
            with benched() as bench:
                judge(bench)
                for counters in (bench.host.counters, bench.end.link.counters):
                    assert (counters.checksum_errors, counters.malformed, counters.dropped_bytes) == (0, 0, 0)

        retry_when_busy(attempt, BUSY_GUEST)

    test.__doc__ = judge.__doc__
    return test


@on_a_bench
def test_delay_loss_and_reordering_do_not_trip_the_watchdog(bench: Bench) -> None:
    """Lost messages are only counted as missed, late ones are refused, and the watchdog stays quiet."""
    stm32 = bench.end.stm32
    with shaped("shore", POOR), shaped("vehicle", POOR, "vehicle"):
        sent = bench.run(3.0)
        bench.wait(time.monotonic() + 0.1)
    lost = len(sent) - stm32.frames - stm32.refused
    assert 0 < lost < 0.15 * len(sent)
    assert 0 < stm32.refused < 0.4 * len(sent)
    assert stm32.watchdog_trips == 0
    assert bench.received[-1][1].errors == stm32.refused, "the host learns how many were refused"
    shown = [report.sequence for _, report in bench.received]
    first_shown = {number: at for (at, _), number in reversed(list(zip(bench.received, shown, strict=True)))}
    took = [first_shown[number] - at for number, at in sent.items() if number in first_shown]
    assert len(took) > 0.6 * len(sent)
    assert min(took) > 2 * 0.012 - 0.001, "no answer is quicker than the network"
    assert 0.03 < median(took) < 0.06


@on_a_bench
def test_lost_commands_trip_the_watchdog_and_the_host_is_informed(bench: Bench) -> None:
    """Commands are lost and reports still arrive: the report shows the tripped watchdog."""
    stm32 = bench.end.stm32
    arrived = bench.run(0.2)
    with shaped("shore", ALL_LOST):
        attended = time.monotonic()  # the STM32 again: while tc ran nobody did, however long it took
        vanished = bench.run(INTERRUPTION_S, first=len(arrived) + 1)
        bench.wait(time.monotonic() + 0.05)
    assert stm32.pwm_us == [1500, 1500]
    assert stm32.watchdog_trips == 1
    tripped = min(at for at, report in bench.received if report.timed_out)
    assert tripped == pytest.approx(max(max(arrived.values()) + 0.2, attended), abs=0.05), "the watchdog's time"
    assert all(report.pwm_us == (1500, 1500) for at, report in bench.received if at > tripped)
    assert bench.received[-1][0] > max(vanished.values()) - 0.3, "reports keep coming, five a second"
    assert stm32.frames == len(arrived)
    back = bench.run(0.3, first=max(vanished) + 1)
    assert stm32.frames - len(arrived) >= len(back) - 1
    assert stm32.pwm_us == list(PULSES)
    assert (stm32.watchdog_trips, bench.received[-1][1].timed_out) == (1, False)


def test_a_tcp_link_without_a_peer_ends_and_can_be_reopened() -> None:
    """Both ends close the link within `PEER_TIMEOUT_S`; the watchdog has tripped long before."""
    with benched("tcp") as made:
        made.run(0.3)
        stm32 = made.end.stm32
        assert stm32.pwm_us == list(PULSES)
        with shaped("shore", ALL_LOST), shaped("vehicle", ALL_LOST, "vehicle"):
            began = time.monotonic()
            with pytest.raises(DeviceError, match=r"^tcp://10.9.0.2:5760: went away"):
                made.run(2 * INTERRUPTION_S, first=100)
            assert 1.5 < time.monotonic() - began < 8.0
            assert stm32.pwm_us == [1500, 1500]
            made.host.close()
            assert stm32.watchdog_trips == 1
            give_up = began + 8.0
            while time.monotonic() < give_up:
                made.end.service(now_ns())
                time.sleep(0.02)
        again = ThrusterLink(open_address("tcp://10.9.0.2:5760", "host"), open_protocol("frame", "host", 2))
        with closing(again):
            again_bench = Bench(again, made.end, [])
            again_bench.run(0.5, first=500)
            assert stm32.pwm_us == list(PULSES)
            assert again_bench.received[-1][1].sequence >= 500
