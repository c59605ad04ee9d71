"""Forces of a user's own class, from a scenario."""

from pathlib import Path

import pytest

from hil.common.errors import ConfigError
from hil.scenario.config import build_simulation, load_scenario
from sim.environment.world import load_world
from sim.vehicle.vehicle import load_vehicle

FORCE_FILE = """
class Tether:
    def __init__(self, pull, limit=1e9):
        if pull < 0:
            raise ValueError("pull is negative")
        self.pull, self.limit, self.began = pull, limit, []

    def begin(self, time_ns):
        self.began.append(time_ns)

    def wrench(self, position, rotation, nu_r):
        return [-min(self.pull, self.limit), 0.0, 0.0, 0.0, 0.0, 0.0]

class Deaf:
    def wrench(self, position, rotation, nu_r):
        return [0.0] * 6
"""


def scenario_file(folder: Path, force: str) -> str:
    (folder / "my_forces.py").write_text(FORCE_FILE)
    path = folder / "mine.toml"
    path.write_text(
        f'vehicle = "paper_six"\nworld = "pool"\n[master]\ngoal = [1.0, 1.0]\n[start]\ndepth = 2.0\n{force}'
    )
    return str(path)


def test_a_users_force_acts_in_a_simulation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    scenario = load_scenario(scenario_file(tmp_path, '[[force]]\nclass = "my_forces:Tether"\npull = 5.0\n'))
    vehicle, _ = load_vehicle(scenario.vehicle)
    simulation = build_simulation(scenario, vehicle, load_world(scenario.world))
    for _ in range(400):
        simulation.step((1500,) * 6)
    assert simulation.truth().nu[0] < -0.1
    (force,) = scenario.force
    assert force.began == [k * 2_500_000 for k in range(400)]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("force", "message"),
    [
        ("[[force]]\npull = 5.0", 'force[0]: class: expected "module:Class", found None'),
        ('[[force]]\nclass = "my_forces"', "class: expected \"module:Class\", found 'my_forces'"),
        ('[[force]]\nclass = "no_such_module:A"', "no_such_module cannot be imported"),
        ('[[force]]\nclass = "my_forces:Nothing"', "my_forces has no 'Nothing'"),
        ('[[force]]\nclass = "my_forces:Tether"\npul = 1', "unexpected keyword argument 'pul'"),
        ('[[force]]\nclass = "my_forces:Tether"\npull = -1', "pull is negative"),
        ('[[force]]\nclass = "my_forces:Deaf"', "my_forces:Deaf has no method 'begin'"),
        ("[force]\npull = 1", "force: expected tables, each under [[force]]"),
    ],
)
def test_wrong_forces_are_reported(force: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=r"mine\.toml: force") as caught:
        load_scenario(scenario_file(tmp_path, force))
    assert message in str(caught.value)
