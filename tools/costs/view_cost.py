"""Measure the cost of the live view: the vehicle's delays with and without it, and how late a sample is shown.

    python tools/costs/view_cost.py [--seconds 20] [--rate 20]

One slave over a seabed of 1,000 x 1,000 nodes, commanded 20 times a second, and a view with no, one and ten viewers:
clients that receive the scene as a browser does. A sample's latency is from its measurement until a viewer has
received the vehicle's new place; the drawing of the browser, one more picture, is not included. `--rate` limits the
network between the view and its viewers (Mbit/s). Exit code 1 if the median latency is above 60 ms. Needs the extra
dev.
"""

import argparse
import asyncio
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.autonomy.control.controller import VelocityCommand  # noqa: E402 - works from a bare checkout too
from hil.bench.harness import Bench, await_vehicle  # noqa: E402
from hil.bench.processes import cpu_s, read_threads  # noqa: E402
from hil.client.client import VehicleClient  # noqa: E402
from hil.common.children import module_command, package_environment, start_child  # noqa: E402
from hil.common.quantiles import quantile  # noqa: E402
from hil.ros import encoders as ros  # noqa: E402
from hil.view.scene.frames import to_scene  # noqa: E402
from tools.faults.relay import Relay  # noqa: E402

MAX_LATENCY_MS = 60.0
SETTLE_S = 5.0
SLOW_SETTLE_S = 20.0  # time until ten viewers have received the seabed over a slow network
COMMAND_S = 0.05
WORLD = """
name = "wide"
source = "made up: displaced midpoints"
extent = [-499.5, 499.5, -499.5, 499.5]
depth = 30.0
[terrain]
kind = "fractal"
depth = 30.0
deviation = 4.0
hurst = 0.8
seed = 1
resolution = 1.0
"""
SCENARIO = """
vehicle = "paper_six"
world = "{world}"
[start]
depth = 5
[master]
goal = [8, 7]
depth = 5
"""
Place = tuple[float, ...]


class Measured(NamedTuple):
    """Figures of one round: command delay, shares of a core, memory, and the viewers' part.

    `latency_ms` are in the order in which they were measured.
    """

    delay_p50_ms: float
    delay_p99_ms: float
    slave_cpu: float
    view_cpu: float
    view_mib: float
    latency_ms: list[float]
    updates_hz: float
    traffic_mbit_s: float  # of all viewers; only measured with a rate


class Clock:
    """Times of measurement (wall ns) of the vehicle's places, by the place in the scene."""

    def __init__(self) -> None:
        self.measured_ns: dict[Place, int] = {}

    def on_truth(self, topic: str, payload: bytes, attachment: bytes) -> None:
        """Record the time of a message of `ground_truth`."""
        decode, stamp = ros.decoder(topic), ros.unpack_attachment(attachment)
        state = decode(payload) if decode else None
        if state is not None and stamp is not None:
            self.measured_ns[_rounded(to_scene([state.position])[0])] = stamp.time_ns


class Viewers:
    """`number` clients of the scene at `address`, in a thread. Use as a context. With `clock` it measures ages."""

    def __init__(self, number: int, address: str, token: str, clock: Clock | None = None) -> None:
        self.latency_ms: list[float] = []
        self.updates = 0
        self._number, self._address, self._token, self._clock = number, address, token, clock
        self._ending = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._receive()), daemon=True)

    def __enter__(self) -> "Viewers":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    @property
    def are_connected(self) -> bool:
        """True while none of them was disconnected."""
        return self._thread.is_alive()

    async def _receive(self) -> None:
        await asyncio.gather(*[self._view(number == 0) for number in range(self._number)])

    async def _view(self, is_first: bool) -> None:
        import aiohttp
        import viser

        async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as client:
            async with client.get(f"{self._address}?token={self._token}") as page:
                page.raise_for_status()
            protocols = [f"viser-v{viser.__version__}"]
            async with client.ws_connect(f"{self._address}scene", protocols=protocols, max_msg_size=0) as scene:
                while not self._ending.is_set():
                    message = await scene.receive(timeout=30.0)
                    if message.type is not aiohttp.WSMsgType.BINARY:
                        return
                    if is_first and self._clock:
                        self._take_ages(self._clock, message.data, time.time_ns())

    def _take_ages(self, clock: Clock, data: bytes, now_ns: int) -> None:
        """Record the age of the vehicle's newest place in a message of viser."""
        import msgspec
        import zstandard

        size = int.from_bytes(data[8:16], "little")
        content = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16 : 16 + size]))
        for message in content["messages"]:
            if message.get("type") != "SetPositionMessage" or message.get("name") != "/vehicles/uuv1":
                continue
            self.updates += 1
            if measured_ns := clock.measured_ns.get(_rounded(message["position"])):
                self.latency_ms.append((now_ns - measured_ns) / 1e6)


