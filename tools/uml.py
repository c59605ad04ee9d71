"""Run a command under User Mode Linux: a separate Linux kernel that runs as a process (tests/system/uml).

It is for tests that this machine's kernel does not support or must not run: CAN interfaces, network faults, namespaces.
The command runs as root inside, and sees this machine's files, programs and names of devices, at this machine's speed,
on one CPU. Files that it writes are lost afterwards, except in the shared folder. It has only its own network.
Start and end take a second. The user need not be root on this machine.

Needs: apt install user-mode-linux busybox-static gcc libc6-dev (x86 only).
"""

import contextlib
import hashlib
import os
import platform
import secrets
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from firmware_stub.native import cache_folder
from hil.common.children import foreign_command, start_child
from hil.common.errors import DeviceError

SHIM = Path(__file__).with_name("uml_ptrace.c")
MODULES = Path("/usr/lib/uml/modules")
MEMORY_MIB = 512
SHARED_MEMORY = "/dev/shm"

# Process 1. This machine's files are the read-only lower layer of an overlay.
INIT = """#!{busybox} sh
b={busybox}
begin() {{
  set -e
  $b mount -t proc proc /proc
  for module in {modules}; do $b insmod $module; done
  $b mount -t tmpfs tmpfs /mnt
  $b mkdir /mnt/written /mnt/work /mnt/root
  $b mount -t overlay -o lowerdir=/,upperdir=/mnt/written,workdir=/mnt/work overlay /mnt/root
  cd /mnt/root
  $b mount -t proc proc proc
  $b mount -t sysfs sysfs sys
  $b mount -t devtmpfs dev dev
  $b mkdir -p dev/pts dev/shm
  $b mount -t devpts -o ptmxmode=0666 devpts dev/pts
  $b mount -t tmpfs tmpfs dev/shm
  $b mount -t tmpfs tmpfs run
  {share}
  $b ip link set lo up
}}
begin
set +e
($b sleep {orphan}; echo o >/proc/sysrq-trigger) & # in case its parent cannot kill it any more
echo {mark} begin
$b chroot . /bin/sh -c {steps} </dev/null 2>&1
echo {mark} end $?
echo o >/proc/sysrq-trigger
$b sleep 10
"""


class Outcome(NamedTuple):
    """Exit status and output of a command."""

    status: int
    output: str


def unavailable_reason() -> str:
    """Return why User Mode Linux cannot run here, with the remedy; "" if it can."""
    for program, package in (("linux.uml", "user-mode-linux"), ("busybox", "busybox-static"), ("cc", "gcc libc6-dev")):
        if not shutil.which(program):
            return f"there is no {program}: sudo apt install {package} (packages of Debian, for x86 only)"
    trace_me = "import ctypes, sys; sys.exit(ctypes.CDLL(None).ptrace(0, 0, 0, 0) != 0)"
    if subprocess.run([sys.executable, "-c", trace_me], check=False).returncode:
        return "ptrace is not permitted here; in a container: docker run --cap-add SYS_PTRACE"
    return ""


def run(
    command: Sequence[str], modules: Sequence[str], share: str, environment: Mapping[str, str], seconds: float, cwd: str
) -> Outcome:
    """Run `command` in the working folder `cwd` under User Mode Linux.

    modules: kernel modules, loaded first with those they need. share: a folder of this machine that it may write to.
    environment: variables, besides PATH, HOME and LANG. seconds: limit, after which it is killed.
    Raises DeviceError if it does not start, with the kernel's last lines, or does not end in time.
    """
    reason = unavailable_reason()
    if reason:
        raise DeviceError(f"User Mode Linux: {reason}")
    mark = f"uml-{secrets.token_hex(8)}"
    with tempfile.TemporaryDirectory(prefix="uml-") as folder:
        init = Path(folder, "init")
        steps = _steps(command, environment, cwd)
        init.write_text(_init(mark, steps, modules, share, seconds), encoding="utf-8")
        init.chmod(0o755)
        cpu = max(os.sched_getaffinity(0))
        return _follow(["taskset", "-c", str(cpu), *_kernel(str(init))], mark, seconds)


