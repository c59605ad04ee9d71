"""Memory that a slave has freed returns to the system, although its pages are locked."""

import subprocess
import sys

from tests.support.processes import ROOT

# Blocks of malloc, of which the last stays, so that the heap cannot shrink by itself.
CHILD = """
import ctypes
from hil.common.clock import lock_memory
from hil.slave.usage import ReturnedMemory, resident_mib
libc = ctypes.CDLL(None)
libc.malloc.restype, libc.free.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
lock_memory()
returned = ReturnedMemory()
returned.check()
before = resident_mib()
blocks = [libc.malloc(400) for _ in range(60_000)]
for block in blocks:
    ctypes.memset(block, 1, 400)
for block in blocks[:-1]:
    libc.free(block)
del blocks
grown = resident_mib() - before
returned.check()
print(grown, resident_mib() - before)
"""


def test_freed_memory_is_returned_after_a_growth() -> None:
    run = subprocess.run([sys.executable, "-c", CHILD], cwd=ROOT, capture_output=True, text=True, check=True)
    grown, left = map(float, run.stdout.split())
    assert grown > 20
    assert left < 5
