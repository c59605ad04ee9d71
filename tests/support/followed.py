"""Follow a page as a reader would: save its files, type its commands in order, compare their output.

Addresses are changed, so that several pages can be followed at once: all machines are this one, a slave listens
on a free port, and clients of the usual port connect to that one. Repetitions with many seeds have only two.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from hil.cli import find_command
from hil.common.children import package_environment
from tests.support.documents import ROOT, Block, blocks
from tests.support.processes import Program, free_port, wait_for

# What is not typed, and why: the page says at its place what it needs.
NOT_TYPED = {
    r"/path/to|^ardusub ": "needs an autopilot's program",
    r"/dev/tty|can:socketcan": "needs a device",
    r"stm32 flash(?!.*--dry-run)": "needs a board; tests/system/firmware_stub/test_flash.py",
    r"board install|^sudo ": "changes the machine",
    r"^git clone|^pip install|^python3 -m venv|^\. \.venv": "is done: the project is installed",
    r"^ros2 |^export |^source |gateway ros2": "needs ROS 2",
    r"fleet\.toml(?! --copy)(?<!scenario check fleet\.toml)": "needs the ports of its members, or other machines",
    r"^cat /proc": "needs an Arm board",
}
CHARTS = os.environ.get("UUV_HIL_CHARTS", "")
# What runs until Ctrl-C, and what it says when it does what it is for.
UNTIL_CTRL_C = {
    "--view": r"watch at", "slave": r"ready", "router": r"forwarding", "stm32": r"Ctrl-C",
    "gateway json": r"lines of JSON", "gateway foxglove": r"connected:",
    "topic hz": r"[1-9]\d*\.\d\d Hz", "topic pub": r"publishing",
    "top": r"loop \(Hz\)",
    "recording make": r"recording", "fleet agent": r"", "fleet channel": r"modems of", "view": r"watch at",
    "gateway mavlink": r"Ctrl-C ends it",
}  # fmt: skip
SERVERS = ("slave", "stm32", "router")  # they stay while the rest of the page is followed
LISTENERS = {"slave", "demo", "recording replay"}
CLIENTS = {"topic", "top", "recording make", "gateway foxglove", "gateway json", "view", "gateway mavlink"}
SECONDS = 400.0


class Step(NamedTuple):
    """One command of a page, and its output."""

    line: str
    output: str


class Follower:
    """Follow one page in a folder. Use as a context, which ends the programs that still run."""

    def __init__(self, page: str, folder: Path) -> None:
        self.page, self.folder, self.cwd = page, folder, folder
        self.port = free_port()
        self.steps: list[Step] = []
        self.skipped: list[tuple[str, str]] = []  # a line that was not typed, and why
        for chart in Path(CHARTS).glob("US5AK5SI/*.0*") if CHARTS else ():
            shutil.copy(chart, folder)
        self._running = ExitStack()
        self._servers: dict[str, Program] = {}

    def __enter__(self) -> "Follower":
        return self

    def __exit__(self, *_: object) -> None:
        self._running.close()

    def follow(self) -> None:
        """Execute the whole page. Fails with the line whose result differs from the page."""
        for block in blocks("shell", "text", "toml", "python", "xml", page=ROOT / self.page):
            location = f"{self.page}:{block.line}"
            if block.language == "text":
                if not is_fenced(block):
                    continue
                self._compare(block, location)
            elif block.language == "shell":
                for line in block.text.replace("\\\n", " ").splitlines():
                    self._type(re.sub(r"\s{2,}#\s.*$", "", line).strip(), location)
            elif name := file_of(block):
                self._save(name, block)
            elif block.language == "python":
                self._run_python(block.text, location)

    def _save(self, name: str, block: Block) -> None:
        path = self.cwd / name
        appended = re.search(r"Add at the end of `[^`]+`:\s*$", block.before)
        path.write_text((path.read_text() if appended else "") + self._with_local_addresses(block.text))

    def _with_local_addresses(self, text: str) -> str:
        """Return a text with its addresses on this machine, and the port of this page."""
        text = re.sub(r"192\.168\.3\.11[67]|ADDRESS-OF-THE-BOARD|\b0\.0\.0\.0\b", "127.0.0.1", text)
        return text.replace("127.0.0.1:7447", f"127.0.0.1:{self.port}")

    def _compare(self, block: Block, location: str) -> None:
        """Treat a block of text as a replacement of a line, or compare it with the output of the command before it."""
        reported = re.search(r"In `(\w+\.toml)`, replace the line `([^`]+)`:\s*$", block.before)
        if reported:
            path = self.cwd / reported[1]
            assert reported[2] in path.read_text(), f"{location}: {reported[1]} has no line {reported[2]!r}"
            path.write_text(path.read_text().replace(reported[2], self._with_local_addresses(block.text.strip())))
            return
        if not self.steps:
            return
        outputs = [step.output for step in self.steps[-3:]]
        for line in filter(None, map(str.strip, block.text.splitlines())):
            if line != "...":
                found = any(pattern_of(line).search(output) for output in outputs)
                assert found, f"{location}: no line like {line!r} in\n" + "\n".join(outputs)

    def _type(self, line: str, location: str) -> None:
        line = {"make demo": "uuv-hil demo"}.get(line, line)
        if not line:
            return
        reasons = [reason for pattern, reason in NOT_TYPED.items() if re.search(pattern, line)]
        if not CHARTS and re.search("US5AK5SI|homer", line):
            reasons.append("UUV_HIL_CHARTS names no folder with NOAA's cells")
        if not shutil.which("arm-none-eabi-gcc") and re.search(r"firmware_stub\.build|uuv_hil_stm32\w+\.bin", line):
            reasons.append("needs a compiler for Arm")
        if reasons:
            self.skipped.append((line, reasons[0]))
            return
        arguments = line.removesuffix("&").split()
        if arguments[0] == "mkdir" or arguments[0] == "cd":
            for folder in re.findall(r"(?:mkdir|cd) (\w+)", line):
                (self.cwd / folder).mkdir(exist_ok=True)
            self.cwd = self.cwd / re.findall(r"cd (\w+)", line)[-1]
            return
        if arguments[0] == "uuv-hil":
            self._command(self._addressed(line), location)
            return
        process = subprocess.run(
            ["bash", "-c", re.sub("^python ", f"{sys.executable} ", line)],
            cwd=self.cwd,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert process.returncode == 0, f"{location}: {line}\n{process.stderr}"

    def _addressed(self, line: str) -> str:
        line = re.sub(r"--seeds \d+", "--seeds 2", self._with_local_addresses(line)).replace(
            ":14550", f":{free_port()}"
        )
        name, _ = find_command(line.split()[1:])
        secured = any("tls/" in file.read_text() for file in self.cwd.glob("*.toml") if file.name in line)
        if name in LISTENERS and not secured and not re.search("--listen|--check|--connect|--foxglove", line):
            line += f" --listen tcp/127.0.0.1:{self.port}"
        if name in CLIENTS and "--connect" not in line and "--matlab" not in line:
            line += f" --connect tcp/127.0.0.1:{self.port}"
        if re.search("topic (echo|hz)", line):
            line += " --wait 60"  # for a camera that starts on a busy machine
        if name in ("gateway json", "gateway foxglove", "view") and "--listen" not in line:
            line += " --listen 127.0.0.1:0"
        if name == "gateway mavlink" and "--endpoint" not in line:
            line += f" --endpoint tcpin:127.0.0.1:{free_port()}"
        return line

    def _command(self, line: str, location: str) -> None:
        arguments = line.removesuffix("&").split()[1:]
        names = [word for word in arguments if word == "--view"] + [" ".join(arguments[:2]), arguments[0]]
        name = next((n for n in names if n in UNTIL_CTRL_C), "")
        endless = name and not {
            "--count",
            "--once",
            "--matlab",
            "--json",
            "--layout",
            "--yes",
            "--dry-run",
        } & set(arguments)
        command = ["bash", "-c", f'exec {sys.executable} -m hil "$@"'.replace('"$@"', line.removeprefix("uuv-hil "))]
        path = os.pathsep.join([str(self.cwd), str(ROOT)])
        environment = {**package_environment(), "COLUMNS": "80", "PYTHONPATH": path}
        listens = find_command(arguments)[0] in LISTENERS and "--foxglove" not in arguments
        replaced = "slave" if listens else name if endless else ""  # which listens where this will
        if replaced in self._servers:
            self._servers.pop(replaced).stop(signal.SIGINT)
        program = Program(self.folder, command=command, cwd=self.cwd, environment=environment)
        self._running.enter_context(program)
        if endless:
            program.expect(UNTIL_CTRL_C[name])
            if name in SERVERS:
                self._servers[name] = program
            else:
                wait_for(lambda: program.process.poll() is not None, 1.5)  # it works for a while
                codes = (0, 6, 130) if name == "--view" else (0, 130)  # 6: a mission that did not arrive
                assert program.stop(signal.SIGINT) in codes, f"{location}: {line}\n{program.output}"
        else:
            code = program.wait(SECONDS)
            late = "goal reached" in program.output and "link lost" in program.output  # as on a machine that is busy
            wanted = (0, 6) if late else expected_code(arguments)
            assert code in wanted, f"{location}: {line}: exit code {code}\n{program.output}"
        assert "Traceback" not in program.output, f"{location}: {line}\n{program.output}"
        self.steps.append(Step(line, program.output))

    def _run_python(self, text: str, location: str) -> None:
        code = self._with_local_addresses(text)
        process = subprocess.run(
            [sys.executable, "-c", code], cwd=self.cwd, capture_output=True, text=True, timeout=120, check=False,
            env={**os.environ, **package_environment()},
        )  # fmt: skip
        assert process.returncode == 0, f"{location}: {process.stderr}"
        self.steps.append(Step("python", process.stdout))


def follow(page: str, folder: Path) -> int:
    """Follow a page in this folder; return how many commands were typed."""
    with Follower(page, folder) as follower:
        follower.follow()
        print(*(f"typed: {step.line}" for step in follower.steps), sep="\n")
        print(*(f"not typed: {line}: {reason}" for line, reason in follower.skipped), sep="\n")
        return len(follower.steps)


def expected_code(arguments: list[str]) -> tuple[int, ...]:
    """Return the exit codes of a command that a page shows: a check may find what the page describes."""
    if "--import" in arguments:
        return 0, 2
    return (0, 1) if arguments[0] in ("doctor", "bench") or arguments[:2] == ["scenario", "check"] else (0,)


def is_fenced(block: Block) -> bool:
    """Return True if the block is fenced; an indented one is for another machine."""
    return (ROOT / block.page).read_text().split("\n")[block.line - 1].startswith("```")


def file_of(block: Block) -> str:
    """Return the file name that the text before a block gives, with any ending."""
    found = re.findall(r"`(\w+\.(?:py|toml|urdf|sdf))`[^`]*:\s*$", block.before.rstrip()[-120:])
    return found[-1] if found else ""


def pattern_of(line: str) -> re.Pattern[str]:
    """Return a pattern for a line in which numbers, addresses and ptys may differ."""
    pieces = re.split(r"([-+]?\d[\d.]*|/dev/pts/\d+|tcp/[\w.]+:\d+)", line)
    return re.compile(r"\s+".join(
        "".join(r"[-+\w./:]+" if number % 2 else re.escape(piece) for number, piece in enumerate(pieces)).replace(
            "\\ ", " ").split()
    ))  # fmt: skip


def pages() -> Iterator[str]:
    """Yield the tutorials and the how-to pages."""
    for folder in ("tutorials", "how-to"):
        for path in sorted((ROOT / "docs" / folder).glob("*.md")):
            yield path.relative_to(ROOT).as_posix()
