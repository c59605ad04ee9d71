"""Faults of instruments at their wires, each on every instrument of the table, read as a driver reads them.

All instruments of one fault stand at wires of one slave, so one run measures all of them.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from math import nan
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from hil.bench.harness import READY_S, Bench
from hil.bench.instruments.framing import split
from hil.bench.instruments.reader import ASKS, Ask, Reader
from hil.common.errors import HilError, NetworkError
from hil.common.ports import free_ports
from hil.instruments.contract import Client, Instrument
from hil.instruments.table import INSTRUMENTS, load_instrument
from hil.scenario.instrument_records import WireAddress, parse_wire
from sim.sensors.sensor_set import load_sensor
from tests.support.instrument_bench import Bench as Desk
from tools.faults.rows import RECOVERY_S, Row, judge

RUN_S, FROM_S, UNTIL_S = 16.0, 6.0, 10.0
LEAST = 5  # messages of a run
SLACK_S = 1.5  # between two messages of the slowest instrument, and the reading of them
WORLD = 'name = "water"\nsource = "made up"\nextent = [-50.0, 50.0, -50.0, 50.0]\ndepth = 12.0\norigin = [57.7, 11.9]\n'
LOOK_S = 0.3
OF_SENSOR = {
    "scanning_sonar": 'device = "ping360"',
    "forward_sonar": 'device = "gemini_720is"',
    "dvl": "rate = 15",
    "camera": "width = 64\nheight = 48\nrate = 5",
}


class InstrumentFault(NamedTuple):
    """A fault: the key `faults` of each instrument, and whether it silences them; `attack` sends noise to them."""

    name: str
    faults: str
    silences: bool
    attack: bool = False


FAULTS = (
    InstrumentFault("power cycle", f"power_off = [[{FROM_S}, {UNTIL_S}]]", True),
    InstrumentFault("cable pulled", f"unplugged = [[{FROM_S}, {UNTIL_S}]]", True),
    InstrumentFault("garbage on the line", "noise = 0.3, corrupt = 1e-4, drop = 0.05", False),
    InstrumentFault("garbage to the instrument", "", False, attack=True),
)


class Wire(NamedTuple):
    """The wire of one instrument in the run."""

    name: str
    address: WireAddress


def row_names() -> list[str]:
    """Return the names of all rows."""
    return [f"instrument {fault.name} {name}" for fault in FAULTS for name in INSTRUMENTS]


def run_instruments(choose: Callable[[str], bool]) -> Iterator[Row]:
    """Yield the rows of the faults and instruments that `choose` accepts by name, "instrument FAULT NAME"."""
    for fault in FAULTS:
        names = [name for name in INSTRUMENTS if choose(f"instrument {fault.name} {name}")]
        if names:
            yield from _run(fault, names)


def write_scenario(folder: Path, names: list[str], faults: str) -> tuple[str, list[Wire]]:
    """Write a scenario with these instruments, each at a wire of its own; return its path, and the wires."""
    (folder / "water.toml").write_text(WORLD, encoding="utf-8")
    lines = ['vehicle = "bluerov2"', 'world = "water.toml"', "[start]", 'depth = "0 m"']
    wires: list[Wire] = []
    for name, port in zip(names, free_ports(len(names)), strict=True):
        kind = load_instrument(name, name)
        sensor = kind.sensors[0]
        at = next(each for each in ("tcp", "http", "udp", "pty") if each in kind.wires)
        text = f"pty:{folder}/{name}" if at == "pty" else f"{at}:127.0.0.1:{port}"
        wires.append(Wire(name, parse_wire(text, kind.baud)))
        own = OF_SENSOR.get(sensor, "")
        lines += [f"[sensors.at_{name}]", f'sensor = "{sensor}"', own, f'instrument = "{name}"', f'at = "{text}"']
        lines += [f"faults = {{ {faults} }}"]
    path = folder / "instruments.toml"
    path.write_text("\n".join([*lines, "[master]", "goal = [40.0, 10.0]"]) + "\n", encoding="utf-8")
    return str(path), wires


def _run(fault: InstrumentFault, names: list[str]) -> Iterator[Row]:
    from tempfile import TemporaryDirectory

    with TemporaryDirectory(prefix="uuv-hil-instruments-") as folder:
        path, wires = write_scenario(Path(folder), names, fault.faults)
        with Bench(path) as bench:
            try:
                slave = bench.start_slave()
                slave.expect("ready", READY_S)
                slave.expect("Ctrl-C", READY_S)
            except NetworkError as error:
                yield Row("instrument", fault.name, names[0], nan, nan, nan, 0, "", "", (str(error),))
                return
            drivers = [Driver(wire, fault.attack) for wire in wires]
            time.sleep(RUN_S)
            for driver in drivers:
                driver.stop()
            ended = "" if slave.running else f"the slave {slave.ending}"
            output = slave.output
        for driver in drivers:
            yield judge(_row(fault, driver, ended or ("a traceback" if "Traceback" in output else "")))


class Driver:
    """A driver of one instrument: reads until `stop`, and connects again whenever that fails."""

    def __init__(self, wire: Wire, attack: bool) -> None:
        self.wire, self._attack = wire, attack
        self.times: list[float] = []  # of sound messages
        self.bad = 0
        self._random = Random(wire.name)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End it."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        ask = ASKS.get(self.wire.name, Ask())
        while not self._ending.is_set():
            with suppress(OSError, HilError):
                self._read(Reader(self.wire.address, ask))
            self._ending.wait(LOOK_S)

    def _read(self, reader: Reader) -> None:
        """Read one connection to its end."""
        try:
            while not self._ending.is_set():
                reader.ask(time.monotonic_ns())
                if self._attack and self._random.random() < 0.3:
                    reader.send(self._random.randbytes(self._random.randrange(1, 200)))
                self._ending.wait(0.05)
                with suppress(BlockingIOError):
                    reader.read()
                self._take(reader)
        finally:
            reader.close()

    def _take(self, reader: Reader) -> None:
        size = 0
        for frame in split(bytes(reader.data)):
            size += frame.size
            if frame.ok is False:
                self.bad += 1
            else:
                self.times.append(time.monotonic())
        del reader.data[:size]


def _row(fault: InstrumentFault, driver: Driver, ended: str) -> Row:
    times, problems = driver.times, [ended] if ended else []
    gaps = [after - before for before, after in pairwise(times)]
    longest = max(gaps, default=nan)
    duration = UNTIL_S - FROM_S if fault.silences else 0.0
    if len(times) < LEAST or times[-1] < time.monotonic() - RECOVERY_S:
        problems.append(f"{len(times)} sound messages, the last one long ago")
    elif fault.silences and longest < duration - SLACK_S:
        problems.append(f"it spoke on: the longest silence was {longest:.1f} s")
    recovery = max(0.0, longest - duration) if times else nan
    reported = f"{len(times)} sound, {driver.bad} damaged"
    return Row("instrument", fault.name, driver.wire.name, nan, nan, recovery, 0, reported, "", tuple(problems))


def instrument_decoders() -> dict[str, tuple[Callable[[bytes], object], bytes]]:
    """Return name -> (reader of a client's bytes, valid bytes) of each instrument; the readers must not raise."""
    decoders: dict[str, tuple[Callable[[bytes], object], bytes]] = {}
    for name in INSTRUMENTS:
        kind = load_instrument(name, name)
        for wire in ("tcp", "pty", "udp", "http"):
            if wire in kind.wires and (wire != "pty" or "tcp" in kind.wires):
                sound = ASKS.get(name, Ask()).data or SOUND.get((name, wire), b"\r\n")
                decoders[f"instrument {name}, {wire}"] = _reader(kind, wire), sound
    return decoders


_JSON = b'{"command":"set_config","parameters":{"speed_of_sound":1480}}\n'
SOUND = {
    ("waterlinked_a50", "tcp"): _JSON, ("waterlinked_a125", "tcp"): _JSON,
    ("waterlinked_a50", "pty"): b"wcs,1450,,n,,,\n", ("waterlinked_a125", "pty"): b"wcs,1450,,n,,,\n",
    ("vectornav_vn100", "tcp"): b"$VNRRG,01*72\r\n", ("vectornav_vn200", "tcp"): b"$VNRRG,01*72\r\n",
    ("waterlinked_sonar_3d", "http"): b'{"mode":"multicast"}', ("waterlinked_ugps", "http"): b'{"depth":2.0}',
}  # fmt: skip


def _reader(kind: type[Instrument], wire: Any) -> Callable[[bytes], object]:
    desk = Desk(kind, load_sensor(kind.sensors[0]).Model(), client=Client(0, wire, "driver"), origin=(57.7, 11.9))

    def read(data: bytes) -> object:
        desk.now_ns += 10_000_000
        if wire != "http":
            return desk.ask(data) or None
        path = f"/api/v1/{data[:20].decode('latin-1')}"
        return desk.device.on_request("PUT", path, {"q": path}, data, desk.now_ns).body or None

    return read
