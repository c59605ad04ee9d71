"""The whole board in emulation: its own kernel, systemd, CAN interfaces and network, for a job."""

import secrets
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping

from boards.emulation import MARK
from hil.common.children import foreign_command, start_child
from hil.common.errors import DeviceError
from hil.common.scratch import ScratchFolder
from tools.virtual_board.board import PROCESSOR, VirtualBoard
from tools.virtual_board.commands import TO_BOOT, missing
from tools.virtual_board.image import kernel, write_image

MEMORY = "2G"
PATIENCE_S = 300.0


class Booted:
    """The board, booted, with a job: a script of its shell. Use as a context, which ends it.

    `ports`: of this machine (localhost) -> of the board. The job's output is in `output`; `report` gets each line.
    Raises DeviceError when this machine cannot emulate it, or there is no board.
    """

    def __init__(
        self,
        board: VirtualBoard,
        job: str,
        ports: Mapping[int, int] | None = None,
        report: Callable[[str], None] | None = None,
    ) -> None:
        missing_tools = missing(TO_BOOT)
        if missing_tools:
            raise DeviceError(f"no virtual board can be booted here; {missing_tools}")
        board.require()
        self._mark = secrets.token_hex(8)
        self._report = report
        self._folder = ScratchFolder("board")
        self._lines: list[str] = []
        self.status: int | None = None
        try:
            image = self._folder.file("image")
            write_image(board, _script(job, self._mark), image)
            command = emulator(kernel(board), image, ports or {})
            self._process = start_child(
                foreign_command(*command), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
            )
        except BaseException:  # the archive takes seconds to write, and hundreds of megabytes
            self._folder.close()
            raise
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> "Booted":
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGKILL)
        self._process.wait()
        self._reader.join(5.0)
        if self._process.stdout:
            self._process.stdout.close()
        self._folder.close()

    @property
    def output(self) -> str:
        """Text that the job has printed so far."""
        return "\n".join(self._lines)

    def wait(self, seconds: float = PATIENCE_S) -> int:
        """Return the job's exit status, when it has ended and the board is off.

        Raises DeviceError if it takes longer.
        """
        end = time.monotonic() + seconds
        while self._process.poll() is None and time.monotonic() < end:
            time.sleep(0.1)
        self._reader.join(1.0)
        if self.status is None:
            raise DeviceError(f"the board did not end its job within {seconds:g} s; it had printed:\n{self.output}")
        return self.status

    def _read(self) -> None:
        assert self._process.stdout
        begun = False
        for line in self._process.stdout:
            text = line.decode("utf-8", "replace").rstrip()
            before, mark, remainder = text.partition(self._mark)
            if mark and remainder.strip() == "begin":
                begun = True
            elif mark:
                self.status, begun = int(remainder), False
            elif begun:
                self._lines.append(text)
                if self._report:
                    self._report(text)
            if mark and before:
                self._lines.append(before)


def emulator(kernel: str, image: str, ports: Mapping[int, int]) -> list[str]:
    """Return the command that boots `kernel` with `image`; its kernel's command line says that it is emulated."""
    forwards = "".join(f",hostfwd=tcp:127.0.0.1:{here}-:{there}" for here, there in ports.items())
    return [
        "qemu-system-aarch64", "-M", "virt", "-cpu", PROCESSOR, "-smp", "2", "-m", MEMORY, "-nographic",
        "-no-reboot", "-kernel", kernel, "-initrd", image,
        "-append", f"console=ttyAMA0 rdinit=/init quiet systemd.show_status=0 {MARK}=qemu-system-aarch64",
        "-netdev", f"user,id=net{forwards}", "-device", "virtio-net-pci,netdev=net,romfile=",
        "-object", "can-bus,id=bus", "-device", "kvaser_pci,canbus=bus", "-device", "kvaser_pci,canbus=bus",
    ]  # fmt: skip


def _script(job: str, mark: str) -> str:
    """Return the job, between marks; then the board is switched off."""
    return (
        f"#!/bin/sh\necho {mark} begin\n(\n{job}\n) 2>&1\necho {mark} $?\nsync\necho o >/proc/sysrq-trigger\nsleep 30\n"
    )
