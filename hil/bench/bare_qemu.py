"""What QEMU's STM32 takes by itself: the part of a command's delay that is neither the network's nor ours.

Its UART has no baud, but hands the firmware byte after byte, and sends each of the answer's by itself.
"""

import select
from statistics import median

from firmware_stub.qemu import QemuStm32
from hil.clock import NS_PER_MS, now_ns
from hil.config import Scenario
from hil.errors import DeviceError
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.slave.stm32 import end_protocol
from sim.vehicle import load_vehicle

TIMES = 100
PATIENCE_S = 5.0
QUIET_S = 0.004  # what was under way has come by then


def answer_ms(scenario: Scenario) -> float:
    """The median time, ms, from a command written on the line of an STM32 in QEMU to its answer read.

    Command and answer are those of the scenario's link, and nothing else runs meanwhile. Raises DeviceError without
    QEMU, or if it does not answer.
    """
    channels = len(load_vehicle(scenario.vehicle)[0].channels)
    stm32 = QemuStm32(channels, watchdog=PATIENCE_S)
    try:
        link = ThrusterLink(stm32.wire, end_protocol(scenario.link, "host", channels))
        return median([_answer_ns(link, channels, number) for number in range(1, TIMES + 1)]) / NS_PER_MS
    finally:
        stm32.close()


def _answer_ns(link: ThrusterLink, channels: int, number: int) -> int:
    while select.select([link.wire], (), (), QUIET_S)[0]:
        link.receive()
    link.tick(now_ns())
    # Pulses differ from one command to the next, as some protocols' reports tell only by them what they answer.
    command = ThrusterCommand(number, True, (PWM_NEUTRAL_US + number,) * channels)
    began = now_ns()
    link.send(command)
    while select.select([link.wire], (), (), PATIENCE_S)[0]:
        for message in link.receive():
            if isinstance(message, ThrusterTelemetry) and message.sequence == number:
                return now_ns() - began
    raise DeviceError(f"{link.wire.name}: no answer to a command in {PATIENCE_S:g} s; is the machine overloaded?")
