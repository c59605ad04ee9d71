"""Memory and processor time of a process, compared with other figures of the kernel."""

import os
import subprocess
import sys
import time

import pytest

from hil.slave import usage


def test_memory_grows_with_touched_pages() -> None:
    before = usage.pss_mib()
    held = bytearray(os.urandom(2**20) * 32)
    grown = usage.pss_mib() - before
    assert 31 < grown < 40, len(held)


def test_frequent_requests_of_memory_use_a_cached_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """The file is read again when it has changed and when the value is old."""
    resident, pss = {"self": 30.0, 7: 5.0}, [20.0, 21.0, 22.0]
    monkeypatch.setattr(usage, "resident_mib", lambda pid="self": resident[pid])
    monkeypatch.setattr(usage, "own_pss_mib", lambda children: pss.pop(0))
    memory = usage.Memory()
    assert [memory.pss_mib((7,)) for _ in range(5)] == [20.0] * 5
    resident[7] += 0.05
    assert memory.pss_mib((7,)) == 20.0
    resident[7] += 0.05
    assert [memory.pss_mib((7,)) for _ in range(5)] == [21.0] * 5
    monkeypatch.setattr(usage.Memory, "OLDEST_S", 0.0)
    assert memory.pss_mib((7,)) == 22.0


def test_resident_memory_includes_shared_memory() -> None:
    assert usage.pss_mib() < usage.resident_mib() < usage.ram_mib()
    assert usage.resident_mib(2**22 + 1) == 0.0, "beyond the largest process number there can be"


def test_an_ended_process_takes_no_memory_and_time() -> None:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    assert usage.pss_mib(child.pid) == 0.0
    assert usage.cpu_s(child.pid) == 0.0


def test_processor_time_of_a_child_is_counted() -> None:
    code = "import time\nwhile time.process_time() < 0.3: pass\nprint(flush=True)\ninput()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout
        child.stdout.readline()
        assert 0.28 <= usage.cpu_s(child.pid) < 1.0
        assert usage.own_cpu_s((child.pid,)) >= usage.cpu_s(child.pid) + time.process_time() - 0.1
        child.communicate(b"\n")