def module_files(names: Sequence[str]) -> list[str]:
    """Return the files of these kernel modules and of those they need, in the order to load them.

    Raises DeviceError if there is no such module.
    """
    (release,) = MODULES.iterdir()  # the package holds those of one kernel
    needs = {}
    for line in (release / "modules.dep").read_text(encoding="utf-8").splitlines():
        file, _, needed = line.partition(":")
        needs[Path(file).stem.replace("_", "-")] = [*reversed(needed.split()), file]
    unknown = [name for name in names if name.replace("_", "-") not in needs]
    if unknown:
        raise DeviceError(f"User Mode Linux: no module {', '.join(unknown)} in {release}; see its modules.dep")
    files = [str(release / file) for name in names for file in needs[name.replace("_", "-")]]
    return list(dict.fromkeys(files))


def _steps(command: Sequence[str], environment: Mapping[str, str], cwd: str) -> str:
    """Return the shell commands that run the command as on this machine."""
    path = os.environ.get("PATH", os.defpath) + ":/usr/sbin:/sbin"  # it is root
    variables = {"PATH": path, "HOME": os.environ.get("HOME", "/"), "LANG": "C.UTF-8", **environment}
    exports = [f"export {name}={shlex.quote(value)}" for name, value in variables.items()]
    return "\n".join([f"cd {shlex.quote(cwd)}", *exports, f"exec {shlex.join(command)}"])


def _init(mark: str, steps: str, modules: Sequence[str], share: str, seconds: float) -> str:
    """Return the text of process 1."""
    folder = os.path.realpath(share)
    mount = f"$b mount -t hostfs -o {shlex.quote(folder)} share {shlex.quote(folder.lstrip('/'))}"
    return INIT.format(
        busybox=shutil.which("busybox"),
        modules=" ".join(module_files(["overlay", *modules])),
        share=mount,
        orphan=round(seconds) + 5,
        mark=mark,
        steps=shlex.quote(steps),
    )


def _kernel(init: str) -> list[str]:
    """Return the kernel as a command; it prints on its standard output alone."""
    return [
        *("env", f"LD_PRELOAD={_shim()}", f"TMPDIR={_memory_folder()}"),
        *("linux.uml", f"mem={MEMORY_MIB}M", "rootfstype=hostfs", "rootflags=/", "ro", f"init={init}"),
        *("con=null", "con0=null,fd:1", "con1=null", "ssl=null", "quiet", "panic=1"),
        *("umid=guest", f"uml_dir={os.path.dirname(init)}/"),
    ]


def _memory_folder() -> str:
    """Return the folder of the file that is its memory: in RAM if there is enough."""
    if os.path.isdir(SHARED_MEMORY):
        free = os.statvfs(SHARED_MEMORY)
        if free.f_bavail * free.f_frsize > MEMORY_MIB << 20:
            return SHARED_MEMORY
    return tempfile.gettempdir()


def _shim() -> str:
    """Return the library to preload, compiled once. Raises DeviceError if it cannot be."""
    key = hashlib.sha256(SHIM.read_bytes() + platform.machine().encode()).hexdigest()[:16]
    library = os.path.join(cache_folder(), f"uml-ptrace-{key}.so")
    if os.path.exists(library):
        return library
    os.makedirs(cache_folder(), exist_ok=True)
    new = f"{library}.{os.getpid()}"  # renamed when complete: two processes may compile at once
    compiler = ["cc", "-O2", "-shared", "-fPIC", "-o", new, str(SHIM), "-ldl"]
    done = subprocess.run(compiler, capture_output=True, text=True, check=False)
    if done.returncode:
        raise DeviceError(f"User Mode Linux: {SHIM} does not compile: {done.stderr.strip()}")
    os.replace(new, library)
    return library


def _follow(kernel: Sequence[str], mark: str, seconds: float) -> Outcome:
    """Start the kernel, wait until it has ended, and separate the command's output from the kernel's."""
    process = start_child(
        foreign_command(*kernel),
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
    )  # fmt: skip
    end = "ended before its time"
    try:
        printed, _ = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        end = f"killed after {seconds:g} s"
        _kill(process)
        printed, _ = process.communicate()
    finally:
        _kill(process)
    boot, begun, behind = printed.replace("\r", "").partition(f"{mark} begin\n")
    output, ended, status = behind.partition(f"{mark} end ")
    if ended:
        return Outcome(int(status.split()[0]), output)
    last_words = f"; the command had printed:\n{output}" if begun else f", before the command began: {boot[-800:]}"
    raise DeviceError(f"User Mode Linux: {end}{last_words}")


def _kill(process: "subprocess.Popen[str]") -> None:
    """Kill the kernel and all its helpers."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
