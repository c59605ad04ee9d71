"""Figures of a process against what the kernel says elsewhere."""

import os
import subprocess
import sys
import time
from types import ModuleType

import pytest

from hil.common import process


def test_memory_grows_with_what_is_touched() -> None:
    before = process.pss_mib()
    held = bytearray(os.urandom(2**20) * 32)
    grown = process.pss_mib() - before
    assert 31 < grown < 40, len(held)


def test_memory_that_is_asked_for_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is read again when it has changed, and when it has become old."""
    resident, pss = {"self": 30.0, 7: 5.0}, [20.0, 21.0, 22.0]
    monkeypatch.setattr(process, "resident_mib", lambda pid="self": resident[pid])
    monkeypatch.setattr(process, "own_pss_mib", lambda children: pss.pop(0))
    memory = process.Memory()
    assert [memory.pss_mib((7,)) for _ in range(5)] == [20.0] * 5
    resident[7] += 0.05
    assert memory.pss_mib((7,)) == 20.0
    resident[7] += 0.05
    assert [memory.pss_mib((7,)) for _ in range(5)] == [21.0] * 5
    monkeypatch.setattr(process.Memory, "OLDEST_S", 0.0)
    assert memory.pss_mib((7,)) == 22.0


def test_resident_memory_holds_all_that_is_shared() -> None:
    assert process.pss_mib() < process.resident_mib() < process.ram_mib()
    assert process.resident_mib(2**22 + 1) == 0.0, "beyond the largest process number there can be"


def test_a_process_that_is_gone_costs_nothing() -> None:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    assert process.pss_mib(child.pid) == 0.0
    assert process.cpu_s(child.pid) == 0.0


def test_processor_time_of_a_child() -> None:
    code = "import time\nwhile time.process_time() < 0.3: pass\nprint(flush=True)\ninput()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout
        child.stdout.readline()
        assert 0.28 <= process.cpu_s(child.pid) < 1.0
        assert process.own_cpu_s((child.pid,)) >= process.cpu_s(child.pid) + time.process_time() - 0.1
        child.communicate(b"\n")


def test_the_machine() -> None:
    assert process.ram_mib() > 100
    assert len(process.boot_id()) == 36
    assert process.boot_id() == process.boot_id()


def test_bytecode_of_what_is_not_loaded() -> None:
    assert not process.bytecode_compiled("no_such_package")


def test_what_is_in_c_needs_no_bytecode(monkeypatch: pytest.MonkeyPatch) -> None:
    package, twin, late = ModuleType("made_up"), ModuleType("made_up._twin"), ModuleType("made_up.late")
    monkeypatch.setattr(package, "__cached__", __file__, raising=False)
    twin.__file__, late.__file__ = "_twin.abi3.so", "late.py"
    monkeypatch.setitem(sys.modules, package.__name__, package)
    monkeypatch.setitem(sys.modules, twin.__name__, twin)
    assert process.bytecode_compiled("made_up")
    monkeypatch.setitem(sys.modules, late.__name__, late)
    assert not process.bytecode_compiled("made_up")
