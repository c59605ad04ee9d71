"""Compare the figures of `uuv-hil bench table` with independent measurements at the same time, as root.

    python tools/costs/bench_outside.py [--seconds 10]

These are: the kernel's process connector (start of the slave's process), a packet socket on the loopback (times of the
master's first sample, of a command, of a thruster frame and of its answer), a socket in place of systemd's (time at
which the slave reports that it is ready), the scheduler's account of each thread, `ps`, /proc/PID/smaps_rollup and
/usr/bin/time. There are two runs: a mission with a master process, as in `bench table`, then commands of this process
to a slave whose STM32 is on UDP, so that its frames pass the loopback too. Exit code 1 if a figure differs by more
than 5 %.
"""

import argparse
import json
import os
import re
import signal
import socket
import statistics
import struct
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from hil.autonomy.control.controller import VelocityCommand  # noqa: E402 - works from a bare checkout too
from hil.bench.harness import Bench, await_vehicle, program  # noqa: E402
from hil.bench.table.run import fly  # noqa: E402
from hil.common.children import foreign_command, start_child  # noqa: E402
from hil.common.columns import aligned  # noqa: E402
from hil.ros.diagnostics import or_nan  # noqa: E402

AGREES = 0.05
# Odometry or ground truth: what comes before it on the connection (transforms, last samples) is not measured.
SAMPLE = re.compile(rb"(?:odom|map)\0+\n\0{3}base_link\0")
NOTIFY = f"uuv-hil-outside-{os.getpid()}"
MARKER = b"a command goes out now"
TICK_S = 0.02
SHORT = 80  # bytes; pings are shorter, commands with their attachments longer
PACKET_OUTGOING, ETH_P_IP, SO_TIMESTAMPNS = 4, 0x0800, 35
NETLINK_CONNECTOR, CN_IDX_PROC, PROC_EVENT_FORK = 11, 1, 1


class Packet(NamedTuple):
    """A packet on the loopback: its time (ns since 1970), protocol, ports and content."""

    time_ns: int
    protocol: int
    source: int
    target: int
    size: int
    sample: bool
    marker: bool


class Memory(NamedTuple):
    """Memory of a process in MiB: PSS by the kernel and by `ps`, RSS by `ps`; and the time (ns since 1970)."""

    time_ns: int
    pss: float
    pss_by_ps: float
    rss: float


class Row(NamedTuple):
    """One figure: this project's value, and the independent one."""

    name: str
    project_value: float
    independent_value: float
    unit: str
    witness: str

    @property
    def off(self) -> float:
        """The relative difference."""
        return self.project_value / self.independent_value - 1.0


def capture() -> None:
    """Capture packets of the loopback; print them when standard input ends."""
    packets: list[Packet] = []
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_IP)) as wire:
        wire.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 24)
        wire.bind(("lo", ETH_P_IP))
        print("listening", flush=True)
        ended = threading.Event()
        threading.Thread(target=_await_end, args=(ended,), daemon=True).start()
        wire.settimeout(0.1)
        while not ended.is_set():
            try:
                data, ancillary, _, address = wire.recvmsg(1 << 16, 64)
            except TimeoutError:
                continue
            packet = _packet(data, ancillary) if address[2] != PACKET_OUTGOING else None
            if packet:
                packets.append(packet)
    print(json.dumps(packets), flush=True)


def _await_end(ended: threading.Event) -> None:
    sys.stdin.read()
    ended.set()


def _packet(data: bytes, ancillary: list[Any]) -> Packet | None:
    header = 14 + 4 * (data[14] & 15)
    protocol, end = data[23], 14 + int.from_bytes(data[16:18], "big")
    begin = header + (4 * (data[header + 12] >> 4) if protocol == socket.IPPROTO_TCP else 8)
    payload = data[begin:end]
    if protocol not in (socket.IPPROTO_TCP, socket.IPPROTO_UDP) or not payload:
        return None
    seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
    source, target = struct.unpack("!HH", data[header : header + 4])
    sample = bool(SAMPLE.search(payload))
    return Packet(
        seconds * 10**9 + nanoseconds, protocol, source, target, len(payload), sample, payload.startswith(MARKER)
    )


