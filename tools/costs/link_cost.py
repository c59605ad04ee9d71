"""Measure the time and processor time of the thruster link, beside a bare pseudo terminal, in one run.

    python tools/costs/link_cost.py [--frames 2000] [--channels 6] [--cpu 1] [--baud 115200]

- bare pty: the same number of bytes in both directions, by os.read and os.write alone; a thread echoes them.
- link: a command from the host's end to the STM32's Python twin in that same thread, and its telemetry back.
- paced: the same link with the host's wire as slow as a UART, beside the time that the bits take.
- load: the processor time of both ends, and of the host's alone, with 400 commands a second.

All on one CPU: a wake-up on another one costs more than the link. The kinds run in turn, some frames each, so
that a busy moment affects all of them. Exit code 1 when a target is missed: a round trip in 0.3 ms, at most
0.15 ms over the bare pty, at most 3 % of a core for the host's end at 400 Hz.
"""

import argparse
import os
import select
import statistics
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2]))

from firmware_stub.stub import Stm32, Stm32End
from hil.common.clock import NS_PER_S, now_ns
from hil.links.contract import ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.links.protocols import open_protocol
from hil.links.wires.faults import Faults, FaultyWire
from hil.links.wires.terminal import PtyHostWire, PtyWire

ROUND = 50  # frames of one kind before the next kind
MAX_MS, MAX_ADDED_MS, MAX_SHARE = 0.3, 0.15, 0.03
RATE_HZ = 400
LOAD_S = 3.0


class Serving(threading.Thread):
    """Thread that answers at the device's end until it is stopped; `cpu_s` is then its processor time."""

    def __init__(self, wire: PtyWire, fd: int, answer: Callable[[], object]) -> None:
        super().__init__(daemon=True)
        self._wire, self._fd, self._answer = wire, fd, answer
        self._stop_fd = os.eventfd(0)
        self.cpu_s = 0.0
        self.start()

    def run(self) -> None:
        """Wait for commands and answer them."""
        fds = [self._fd, self._stop_fd]
        began = time.thread_time()
        while self._stop_fd not in select.select(fds, [], [])[0]:
            self._answer()
        self.cpu_s = time.thread_time() - began

    def stop(self) -> None:
        """End the thread and close its wire."""
        os.eventfd_write(self._stop_fd, 1)
        self.join()
        os.close(self._stop_fd)
        self._wire.close()


class Bare:
    """Bytes in both directions on a pty."""

    def __init__(self, stack: ExitStack, down: int, up: int) -> None:
        wire = PtyWire()
        host = PtyHostWire(wire.path)
        self._fd, self._order, self._up = host.terminal, bytes(down), up
        fd, report = wire.terminal, bytes(up)

        def answer() -> None:
            os.read(fd, 4096)
            os.write(fd, report)

        self.serving = Serving(wire, fd, answer)
        stack.callback(host.close)
        stack.callback(self.serving.stop)

    def exchange(self) -> None:
        """Do one round trip."""
        os.write(self._fd, self._order)
        left = self._up
        while left > 0:
            select.select([self._fd], [], [])
            left -= len(os.read(self._fd, 4096))


