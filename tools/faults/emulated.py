"""Run the firmware's image on an emulated STM32F405, on a pty: `python -m tools.faults.emulated PTY`."""

import select
import sys

from firmware_stub.unicorn_board import UnicornBoard, UnicornEnd, shipped_image
from hil.common.clock import NS_PER_S, now_ns, seconds_ns
from hil.common.lifeline import die_with_parent
from hil.common.stop import StopSignals
from hil.links.wires.terminal import PtyWire
from tools.faults.links import WATCHDOG_S

CHANNELS = 6


def main(path: str) -> None:
    """Serve until stopped."""
    die_with_parent()
    end = UnicornEnd(UnicornBoard(shipped_image(), CHANNELS, seconds_ns(WATCHDOG_S)), PtyWire(path))
    wire, serviced_ns = end.wire, now_ns()
    with StopSignals() as stop_fd:
        print(f"emulated STM32 on {path}; Ctrl-C ends it", flush=True)
        while True:
            now = now_ns()
            if now - serviced_ns > seconds_ns(WATCHDOG_S):  # it was suspended: a UART would have lost the bytes
                wire.read()
            end.service(now)
            serviced_ns = now
            wait_s = max(0, end.deadline_ns - now_ns()) / NS_PER_S
            if stop_fd in select.select((end.fileno(), stop_fd), (), (), wait_s)[0]:
                break
    end.close()


if __name__ == "__main__":
    main(sys.argv[1])
