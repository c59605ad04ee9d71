"""Pulses of thrusters behind motor controllers, and the rounds of their reports."""

import pytest

from hil.links.can_thrusters import Answers, Rounds, deflection, executable_pulses, has_output, propeller_load, pulse_at
from hil.links.contract import ThrusterCommand


@pytest.mark.parametrize(
    ("pulse", "off", "executed", "amperes", "kelvin"),
    [
        (0, 0, 1500, 0.0, 288.0), (799, 0, 1500, 0.0, 288.0), (800, -700, 1100, 24.0, 318.0),
        (1100, -400, 1100, 24.0, 318.0), (1101, -399, 1101, 23.82, 317.78), (1300, -200, 1300, 3.0, 291.75),
        (1500, 0, 1500, 0.0, 288.0), (1900, 400, 1900, 24.0, 318.0), (2200, 700, 1900, 24.0, 318.0),
        (2201, 0, 1500, 0.0, 288.0),
    ],
)  # fmt: skip
def test_a_pulse_is_an_output_and_a_load(pulse: int, off: int, executed: int, amperes: float, kelvin: float) -> None:
    assert has_output(pulse) == (800 <= pulse <= 2200)
    assert deflection(pulse) == off
    assert executable_pulses(ThrusterCommand(1, True, (pulse, 1600))) == (executed, 1600)
    assert executable_pulses(ThrusterCommand(1, False, (pulse, 1600))) == (1500, 1500)
    assert propeller_load(3, pulse) == pytest.approx((16.0, amperes, kelvin), abs=0.01)


def test_a_reported_output_is_a_valid_pulse() -> None:
    assert [pulse_at(us) for us in (-701, -700.6, -699.6, 0.4, 0.6, 700.4, 999)] == [
        800,
        800,
        800,
        1500,
        1501,
        2200,
        2200,
    ]


@pytest.mark.parametrize(
    ("order", "complete"),
    [
        ((0, 1, 2) * 3, [2, 5, 8]),
        ((0, 1, 0, 1, 2), [4]),  # a turn with a gap
        ((0, 2, 1, 2, 0, 1, 2), [6]),
        ((2, 1, 0) * 6, [9, 12, 15]),  # after three rounds' worth without a turn, each of which all have reported in
        ((0, 0, 0, 0) * 5, []),
        ((2, 1, 0, 1, 2, *(2, 1, 0) * 5), [4, 14, 17]),
    ],
)
def test_a_round_has_a_report_of_each_controller(order: tuple[int, ...], complete: list[int]) -> None:
    rounds, found = Rounds(3), {}
    pulses = [1500] * 3
    for place, thruster in enumerate(order):
        pulses[thruster] = 1600 + place
        if (result := rounds.add_report(thruster, 1600 + place)) is not None:
            found[place] = result
            assert result == tuple(pulses)
    assert list(found) == complete


def test_answers_count_commands_once_and_wrap() -> None:
    answers = Answers(1)
    assert answers.find_command((1500,)) == ThrusterCommand(0, False, (1500,))
    assert answers.frames == 0, "nothing was sent"
    answers.frames = 0xFFFE
    for sequence, pulse in ((7, 1600), (8, 2000), (9, 0)):
        answers.record_command(ThrusterCommand(sequence, True, (pulse,)))
    found = [(answers.find_command((pulse,)).sequence, answers.frames) for pulse in (1600, 1600, 1234, 1900, 1500)]
    assert found == [(7, 0xFFFF), (7, 0xFFFF), (7, 0xFFFF), (8, 0), (9, 1)]
    for sequence in range(200):
        answers.record_command(ThrusterCommand(sequence, True, (1100 + sequence,)))
    assert len(answers._commands) == 64
    assert answers.find_command((1235,)).sequence == 9, "the 65th last"
    assert answers.find_command((1236,)).sequence == 136
