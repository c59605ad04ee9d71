"""The contract of an STM32, for each kind of emulated STM32 and each protocol."""

import pytest

from firmware_stub.build import native_compiler
from hil.scenario.records import Link
from tests.support.firmware.stm32_contract import WATCHDOG_S, Stm32Contract

needs_cc = pytest.mark.skipif(not native_compiler(), reason="no C compiler: sudo apt install gcc")

MAVLINK = Link(protocol="mavlink", watchdog=WATCHDOG_S)
VESC = Link(port="can:virtual:contract", protocol="vesc", watchdog=WATCHDOG_S)


class TestPython(Stm32Contract):
    kind = "python"


class TestPythonOverUdp(Stm32Contract):
    kind = "python"
    link = Link(port="udp://127.0.0.1:0", watchdog=WATCHDOG_S)


class TestPythonOverTcp(Stm32Contract):
    kind = "python"
    link = Link(port="tcp://127.0.0.1:0", watchdog=WATCHDOG_S)


class TestPythonMavlink(Stm32Contract):
    kind = "python"
    link = MAVLINK


class TestPythonVesc(Stm32Contract):
    kind = "python"
    link = VESC
    reports_time_out = False


class TestPythonDroneCan(Stm32Contract):
    kind = "python"
    link = Link(port="can:virtual:contract", protocol="dronecan", watchdog=WATCHDOG_S)


class TestProcess(Stm32Contract):
    kind = "process"


class TestUnicorn(Stm32Contract):
    kind = "unicorn"


class TestUnicornMavlink(Stm32Contract):
    kind = "unicorn"
    link = MAVLINK


class TestUnicornVesc(Stm32Contract):
    kind = "unicorn"
    link = VESC
    reports_time_out = False


@needs_cc
class TestNative(Stm32Contract):
    kind = "native"


@needs_cc
class TestNativeMavlink(Stm32Contract):
    kind = "native"
    link = MAVLINK
