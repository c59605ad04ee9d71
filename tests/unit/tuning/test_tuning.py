"""Tuning: figures of responses known in closed form, identified processes, and gains that fly better."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.autonomy.control.controller import AxisGains, Gains, HoldGains, VelocityCommand
from hil.common.errors import ConfigError
from hil.common.schema import parse
from hil.common.tables import read_table
from hil.tuning.identify import Process, fit_lag
from hil.tuning.rig import CONTROL_PERIOD_S, START_DEPTH, Rig
from hil.tuning.search import Tuner
from hil.tuning.step_response import AXES, Response, fly_step, step_command, step_size
from hil.tuning.tuned_file import control_text, with_gains
from sim.vehicle.terminal_speed import AxisCapability
from sim.vehicle.vehicle import load_vehicle
from tests.support.examples import examples

PERIOD = CONTROL_PERIOD_S


def make_response(share: Any, seconds: float = 20.0, size: float = 2.0) -> Response:
    times = [number * PERIOD for number in range(round(seconds / PERIOD))]
    return Response("surge", size, times, [size * share(time) for time in times])


# -- figures ------------------------------------------------------------------------------------------------------


def test_a_first_order_lag_has_its_known_figures() -> None:
    """A lag 1 - exp(-t/T) has a rise of T ln 9, settles to 5 % at T ln 20, and costs T."""
    figures = make_response(lambda t: 1.0 - math.exp(-t / 1.5)).figures()
    assert figures.rise == pytest.approx(1.5 * math.log(9.0), abs=0.03)
    assert figures.settling == pytest.approx(1.5 * math.log(20.0), abs=0.03)
    assert figures.cost == pytest.approx(1.5, rel=0.01)
    assert figures.overshoot == 0.0
    assert figures.steady == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.8])
def test_a_second_order_system_has_its_known_overshoot(damping: float) -> None:
    """The overshoot is exp(-pi z / sqrt(1 - z²)), as in any textbook."""
    root = math.sqrt(1.0 - damping * damping)

    def curve(t: float) -> float:
        swing = math.cos(2.0 * root * t) + damping / root * math.sin(2.0 * root * t)
        return 1.0 - math.exp(-2.0 * damping * t) * swing

    assert make_response(curve).figures().overshoot == pytest.approx(math.exp(-math.pi * damping / root), abs=2e-3)


def test_a_response_that_never_settles_has_no_settling_time() -> None:
    figures = make_response(lambda t: 0.8).figures()
    assert math.isnan(figures.settling)
    assert math.isnan(figures.rise)
    assert figures.steady == pytest.approx(-0.4)
    assert make_response(lambda t: 1.0 + 0.04 * math.sin(t), size=-1.0).figures().settling == 0.0


# -- identification -----------------------------------------------------------------------------------------------


@examples(25)
@given(st.floats(0.3, 1.5), st.floats(0.1, 4.0), st.integers(0, 60), st.sampled_from([-0.7, 0.4]))
def test_a_lag_with_a_delay_is_identified(slope: float, damping: float, steps: int, push: float) -> None:
    delay = 0.005 * steps
    values = [
        slope * push / damping * (1.0 - math.exp(-damping * max(0.0, number * PERIOD - delay))) for number in range(150)
    ]
    found = fit_lag(values, push, PERIOD, "")
    assert found == pytest.approx(Process(slope, damping, delay), rel=0.05, abs=0.02)


def test_an_integrator_is_identified_without_damping() -> None:
    values = [0.5 * max(0.0, number * PERIOD - 0.1) for number in range(100)]
    assert fit_lag(values, 0.5, PERIOD, "") == pytest.approx(Process(1.0, 0.0, 0.1), abs=1e-6)


@pytest.mark.parametrize("sign", [0.0, -1.0])
def test_a_response_against_the_force_is_refused(sign: float) -> None:
    with pytest.raises(ConfigError, match=r"mine\.toml: surge: does not move in the direction of the force"):
        fit_lag([sign * 0.01 * number for number in range(100)], 0.5, PERIOD, "mine.toml: surge")


# -- flights ------------------------------------------------------------------------------------------------------


def test_a_rig_is_deterministic_and_adds_its_nudge_exactly() -> None:
    vehicle, control = load_vehicle("paper_six")
    first, second = (Rig("paper_six", vehicle, control) for _ in range(2))
    command = VelocityCommand(surge=0.3, depth=START_DEPTH)
    assert first.fly(2.0, lambda time: command) == second.fly(2.0, lambda time: command)
    before = first.recorder.last
    first.recorder.add_step(0, 5.0)
    after = first.fly(0.1, lambda time: command)
    assert all(moment.wrench[0] == before[0] + 5.0 for moment in after)
    assert any(moment.wrench[5] != before[5] for moment in after)


def test_the_step_size_follows_the_vehicles_limits() -> None:
    strong, weak = (
        AxisCapability("surge", (50.0, -40.0), (3.0, -2.5)),
        AxisCapability("surge", (1.0, -1.0), (0.2, -0.1)),
    )
    assert step_size("surge", strong) == 0.5
    assert step_size("surge", weak) == pytest.approx(0.04)
    assert step_size("depth", weak) == 1.0
    assert step_command("heave", 0.2) == VelocityCommand(heave=0.2, heading=0.0)
    assert step_command("roll", 0.2) == step_command("pitch", 0.2) == VelocityCommand(depth=START_DEPTH, heading=0.0)


SLUGGISH: dict[str, Any] = {"surge": {"p": 0.5, "i": 0.1}, "heading": {"p": 0.2, "limit": 0.6}}
WILD: dict[str, Any] = {"surge": {"p": 12.0, "i": 60.0, "limit": 20.0}}


@pytest.mark.parametrize(("control", "axis"), [(SLUGGISH, "surge"), (SLUGGISH, "heading"), (WILD, "surge")])
def test_bad_gains_are_improved(control: dict[str, Any], axis: str) -> None:
    vehicle, _ = load_vehicle("paper_six")
    tuner = Tuner("paper_six", vehicle, control)
    (tuned,) = tuner.tune([axis])
    before, after = tuned.before.figures(), tuned.after.figures()
    assert tuned.better
    assert after.cost < 0.8 * before.cost or before.overshoot > 0.4
    assert after.overshoot < 0.1
    assert after.settling < 3.0
    # the reported response is that of a flight with the tuned gains
    assert fly_step("paper_six", vehicle, tuner.control, axis, tuned.after.size) == tuned.after


def test_good_gains_are_left_unchanged() -> None:
    vehicle, control = load_vehicle("paper_six")
    tuner = Tuner("paper_six", vehicle, control)
    (tuned,) = tuner.tune(["surge"])
    assert not tuned.better
    assert tuned.gains == {"surge": AxisGains(**control["surge"])}
    assert tuner.gains == parse(control, Gains, "")
    assert tuned.after == tuned.before


@pytest.mark.parametrize("name", ["remus100", "lauv", "eca_a9", "tethys"])
@pytest.mark.parametrize(("axis", "size"), [("depth", 1.0), ("heading", 0.8)])
def test_a_vehicle_with_fins_dives_and_turns_without_much_overshoot(name: str, axis: str, size: float) -> None:
    vehicle, control = load_vehicle(name)
    figures = Tuner(name, vehicle, control)._fly(axis, size, control).figures()
    assert figures.overshoot < 0.04
    assert figures.settling < 25.0
    assert abs(figures.steady) < 0.05


def test_the_identified_process_agrees_with_the_vehicle() -> None:
    """The process of RexROV, 2.6 t with little drag, has slope 1, little damping, and a delay from lag and sensors."""
    vehicle, control = load_vehicle("rexrov")
    (tuned,) = Tuner("rexrov", vehicle, control).tune(["sway"])
    assert tuned.process.slope == pytest.approx(1.0, abs=0.1)
    assert tuned.process.damping < 0.3
    assert tuned.process.delay == pytest.approx(0.05 + 0.025 + 0.01, abs=0.02)  # thrusters, odometry, controller


def test_unsupported_vehicles_and_axes_are_refused() -> None:
    torpedo, control = load_vehicle("remus100")
    glider = torpedo._replace(thrusters=tuple([t._replace(direction=(0.0, 1.0, 0.0)) for t in torpedo.thrusters]))
    with pytest.raises(ConfigError, match="remus100: no thruster drives it ahead"):
        Tuner("remus100", glider, control)
    six, control = load_vehicle("paper_six")
    with pytest.raises(ConfigError, match="family is 'mine:Law'; only the cascade"):
        Tuner("six", six, {**control, "family": "mine:Law"})
    tuner = Tuner("six", six, control)
    assert tuner.axes() == [axis for axis in AXES if axis != "pitch"]
    with pytest.raises(ConfigError, match="six: its thrusters do not drive pitch; they drive: surge, sway"):
        tuner.tune(["surge", "pitch"])


def test_a_surface_craft_is_tuned_afloat() -> None:
    six, control = load_vehicle("paper_six")
    level = tuple([thruster for thruster in six.thrusters if thruster.direction[2] == 0.0])
    boat = six._replace(volume=2.0 * six.volume, neutrally_buoyant=False, thrusters=level)
    tuner = Tuner("boat", boat, {**control, "heading": {"p": 0.2, "limit": 0.6}})
    assert tuner.axes() == ["surge", "sway", "yaw", "heading"]
    assert tuner.untuned() == "not tuned: heave, roll, pitch, depth: it floats, and its thrusters do not drive them"
    (tuned,) = tuner.tune(["heading"])
    assert tuned.better
    assert tuned.after.figures().overshoot < 0.1
    with pytest.raises(ConfigError, match="boat: it floats, and its thrusters do not drive depth; they drive: surge"):
        tuner.tune(["depth"])


# -- the file -----------------------------------------------------------------------------------------------------

GAINS = Gains()._replace(surge=AxisGains(p=3.21, i=7.0, slew=4.0), depth=HoldGains(0.9, 0.25))


def test_gains_written_as_text_are_read_back(tmp_path: Any) -> None:
    path = tmp_path / "gains.toml"
    path.write_text(control_text(GAINS))
    assert parse(read_table(str(path))["control"], Gains, "") == GAINS


@pytest.mark.parametrize(
    "old",
    [
        "",
        "# old gains\n# of mine\n[control]\nsurge = { p = 1.0 }\n",
        "[control]\n[control.surge]\np = 1.0\ni = 2.0\n[control.depth]\np = 1.0\nlimit = 1.0\n",
        "[control] # mine\nsurge = { p = 1.0 }\n\n[control.options]\nsway = { strength = 1.0, layer = 0.1 }\n",
    ],
)
def test_only_the_old_gains_are_replaced_in_a_file(old: str, tmp_path: Any) -> None:
    rest = 'name = "mine"\n# a comment\n[every_thruster]\nmax_forward = 3.0\n'
    path = tmp_path / "vehicle.toml"
    path.write_text(with_gains(f"{rest}\n{old}\n[[thrusters]]\nname = 'a' # left\n", GAINS, "new", "mine.toml"))
    text, table = path.read_text(), read_table(str(path))
    control = table.pop("control")
    assert ("options" in control) == ("options" in old)
    control.pop("options", None)
    assert parse(control, Gains, "") == GAINS
    assert table == {"name": "mine", "every_thruster": {"max_forward": 3.0}, "thrusters": [{"name": "a"}]}
    assert "# a comment" in text
    assert "# left" in text
    assert "# old gains" not in text
    assert "# new" in text