class Linked:
    """A thruster link on a pty."""

    def __init__(self, stack: ExitStack, channels: int, baud: int = 0) -> None:
        wire = PtyWire()
        self._pulses = (1600,) * channels
        end = Stm32End(
            Stm32(channels, watchdog_ns=60 * NS_PER_S, telemetry_period_ns=60 * NS_PER_S),
            ThrusterLink(wire, open_protocol("frame", "device", channels)),
        )
        near = PtyHostWire(wire.path)
        paced = FaultyWire(near, Faults(baud=baud)) if baud else near
        self.host = ThrusterLink(paced, open_protocol("frame", "host", channels))
        self._sequence = 0
        end.service(now_ns())  # the report of power-up
        self._await(0)
        self.serving = Serving(wire, wire.fileno(), lambda: end.service(now_ns()))
        stack.callback(self.host.close)
        stack.callback(self.serving.stop)

    def exchange(self) -> None:
        """Exchange a command and the telemetry that answers it."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        self.host.send(ThrusterCommand(self._sequence, True, self._pulses))
        self._await(self._sequence)

    def _await(self, sequence: int) -> None:
        while True:
            select.select([self.host.wire.fileno()], [], [])
            if [True for message in self.host.receive() if message.sequence == sequence]:
                return


class Cost(NamedTuple):
    """Milliseconds of a round trip."""

    p50: float
    p99: float


def frame_sizes(channels: int) -> tuple[int, int]:
    """Return the sizes of a command and of its telemetry in bytes."""
    order = open_protocol("frame", "host", channels).encode(ThrusterCommand(1, True, (1600,) * channels))
    report = ThrusterTelemetry(1, True, False, (1600,) * channels, 0, 1, 0, 0)
    return len(order), len(open_protocol("frame", "device", channels).encode(report))


def time_in_turn(kinds: dict[str, Callable[[], None]], frames: int) -> dict[str, Cost]:
    """Return the round trips of each kind, after a round to warm up."""
    spent: dict[str, list[float]] = {name: [] for name in kinds}
    for number in range(frames // ROUND + 1):
        for name, exchange in kinds.items():
            for _ in range(ROUND):
                began = time.perf_counter_ns()
                exchange()
                if number:
                    spent[name].append((time.perf_counter_ns() - began) / 1e6)
    return {
        name: Cost(statistics.median(times), statistics.quantiles(times, n=100)[98]) for name, times in spent.items()
    }


def load(channels: int) -> tuple[float, float]:
    """Return the share of a core that the host's end takes at `RATE_HZ`, and that both take."""
    with ExitStack() as stack:
        link = Linked(stack, channels)
        began, began_ns = time.thread_time(), now_ns()
        for number in range(1, int(LOAD_S * RATE_HZ) + 1):
            time.sleep(max(0, began_ns + number * NS_PER_S // RATE_HZ - now_ns()) / NS_PER_S)
            link.exchange()
        host_s = time.thread_time() - began
        took_s = (now_ns() - began_ns) / NS_PER_S
    return host_s / took_s, (host_s + link.serving.cpu_s) / took_s


def main() -> int:
    """Measure and print the table; return the exit code."""
    options = _options()
    os.sched_setaffinity(0, {options.cpu})
    down, up = frame_sizes(options.channels)
    with ExitStack() as stack:
        bare, link = Bare(stack, down, up), Linked(stack, options.channels)
        kinds = {"bare pty": bare.exchange, "link": link.exchange}
        costs = time_in_turn(kinds, options.frames)
    with ExitStack() as stack:
        slow = Linked(stack, options.channels, options.baud)
        costs |= time_in_turn({"paced": slow.exchange}, max(ROUND * 2, options.frames // 10))
    host_share, share = load(options.channels)
    bits_ms = (down + up) * 10_000 / options.baud
    added = costs["link"].p50 - costs["bare pty"].p50
    print(f"a command of {down} bytes, telemetry of {up} bytes; round trips in ms, all on CPU {options.cpu}")
    print(f"{'':28}{'p50':>8}{'p99':>8}")
    for name, cost in costs.items():
        label = f"paced at {options.baud} bit/s" if name == "paced" else name
        print(f"{label:28}{cost.p50:8.3f}{cost.p99:8.3f}")
    print(f"{'bits of that alone':28}{bits_ms:8.3f}   paced is {100 * (costs['paced'].p50 / bits_ms - 1):.1f} % over")
    print(f"{'link adds':28}{added:8.3f}")
    print(f"at {RATE_HZ} Hz the host's end takes {100 * host_share:.1f} % of a core, both ends {100 * share:.1f} %")
    met = costs["link"].p50 < MAX_MS and added <= MAX_ADDED_MS and host_share <= MAX_SHARE
    targets = f"p50 < {MAX_MS} ms, added <= {MAX_ADDED_MS} ms, host's end <= {MAX_SHARE:.0%} of a core"
    print(f"targets: {targets}: {'met' if met else 'MISSED'}")
    return 0 if met else 1


def _options() -> Any:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=2000)
    parser.add_argument("--channels", type=int, default=6)
    parser.add_argument("--cpu", type=int, default=max(os.sched_getaffinity(0)))
    parser.add_argument("--baud", type=int, default=115_200)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