class Witness:
    """Listens on the loopback, to the process connector, in systemd's place, and to the scheduler, while entered."""

    def __enter__(self) -> "Witness":
        command = foreign_command(sys.executable, __file__, "--capture")
        self._capture = start_child(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._capture.stdout
        self._capture.stdout.readline()
        self.packets: list[Packet] = []
        self.made: dict[int, int] = {}  # pid -> ns since 1970
        self.cpu: dict[int, list[tuple[int, int]]] = {}  # pid -> (ns since 1970, ns of processor time)
        self.memory: dict[int, list[Memory]] = {}
        self.ready: list[int] = []  # ns since 1970
        self._watched: list[int] = []
        self._done = threading.Event()
        self._systemd = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._systemd.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._systemd.bind(f"\0{NOTIFY}")
        os.environ["NOTIFY_SOCKET"] = f"@{NOTIFY}"  # for the processes that are started from now on
        works = self._receive_forks, self._await_ready, self._watch
        self._threads = [threading.Thread(target=work) for work in works]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        del os.environ["NOTIFY_SOCKET"]
        for thread in self._threads:
            thread.join()
        output, _error = self._capture.communicate("")
        self.packets = [Packet(*row) for row in json.loads(output)]

    def watch(self, pids: list[int]) -> None:
        """Measure these processes from now on."""
        self._watched = pids

    def share(self, pid: int, begin: int, end: int) -> float:
        """Return the share of a core, by the scheduler, between the readings around two wall instants."""
        rows = self.cpu[pid]
        first, before = max((row for row in rows if row[0] <= begin), default=rows[0])
        last, after = min((row for row in rows if row[0] >= end), default=rows[-1])
        return (after - before) / (last - first)

    def _watch(self) -> None:
        number = 0
        while not self._done.wait(TICK_S):
            number += 1
            for pid in list(self._watched):
                try:
                    self.cpu.setdefault(pid, []).append((time.time_ns(), _scheduled(pid)))
                    if number % 10 == 0:
                        self.memory.setdefault(pid, []).append(_memory(pid))
                except (OSError, ValueError, subprocess.CalledProcessError):
                    continue  # it has ended

    def _await_ready(self) -> None:
        with self._systemd as wire:
            wire.settimeout(0.1)
            while not self._done.is_set():
                try:
                    output, ancillary, _, _ = wire.recvmsg(100, 64)
                except TimeoutError:
                    continue
                if output == b"READY=1":
                    seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
                    self.ready.append(seconds * 10**9 + nanoseconds)

    def _receive_forks(self) -> None:
        with socket.socket(socket.AF_NETLINK, socket.SOCK_DGRAM, NETLINK_CONNECTOR) as connector:
            connector.bind((0, CN_IDX_PROC))
            message = struct.pack("=IIIIHHI", CN_IDX_PROC, 1, 0, 0, 4, 0, 1)  # PROC_CN_MCAST_LISTEN
            connector.send(struct.pack("=IHHII", 16 + len(message), 3, 0, 0, os.getpid()) + message)
            connector.settimeout(0.1)
            shift = time.time_ns() - time.monotonic_ns()
            while not self._done.is_set():
                try:
                    data = connector.recv(4096)
                except TimeoutError:
                    continue
                what, _, instant, _, _, task, pid = struct.unpack_from("=IIQIIII", data, 36)
                if what == PROC_EVENT_FORK and task == pid:  # else it is a thread
                    self.made[pid] = instant + shift


def _scheduled(pid: int) -> int:
    tasks = f"/proc/{pid}/task"
    return sum(
        int(Path(f"{tasks}/{task}/schedstat").read_text(encoding="utf-8").split()[0]) for task in os.listdir(tasks)
    )


def _memory(pid: int) -> Memory:
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8")
    kernel = next(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:"))
    output = subprocess.run(["ps", "-o", "pss=,rss=", "-p", str(pid)], capture_output=True, text=True, check=True)
    pss, rss = map(int, output.stdout.split())
    return Memory(time.time_ns(), kernel / 1024, pss / 1024, rss / 1024)


def mission(seconds: float) -> list[Row]:
    """Return a run of `bench table`, witnessed."""
    with Bench("paper_field", {"master.time_limit": seconds}) as bench:
        with Witness() as witness:
            follower = threading.Thread(target=_follow, args=(bench, witness), daemon=True)
            follower.start()
            run = fly(bench, 0)
        master, slave = _of_the_flight(bench)
        port = int(bench.endpoint.rpartition(":")[2])
    first = next(packet for packet in witness.packets if packet.sample and packet.source in (port, port + 1))
    sent = commands_to(witness.packets, port)
    begin, end = sent[0].time_ns + 10**9, sent[-1].time_ns
    own = run.values
    memory = [row for row in witness.memory[slave] if row.time_ns <= end][-1]  # then the master no longer shares
    start, ready = ((instant - witness.made[slave]) / 1e9 for instant in (first.time_ns, witness.ready[0]))
    return [
        Row("start-up", own["startup"], start, "s", "process connector, packet capture"),
        Row("ready", own["ready"], ready, "s", "process connector, sd_notify"),
        Row("slave memory", own["memory"], memory.pss, "MiB", "smaps_rollup"),
        Row("slave memory", own["memory"], memory.pss_by_ps, "MiB", "ps -o pss"),
        Row("slave memory, alone", own["memory_alone"], memory.rss, "MiB", "ps -o rss"),
        Row("slave CPU", own["slave_cpu"], 100 * witness.share(slave, begin, end), "%", "scheduler (schedstat)"),
        Row("master CPU", own["master_cpu"], 100 * witness.share(master, begin, end), "%", "scheduler (schedstat)"),
    ]


def commands_to(packets: list[Packet], port: int) -> list[Packet]:
    """Return the commands among the packets to a slave's two ports: the most frequent ones that are not `SHORT`."""
    long = [packet for packet in packets if packet.target in (port, port + 1) and packet.size > SHORT]
    usual = Counter(packet.size for packet in long).most_common(1)[0][0]
    return [packet for packet in long if packet.size == usual]


def _follow(bench: Bench, witness: Witness) -> None:
    while len(bench.processes) < 2:
        time.sleep(0.001)
    witness.watch(_of_the_flight(bench))


def _of_the_flight(bench: Bench) -> list[int]:
    """Return the process ids of master and slave; those of the floor are started later."""
    return [process.pid for process in bench.processes[:2]]


def commands(seconds: float) -> list[Row]:
    """Command a slave whose STM32 is on UDP, with a marker packet before each command; return the figures."""
    with socket.socket(type=socket.SOCK_DGRAM) as probe, socket.socket(type=socket.SOCK_DGRAM) as marker:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
        probe.close()
        marker.bind(("127.0.0.1", 0))  # to its own port, never read: a closed port would answer by ICMP
        marker.connect(marker.getsockname())
        marker.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)  # it is soon full, and drops
        changes = {"stm32": "device", "link.port": f"udp://127.0.0.1:{port}"}
        with Bench("paper_field", changes) as bench:
            stm32 = bench.start("stm32", [*program(), "stm32", "--port", f"udp://127.0.0.1:{port}", "--channels", "6"])
            stm32.expect(str(port), 10.0)
            used = bench.file("used")
            timed = ["/usr/bin/time", "-f", "%U %S", "-o", used, *program(), "slave", bench.path]
            slave = bench.start("slave", timed)
            with Witness() as witness, bench.client() as client:
                await_vehicle(client, slave)
                end = time.monotonic() + seconds
                while time.monotonic() < end:
                    marker.send(MARKER)
                    client.command(VelocityCommand(0.1, 0.0, 0.0))
                    time.sleep(0.05)
                time.sleep(0.5)
                os.kill(slave.family()[1], signal.SIGTERM)
                slave.wait(10.0)
                time.sleep(0.3)
                own = statistics.median(client.delays.totals_ns()) / 1e6
                cpu_s = or_nan(client.diagnostics().cpu_s)
            by_time = sum(map(float, Path(used).read_text(encoding="utf-8").split()))
    sent = set(commands_to(witness.packets, int(bench.endpoint.rpartition(":")[2])))
    theirs = statistics.median(_delays(witness.packets, sent, port)) / 1e6
    return [
        Row("command delay p50", own, theirs, "ms", "packet capture: before the publish, STM32's answer"),
        Row("slave CPU, in all", cpu_s, by_time, "s", "/usr/bin/time"),
    ]


def _delays(packets: list[Packet], sent: set[Packet], port: int) -> list[int]:
    """Return the times from the last mark before a command until the STM32's answer to the frame that it caused."""
    delays, marked, commanded, framed = [], 0, False, False
    for packet in packets:
        if packet.marker:
            marked, commanded, framed = packet.time_ns, False, False
        elif marked and packet in sent:
            commanded = True
        elif commanded and packet.target == port:
            framed = True
        elif framed and packet.source == port:
            delays.append(packet.time_ns - marked)
            marked, commanded, framed = 0, False, False
    return delays


def main() -> int:
    """Measure and print; return 1 if a figure differs too much."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each run [%(default)s]")
    parser.add_argument("--capture", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.capture:
        capture()
        return 0
    if os.geteuid():
        sys.exit("needs root: nobody else sees packets and executions")
    rows = [*mission(options.seconds), *commands(options.seconds)]
    table = [["figure", "ours", "outside", "unit", "off", "measured by"]]
    table += [
        [r.name, f"{r.project_value:.4g}", f"{r.independent_value:.4g}", r.unit, f"{r.off:+.1%}", r.witness]
        for r in rows
    ]
    print("\n".join(aligned(table, rule=True)))
    off = [row.name for row in rows if not abs(row.off) <= AGREES]
    print(f"off by more than {AGREES:.0%}: {', '.join(off)}" if off else f"all agree within {AGREES:.0%}")
    return int(bool(off))


if __name__ == "__main__":
    sys.exit(main())
