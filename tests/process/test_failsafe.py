"""The thrusters stop when a part of the chain fails, and start again: rows of the fault campaign on one link.

`python -m tools.faults` measures their times on every link. On a busy machine processes wake late, so only the order of
these times is checked here.
"""

from collections.abc import Iterator
from math import isfinite

import pytest

from tests.support.processes import wait_for
from tools.faults.kinds.line import FAULTS
from tools.faults.links import USUAL
from tools.faults.measure import measure
from tools.faults.rig import Rig

SLACK_S = 3.0
# fault -> what the slave reports of it
REPORTED = {
    "unplugged": ("thruster link lost, the STM32's watchdog stops the thrusters", "thruster link back after"),
    "noise both ways": ("deadman: no command in time, stopping the thrusters",),
    "commands lost": ("the STM32's watchdog tripped",),
    "reports lost": ("the STM32 has not answered for 0.5 s; check wiring, baud", "the STM32 answers, after"),
    "STM32 killed": ("the STM32 has restarted",),
    "slave paused for 2 s": ("the STM32's watchdog tripped",),
    "slave killed": ("ready",),
}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    with Rig(USUAL, tmp_path_factory.mktemp("failsafe")) as rig:
        rig.start()
        yield rig


@pytest.mark.parametrize("name", REPORTED)
def test_the_thrusters_stop_and_start_again(name: str, rig: Rig) -> None:
    (fault,) = [fault for fault in FAULTS if fault.name == name]
    before = {path: path.stat().st_size for path in rig.folder.glob("slave-*.log")}
    row = measure(rig, fault)

    def logged() -> str:
        return "".join(path.read_text()[before.get(path, 0) :] for path in sorted(rig.folder.glob("slave-*.log")))

    assert row.neutral_s < row.limit_s + SLACK_S, row.problems
    assert isfinite(row.recovery_s), row.problems
    assert row.leaked == ""
    assert wait_for(lambda: all(text in logged() for text in REPORTED[name])), logged()  # lines may be late
    assert "Traceback" not in logged()