@contextmanager
def viewed(*options: str) -> Iterator[tuple[int, str, str]]:
    """Run a view with these options; yield its process id, address and token."""
    command = module_command("hil.cli", "view", *options, "--listen", "127.0.0.1:0", "--no-browser")
    process = start_child(command, environment=package_environment(), stdout=subprocess.PIPE, text=True)
    assert process.stdout
    try:
        address = re.search(r"watch at (\S+/)\?token=(\S+)", process.stdout.readline())
        assert address, "there is no view"
        yield process.pid, address[1], address[2]
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()


def fly(client: VehicleClient, seconds: float) -> None:
    """Command a circle."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        client.command(VelocityCommand(surge=0.3, yaw_rate=0.2, depth=5.0))
        time.sleep(COMMAND_S)


@contextmanager
def slowed(address: str, rate: float) -> Iterator[tuple[str, Relay | None]]:
    """Provide the address of a view behind a network of that rate (Mbit/s, 0: no limit), and that network."""
    if not rate:
        yield address, None
        return
    port = int(address.rstrip("/").rpartition(":")[2])
    with Relay(port, rate * 1e6 / 8, slow=(0,)) as relay:
        yield f"http://127.0.0.1:{relay.port}/", relay


def measure(folder: Path, viewers: int | None, seconds: float, rate: float = 0.0) -> Measured:
    """Measure one round with that number of viewers (None: no view), behind a network of `rate` Mbit/s if not 0."""
    (folder / "wide.toml").write_text(WORLD, encoding="utf-8")
    scenario = folder / "scenario.toml"
    scenario.write_text(SCENARIO.format(world=folder / "wide.toml"), encoding="utf-8")
    clock = Clock()
    with ExitStack() as stack:
        bench = stack.enter_context(Bench(str(scenario)))
        slave = bench.start_slave()
        client = stack.enter_context(bench.client(topics=("ground_truth", "trace")))
        client.session.subscribe("uuv1", "ground_truth", clock.on_truth, 64)
        await_vehicle(client, slave)
        view = watching = relay = None
        if viewers is not None:
            view, address, token = stack.enter_context(viewed("--scenario", bench.path))
            address, relay = stack.enter_context(slowed(address, rate))
            watching = stack.enter_context(Viewers(viewers, address, token, clock))
        fly(client, SLOW_SETTLE_S if rate else SETTLE_S)
        first = len(client.delays.totals_ns())
        noted, updates = (len(watching.latency_ms), watching.updates) if watching else (0, 0)
        passed = relay.passed if relay else 0
        began, slave_s, view_s = time.monotonic(), cpu_s([slave.pid]), cpu_s([view]) if view else 0.0
        fly(client, seconds)
        duration = time.monotonic() - began
        delays = sorted(client.delays.totals_ns()[first:])
        return Measured(
            quantile(delays, 0.5) / 1e6, quantile(delays, 0.99) / 1e6,
            (cpu_s([slave.pid]) - slave_s) / duration, (cpu_s([view]) - view_s) / duration if view else 0.0,
            read_threads([view]).pss_mib if view else 0.0, watching.latency_ms[noted:] if watching else [],
            (watching.updates - updates) / duration if watching else 0.0,
            8e-6 * (relay.passed - passed) / duration if relay else 0.0,
        )  # fmt: skip


def _rounded(position: Any) -> Place:
    return tuple([round(float(value), 6) for value in position])


def main() -> int:
    """Measure all rounds; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each round [%(default)s]")
    parser.add_argument("--rate", type=float, default=0.0, metavar="MBIT/S", help="of the viewers' network [no limit]")
    options = parser.parse_args()
    print("viewers  delay p50, p99 ms  CPU slave, view  view MiB  latency p50, p95 ms  updates/s Mbit/s")
    failed = False
    for viewers in (None, 0, 1, 10):
        with tempfile.TemporaryDirectory() as folder:
            measured = measure(Path(folder), viewers, options.seconds, options.rate)
        late = sorted(measured.latency_ms)
        p50, p95 = (quantile(late, 0.5), quantile(late, 0.95)) if late else (float("nan"), float("nan"))
        failed |= p50 > MAX_LATENCY_MS
        name = "no view" if viewers is None else str(viewers)
        print(
            f"{name:8} {measured.delay_p50_ms:8.3f} {measured.delay_p99_ms:8.3f} {measured.slave_cpu:9.1%}"
            f" {measured.view_cpu:7.1%} {measured.view_mib:8.0f}"
            f" {p50:10.1f} {p95:8.1f} {measured.updates_hz:9.1f}"
            f" {measured.traffic_mbit_s:7.2f}",
            flush=True,
        )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
