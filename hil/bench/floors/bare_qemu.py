"""Measure the delay of QEMU's STM32 alone, without the network and the slave.

    python -m hil.bench.floors.bare_qemu SCENARIO

QEMU's UART has no baud: it passes single bytes to the firmware and from it. This process has the slave's scheduling,
which QEMU inherits as in a slave: without it the time is 1.5 times as long.
"""

import select
import sys

from firmware_stub.qemu import QemuStm32
from hil.common.clock import LOOP_PRIORITY, NS_PER_MS, NS_PER_US, now_ns, schedule_fifo, stay_awake
from hil.common.errors import DeviceError, HilError
from hil.common.lifeline import die_with_parent
from hil.links.contract import PWM_NEUTRAL_US, ThrusterCommand, ThrusterLink, ThrusterTelemetry
from hil.scenario.config import Scenario, load_scenario
from hil.slave.drivers.ends import end_protocol
from sim.vehicle.vehicle import load_vehicle

TIMES = 100
PATIENCE_S = 5.0
QUIET_S = 0.004  # after this time all bytes have arrived


def answer_ms(scenario: Scenario) -> float:
    """Return the shortest time, ms, from writing a command to an STM32 in QEMU until its answer is read.

    Not the mean, because it is not measured in the same seconds as the slave's delay. Command and answer are those of
    the scenario's link, the times are taken as in a slave's trace, and nothing else runs meanwhile. Raises DeviceError
    without QEMU, or if it does not answer.
    """
    channels = len(load_vehicle(scenario.vehicle)[0].channels)
    stm32 = QemuStm32(channels, watchdog=PATIENCE_S)
    try:
        link = ThrusterLink(stm32.wire, end_protocol(scenario.link, "host", channels))
        return min(_answer_ns(link, channels, number) for number in range(1, TIMES + 1)) / NS_PER_MS
    finally:
        stm32.close()


def _answer_ns(link: ThrusterLink, channels: int, number: int) -> int:
    while select.select([link.wire], (), (), QUIET_S)[0]:
        link.receive()
    link.tick(now_ns())
    # Pulses differ from command to command: in some protocols only they show which command a report answers.
    command = ThrusterCommand(number, True, (PWM_NEUTRAL_US + number,) * channels)
    link.send(command)
    written = now_ns()
    while select.select([link.wire], (), (), PATIENCE_S)[0]:
        for message in link.receive():
            if isinstance(message, ThrusterTelemetry) and message.sequence == number:
                return now_ns() - written - message.age_us * NS_PER_US
    raise DeviceError(f"{link.wire.name}: no answer to a command in {PATIENCE_S:g} s; is the machine overloaded?")


def main(path: str) -> None:
    """Print the delay of bare QEMU with the link of the scenario at `path`; exit with a message on an error."""
    die_with_parent()
    try:
        scenario = load_scenario(path)
        if scenario.slave.realtime:
            schedule_fifo(LOOP_PRIORITY)
        if scenario.slave.realtime and scenario.slave.stay_awake:
            stay_awake()
        print(f"answer_ms {answer_ms(scenario):.6f}", flush=True)
    except HilError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main(sys.argv[1])
