"""The firmware's C in the slave equals its Python twin byte for byte; and which of the two is used."""

import sys
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_stub.stub import Stm32, Stm32End
from hil.common.clock import NS_PER_MS, now_ns
from hil.links.contract import ThrusterCommand, ThrusterLink
from hil.links.frame.protocol import open_frame
from hil.scenario.config import load_scenario
from hil.slave.drivers.in_process import open_python
from hil.slave.native.firmware import FirmwareEnd
from tests.support.flights.twins import EACH
from tests.support.links.can_bench import MemoryBus, MemoryWire
from tests.support.links.link_contract import nothing_leaks

pytestmark = pytest.mark.usefixtures("native")

CHANNELS = 3
WATCHDOG_NS = 200 * NS_PER_MS


class MemoryLine(MemoryWire):
    """A wire in memory: bytes put into `unread` are read; written bytes are listed write by write."""

    def __init__(self) -> None:
        super().__init__(MemoryBus())
        self.output, self.closed = list[bytes](), False

    def write(self, data: bytes) -> int:
        self.output.append(data)
        return len(data)

    def close(self) -> None:
        self.closed = True


def firmware_and_stub() -> tuple[MemoryLine, FirmwareEnd, MemoryLine, Stm32End]:
    quick, plain = MemoryLine(), MemoryLine()
    stub = Stm32End(Stm32(CHANNELS, WATCHDOG_NS), ThrusterLink(plain, open_frame("device", CHANNELS)))
    return quick, FirmwareEnd(quick, CHANNELS, WATCHDOG_NS), plain, stub


FRAME = open_frame("host", CHANNELS)
COMMANDS = st.builds(
    ThrusterCommand,
    st.integers(0, 80),
    st.booleans(),
    st.lists(st.integers(0, 3000), min_size=2, max_size=4).map(tuple),
).map(FRAME.encode)
RECEIVED = st.one_of(
    st.just(b""), COMMANDS, COMMANDS, st.lists(COMMANDS, max_size=5).map(b"".join), st.binary(max_size=40)
)


@EACH
@given(st.lists(st.tuples(st.integers(0, 120_000), RECEIVED), min_size=1, max_size=30))
def test_the_c_equals_python_for_any_hour_of_commands(hour: list[tuple[int, bytes]]) -> None:
    """The commands are valid, late and too long, with noise and pauses, at whole microseconds."""
    quick, end, stub_line, stub = firmware_and_stub()
    now = 0
    for pause_us, data in hour:
        now += pause_us * 1000
        quick.unread = stub_line.unread = data
        end.service(now)
        stub.service(now)
        assert quick.output == stub_line.output
        assert list(end.pwm_us) == stub.pwm_us
        assert end.deadline_ns == stub.deadline_ns
        assert (end.command_ns > 0) == (stub.command_ns > 0)


def test_the_command_time_is_that_of_the_last_executed_command() -> None:
    quick, end, _, _ = firmware_and_stub()
    before = now_ns()
    quick.unread = FRAME.encode(ThrusterCommand(9, True, (1600,) * CHANNELS))
    end.service(NS_PER_MS)
    executed = end.command_ns
    assert before < executed < now_ns()
    quick.unread = FRAME.encode(ThrusterCommand(8, True, (1700,) * CHANNELS))  # late
    end.service(2 * NS_PER_MS)
    end.service(3 * WATCHDOG_NS)  # the watchdog is no command
    assert end.pwm_us == (1500,) * CHANNELS
    assert end.command_ns == executed


def test_closing_sets_the_outputs_to_neutral() -> None:
    quick, end, _, _ = firmware_and_stub()
    quick.unread = FRAME.encode(ThrusterCommand(9, True, (1600,) * CHANNELS))
    end.service(NS_PER_MS)
    assert end.pwm_us == (1600,) * CHANNELS
    end.close()
    assert end.pwm_us == (1500,) * CHANNELS
    assert quick.closed


def test_the_c_is_used_with_its_own_frame_only(monkeypatch: pytest.MonkeyPatch) -> None:
    link = load_scenario("paper_field").link

    def kind(**changes: Any) -> type:
        with nothing_leaks():
            ends = open_python(link._replace(**changes), 6, 1, True)
            found = type(ends.device)
            ends.close()
        return found

    assert kind() is FirmwareEnd
    assert kind(frame="aa55") is Stm32End
    assert kind(protocol="mavlink") is Stm32End
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "hil.slave.native._firmware", None)  # as if made before there was one
        assert kind() is Stm32End
    monkeypatch.setenv("UUV_HIL_NATIVE", "0")
    assert kind() is Stm32End


def test_invalid_arguments_are_refused() -> None:
    module = sys.modules["hil.slave.native._firmware"]
    for channels in (0, 17):
        with pytest.raises(ValueError, match=f"1 to 16 channels are needed, found {channels}"):
            module.Firmware(channels, 200_000)
    firmware = module.Firmware(6, 200_000)
    with pytest.raises(TypeError):
        firmware.service("text", 0)
    with pytest.raises(TypeError):
        firmware.service(b"", "now")
    with pytest.raises(TypeError):
        firmware.service(b"")
