"""Times across processes, and real-time settings."""

import os
import subprocess
import sys

from hil.common import clock


def test_the_start_of_a_process_is_exact_to_a_clock_tick() -> None:
    code = "from hil.common.clock import *; print(process_start_ns(), now_ns())"
    environment = {name: value for name, value in os.environ.items() if name != "UUV_HIL_EXEC_NS"}
    before = clock.now_ns()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    start, ready = map(int, done.stdout.split())
    tick_ns = 10**9 // os.sysconf("SC_CLK_TCK")
    assert before - tick_ns <= start <= ready


def test_each_realtime_setting_reports_its_result() -> None:
    names = ("schedule_fifo(10).text", "lock_memory().text", "stay_awake()", "quiet_garbage_collector()")
    code = "from hil.common import clock\n" + "\n".join(f"print(clock.{name})" for name in names)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    scheduling, memory, idle, collector = done.stdout.splitlines()
    assert "SCHED_FIFO" in scheduling
    assert "lock" in memory
    assert idle.startswith("idle processors: ")
    assert collector.startswith("garbage collector: off")
