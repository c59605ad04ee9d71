"""The launcher of User Mode Linux: the environment of a command, its end, and errors."""

import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from hil.common.errors import DeviceError
from tests.support.processes import command_line
from tools import uml

SCRIPT = """
echo $WHO in $(pwd)
test $(id -u) = 0 && ls /sys/class/net && uname -r
echo lost > {lost}
echo kept > "{share}/kept"
printf 'two\\n\\nlast without end'
exit 7
"""

# Sets the extended registers of a stopped child from less than their full size, as User Mode Linux does.
SET_REGISTERS = """
import ctypes, os, signal, sys
libc = ctypes.CDLL(None)
libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
child = os.fork()
if not child:
    libc.ptrace(0, 0, None, None)
    os.kill(os.getpid(), signal.SIGSTOP)
    os._exit(0)
os.waitpid(child, os.WUNTRACED)
buffer = ctypes.create_string_buffer({size})
vector = (ctypes.c_size_t * 2)(ctypes.addressof(buffer), {size})
read = libc.ptrace(0x4204, child, 0x202, ctypes.addressof(vector))
vector[1] = {size}
written = libc.ptrace(0x4205, child, 0x202, ctypes.addressof(vector))
os.kill(child, signal.SIGKILL)
print(read, written)
"""
LEGACY_SIZE = 576  # of XSAVE's fixed part: every processor that has AVX has more


def test_a_command_runs_as_root_and_leaves_only_its_share(tmp_path: Path) -> None:
    share, lost = tmp_path / "a share", tmp_path / "lost"
    share.mkdir()
    reported: list[str] = []
    script = SCRIPT.format(share=share, lost=lost)
    ended = uml.run(
        ["sh", "-c", script], ["vcan"], str(share), {"WHO": "it's me"}, cwd=str(tmp_path), report=reported.append
    )
    assert ended.status == 7
    release = next(uml.MODULES.iterdir()).name
    assert ended.output.splitlines() == [f"it's me in {tmp_path}", "lo", release, "two", "", "last without end"]
    assert reported == ended.output.splitlines()
    assert (share / "kept").read_text() == "kept\n"
    assert not lost.exists()
    assert processes() == 0


def test_a_command_that_does_not_end_is_killed(tmp_path: Path) -> None:
    for seconds in (3, 12, 48):  # a busy machine takes longer until the command prints
        with pytest.raises(DeviceError, match=rf"killed after {seconds} s") as caught:
            uml.run(["sh", "-c", "echo first; sleep 600"], seconds=seconds)
        assert processes() == 0
        if str(caught.value).endswith("; the command had printed:\nfirst"):
            return
    pytest.fail(str(caught.value))


def test_the_shim_accepts_short_register_buffers() -> None:
    """The processor's registers are set from a buffer that is too short, with the shim and only with it."""
    code = SET_REGISTERS.format(size=LEGACY_SIZE)
    output = []
    for preload in ("", uml._shim()):
        environment = {**os.environ, "LD_PRELOAD": preload}
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
        output.append(done.stdout.split())
    assert output == [["0", "-1"], ["0", "0"]], "a processor without AVX would not need the shim"


def processes() -> int:
    """Return the number of remaining processes of the guest; killed ones may take a moment to end."""
    return sum("linux.uml mem=" in command_line(pid) for pid in psutil.pids())  # a zombie has no command line
