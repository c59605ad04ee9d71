"""Measure CPU and memory of slaves over time, by sensors, rates and number of vehicles."""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack
from itertools import pairwise
from typing import Any, NamedTuple

from hil.autonomy.control.controller import VelocityCommand
from hil.bench.harness import Bench, Process, await_vehicle
from hil.bench.presence import check_end, check_present
from hil.bench.processes import Usage, read_usage, role, shares
from hil.bench.record import median, spread
from hil.ros.topics import TOPICS, is_picture
from hil.scenario.config import FEEDBACK
from sim.sensors.kinds import SENSORS

PICTURES = [name for name in TOPICS if is_picture(name)]
COMMAND_HZ = 20.0
EVERY_S = 1.0


class Setting(NamedTuple):
    """One configuration: changes to the scenario, and how many slaves."""

    name: str
    changes: dict[str, Any]
    vehicles: int = 1


class Cost(NamedTuple):
    """Cost of one process, a value a second: CPU (share of a core), memory (MiB)."""

    cpu: list[float]
    memory: list[float]


class Course(NamedTuple):
    """Cost of each process of a setting by its name: its role, "slave", "STM32" or "imaging", behind its node.

    The node is left out if there is only one. A setting that could not be measured has no processes, but a `failure`.
    """

    setting: Setting
    processes: dict[str, Cost] = {}  # noqa: RUF012 - never changed
    labels: tuple[str, ...] = ()
    failure: str = ""

    @property
    def cpu(self) -> list[float]:
        """CPU of all processes together (share of a core), a value a second."""
        return [sum(values) for values in zip(*(cost.cpu for cost in self.processes.values()), strict=True)]

    @property
    def memory(self) -> list[float]:
        """Memory of all processes together (MiB), a value a second."""
        return [sum(values) for values in zip(*(cost.memory for cost in self.processes.values()), strict=True)]


def settings(fitted: Collection[str] | None, rates: list[float], vehicles: list[int]) -> Iterator[Setting]:
    """Yield the unchanged scenario; one sensor less or more each; loop rates (Hz); numbers of vehicles.

    fitted: the sensors it has; None: do not change them. The last setting is the unchanged scenario again, which
    shows how much the figures vary.
    """
    yield Setting("as it is", {})
    for name in SENSORS if fitted is not None else ():
        if name in (fitted or ()) and name not in FEEDBACK:  # which the controller needs
            yield Setting(f"without {name}", {f"sensors.{name}.rate": 0})
        elif name not in (fitted or ()):
            yield Setting(f"with {name}", {f"sensors.{name}": {}})
    for rate in rates:
        yield Setting(f"{rate:g} Hz", {"slave.step": 1.0 / rate, "slave.control_period": max(0.02, 2.0 / rate)})
    for count in vehicles:
        yield Setting(f"{count} vehicle{'s' * (count > 1)}", {}, count)
    if fitted is not None or rates or vehicles:
        yield Setting("as it is, again", {})


def run(
    setting: Setting, scenario: str, seconds: float, under: Sequence[str], watch: Callable[[float], None]
) -> Course:
    """Command slaves for `seconds`; `watch` is called with the progress (0 to 1). Raises HilError."""
    with ExitStack() as stack:
        benches = [
            stack.enter_context(Bench(scenario, {**setting.changes, "slave.node": f"uuv{number + 1}"}, under))
            for number in range(setting.vehicles)
        ]
        slaves = [bench.start_slave() for bench in benches]
        clients = [stack.enter_context(bench.client()) for bench in benches]
        pairs = list(zip(clients, slaves, strict=True))
        for client, slave in pairs:
            await_vehicle(client, slave)
            client.watch(*PICTURES)  # which are only made for subscribers
        names: dict[int, str] = {}

        def command() -> None:
            for client in clients:
                client.command(VelocityCommand(surge=0.3))

        def read_all() -> Usage:
            for client, slave in pairs:
                check_present(client, slave)
            for client, slave in pairs:
                _name(slave, f"{client.node} " if len(pairs) > 1 else "", names)
            return read_usage(list(names))

        _pace(EVERY_S, command)  # the first second is that of the start
        readings = [read_all()]
        while len(readings) <= max(round(seconds / EVERY_S), 1):
            _pace(EVERY_S, command)
            readings.append(read_all())
            watch((len(readings) - 1) * EVERY_S / seconds)
        for client, slave in pairs:
            check_end(client, slave)
        return course(setting, readings, names)._replace(labels=benches[0].labels)


def _name(slave: Process, prefix: str, names: dict[int, str]) -> None:
    """Give each process of a slave's family a name, if it has none yet."""
    for pid in slave.family():
        if pid not in names:
            name = prefix + role(pid, slave.pid)
            same = sum(known == name or known.startswith(f"{name} #") for known in names.values())
            names[pid] = f"{name} #{same + 1}" if same else name


def _pace(seconds: float, command: Callable[[], None]) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        command()
        time.sleep(1.0 / COMMAND_HZ)


def course(setting: Setting, readings: list[Usage], names: dict[int, str]) -> Course:
    """Return CPU and memory of the named processes between the readings."""
    steps = [shares(before, after) for before, after in pairwise(readings)]
    processes = {}
    for pid, name in names.items():
        memory = [each.memory[pid].pss_mib if pid in each.memory else 0.0 for each in readings[1:]]
        processes[name] = Cost([step.get(pid, 0.0) for step in steps], memory)
    return Course(setting, processes)


def difference(values: list[float], base: list[float], again: Collection[list[float]] = ()) -> tuple[float, bool]:
    """Return the difference of two series' medians, and whether it is larger than its noise.

    Noise is the larger of their interquartile ranges and the distance of `again`, repetitions of the base, from it.
    """
    apart = [abs(median(each) - median(base)) for each in again]
    more = median(values) - median(base)
    return more, abs(more) > max(spread(values), spread(base), *apart, 0.0)
