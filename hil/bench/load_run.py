"""What slaves cost over time, by what they do: sensors, rates, how many vehicles."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import pairwise
from typing import Any, NamedTuple

from hil.autonomy.control import VelocityCommand
from hil.bench.harness import Bench, await_vehicle
from hil.bench.limits import Limits
from hil.bench.processes import Threads, by_name, look, shares
from hil.bench.statistics import median
from hil.errors import NetworkError
from hil.topics import TOPICS, is_picture
from sim.sensors.suite import SENSORS, USUAL

PICTURES = [name for name in TOPICS if is_picture(name)]
COMMAND_HZ = 20.0
EVERY_S = 1.0


class Setting(NamedTuple):
    """One thing that slaves are asked to do: changes to the scenario, and how many slaves."""

    name: str
    changes: dict[str, Any]
    vehicles: int = 1


class Course(NamedTuple):
    """CPU (share of a core) and memory (MiB) of all slaves together, a value a second; shares by thread name."""

    setting: Setting
    cpu: list[float]
    memory: list[float]
    threads: dict[str, float]


def settings(sensors: bool, rates: list[float], vehicles: list[int]) -> Iterator[Setting]:
    """The scenario as it is; each sensor by itself taken out or put in; loop rates (Hz); numbers of vehicles."""
    yield Setting("as it is", {})
    if sensors:
        for name in SENSORS:
            key = f"sensors.{name}"
            if name in USUAL and name not in ("imu", "odometry", "pressure"):  # which the controller lives on
                yield Setting(f"without {name}", {f"{key}.rate": 0})
            elif name not in USUAL:
                yield Setting(f"with {name}", {key: {}})
    for rate in rates:
        yield Setting(f"{rate:g} Hz", {"slave.step": 1.0 / rate, "slave.control_period": max(0.02, 2.0 / rate)})
    for count in vehicles:
        yield Setting(f"{count} vehicle{'s' * (count > 1)}", {}, count)


def run(setting: Setting, scenario: str, seconds: float, limits: Limits, watch: Callable[[float], None]) -> Course:
    """Let slaves be commanded for so long; `watch` is told the share that is done. Raises HilError."""
    with ExitStack() as stack:
        benches = [
            stack.enter_context(Bench(scenario, {**setting.changes, "slave.node": f"uuv{number + 1}"}, limits))
            for number in range(setting.vehicles)
        ]
        slaves = [bench.start_slave() for bench in benches]
        clients = [stack.enter_context(bench.client()) for bench in benches]
        for client, slave in zip(clients, slaves, strict=True):
            await_vehicle(client, slave)
            client.watch(*PICTURES)  # which are not made for nobody

        def command() -> None:
            for client in clients:
                client.command(VelocityCommand(surge=0.3))

        def pids() -> list[int]:
            gone = next((slave for slave in slaves if not slave.running), None)
            if gone:
                raise NetworkError(f"a slave ended: {gone.last_words}")
            return [pid for slave in slaves for pid in slave.family()]

        _pace(EVERY_S, command)  # the first second is that of the start
        looks = [look(pids())]
        while len(looks) <= max(round(seconds / EVERY_S), 1):
            _pace(EVERY_S, command)
            looks.append(look(pids()))
            watch((len(looks) - 1) * EVERY_S / seconds)
    return _course(setting, looks)


def _pace(seconds: float, command: Callable[[], None]) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        command()
        time.sleep(1.0 / COMMAND_HZ)


def _course(setting: Setting, looks: list[Threads]) -> Course:
    steps = [shares(before, after) for before, after in pairwise(looks)]
    whole = by_name(shares(looks[0], looks[-1]))
    return Course(setting, [sum(step.values()) for step in steps], [each.pss_mib for each in looks[1:]], whole)


def middle(course: Course) -> tuple[float, float]:
    """Median CPU (share of a core) and memory (MiB)."""
    return median(course.cpu), median(course.memory)
