"""Warnings of a delay run about its clocks, its line, and conditions that differ from the requested ones."""

from typing import Literal

import pytest

from hil.bench import delay_run
from hil.bench.delay_run import HOPS, Plan, Result, wire_ms
from hil.client.delay import find_doubts
from hil.links.wires.faults import Faults
from hil.ros.diagnostics import Diagnostics
from hil.scenario.config import load_scenario
from tests.support.delay_results import MS, meter, on, some_result
from tests.support.diagnostics import reported


def test_correct_clocks_give_no_warning() -> None:
    assert find_doubts(meter(0, same_clock=True)) == []
    assert find_doubts(meter(7_000 * MS, same_clock=False, network=MS // 10, return_delay=MS // 10)) == []


@pytest.mark.parametrize("offset", [-3_600_000 * MS, -5 * MS, 5 * MS, 3_600_000 * MS])
def test_the_offset_is_measured_when_the_clock_was_set_between_two_starts(offset: int) -> None:
    """Both processes run since the same boot, but each read the wall clock at its start."""
    shifted = meter(offset, same_clock=True, network=MS // 10, return_delay=MS // 10)
    assert all(abs(total - 260_000) < MS // 5 for total in shifted.totals_ns())
    assert abs(shifted.offset_ns()[0] - offset) < MS // 5
    assert find_doubts(shifted) == []


def test_an_offset_within_its_error_is_taken_as_zero() -> None:
    lopsided = meter(0, same_clock=True, network=2 * MS, return_delay=MS // 10)
    assert lopsided.offset_ns() == (0, 0)
    assert set(lopsided.totals_ns()) == {2_160_000}


def test_the_time_on_the_line_follows_from_bits_and_baud() -> None:
    """The line has 115200 bit/s and ten bits a byte; the answer counts where the delay ends with its reception."""
    scenario = load_scenario("paper_field")
    paced = scenario._replace(link=scenario.link._replace(faults=Faults(baud=115_200)))
    assert wire_ms(scenario, on("/dev/pts/0")) == 0.0
    command = wire_ms(paced, reported())
    assert command == pytest.approx(22 * 10 / 115.2)
    assert wire_ms(scenario, on("/dev/ttyUSB0")) == command
    assert wire_ms(paced._replace(stm32="native"), reported()) > 2 * command
    assert wire_ms(paced._replace(stm32="unicorn"), reported()) == command


def test_the_line_time_of_mavlink_counts_only_the_packet_of_pulses() -> None:
    """The host also requests arming until the device reports it: SERVO_OUTPUT_RAW has 28 bytes here."""
    scenario = load_scenario("paper_field")
    link = scenario.link._replace(protocol="mavlink", faults=Faults(baud=115_200))
    assert wire_ms(scenario._replace(link=link), reported()) == pytest.approx(28 * 10 / 115.2)
    assert wire_ms(scenario._replace(link=link, stm32="native"), reported()) == pytest.approx(2 * 28 * 10 / 115.2)


@pytest.mark.parametrize(("protocol", "bits"), [("vesc", 6 * (67 + 32)), ("dronecan", 2 * 67 + 64 + 56)])
def test_the_line_time_on_a_can_bus_counts_all_frames_of_a_command(
    protocol: Literal["vesc", "dronecan"], bits: int
) -> None:
    """VESC sends a frame of 4 bytes a thruster; DroneCAN 6 x 14 bits and the checksum, with two tails in two frames."""
    scenario = load_scenario("paper_field")
    link = scenario.link._replace(protocol=protocol, port="can:virtual:bits", faults=Faults(baud=500_000))
    paced = scenario._replace(link=link)
    assert wire_ms(paced, reported()) == pytest.approx(bits / 500)
    assert wire_ms(paced._replace(stm32="process"), reported()) > 2 * wire_ms(paced, reported())


def test_a_slave_on_another_machine_reports_its_line() -> None:
    """The local scenario may have another protocol, another baud rate, or an STM32 inside the slave."""
    here = load_scenario("paper_field")

    def there(port: str) -> Diagnostics:
        output = on(port)
        output.link_protocol, output.link_baud, output.pwm_us = "mavlink", 57_600, (1500,) * 6
        return output

    assert wire_ms(here, there("/dev/ttyAMA0"), elsewhere=True) == pytest.approx(2 * 28 * 10 / 57.6)
    assert wire_ms(here, there("rs485:/dev/serial0"), elsewhere=True) > 0.0
    paced = here._replace(link=here.link._replace(faults=Faults(baud=9600)))
    assert wire_ms(paced, there("/dev/ttyAMA0"), elsewhere=True) == pytest.approx(2 * 28 * 10 / 57.6)
    for port in ("/dev/pts/3", "tcp://127.0.0.1:5760", "can:socketcan:can0"):
        assert wire_ms(paced, there(port), elsewhere=True) == 0.0
    assert wire_ms(paced, reported(), elsewhere=True) == 0.0


def doubts(result: Result, plan: Plan = Plan(), losses: int = 0, paced: bool = False) -> list[str]:
    return list(delay_run._doubts(result, plan, None, losses, paced))


def test_conditions_that_differ_from_the_request_give_warnings() -> None:
    assert doubts(some_result([0.7] * 20, rate=20.9)) == []
    assert "5 of 25 commands were not answered" in doubts(some_result([0.7] * 20, sent=25))[0]
    assert "at 150.0 Hz instead of 200" in doubts(some_result([0.7] * 20, rate=150.0), Plan(rate=200.0))[0]
    assert "lost 2 times" in doubts(some_result([0.7] * 20), losses=2)[0]
    assert doubts(some_result([0.7], rate=float("nan"))) == []
    assert doubts(some_result([0.7] * 20, {"motion": []}), Plan(steps=1)) == [], "the first step does not count"
    assert "3 of 9 steps in surge did not show" in doubts(some_result([0.7] * 20, {"motion": [4.0] * 6}))[0]


def test_a_line_faster_than_its_bits_gives_a_warning_unless_it_is_paced() -> None:
    on_line = some_result([0.7] * 20, {f"hop {name}": [0.7 if name == "STM32" else 0.0] * 20 for name in HOPS})
    assert "baud is not what" in doubts(on_line._replace(wire=1.9))[0]
    assert doubts(on_line._replace(wire=1.9), paced=True) == []
    assert doubts(on_line._replace(wire=0.7001)) == [], "no baud is wrong by so little"


def test_the_wire_time_includes_bits_sent_during_the_write() -> None:
    """The write ends 50 us after the encoder began, and the pulses are there after 10 more."""
    arrived = meter(0, same_clock=True)
    spans = [(sample.published_ns, sample.published_ns + 1000) for sample in arrived.samples()]
    result = delay_run._result(arrived, spans, [], None, 0.0)
    assert (result.values["hop link encode"][0], result.values["hop STM32"][0]) == pytest.approx((0.05, 0.01))
    for wire, expected in ((0.005, (0.05, 0.005, 0.005)), (0.04, (0.02, 0.04, 0.0)), (0.2, (0.0, 0.06, 0.0))):
        found = delay_run._result(arrived, spans, [], None, wire)
        assert [found.values[f"hop {hop}"][0] for hop in ("link encode", "wire", "STM32")] == pytest.approx(expected)
        assert found.values["delay"] == result.values["delay"]
