"""The interface of a case: one experiment of the reference platform, simulated or with slave processes."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from importlib import import_module

from hil.cases.record import Mode, Run
from hil.cases.viewer import Viewer
from hil.common.errors import ConfigError
from hil.common.schema import nearest

# name -> its class, without arguments to it
CASES = {
    "path_planning": "hil.cases.path_planning:PathPlanning",
    "path_planning_unknown": "hil.cases.path_planning:PathPlanningUnknown",
    "task_scheduling": "hil.cases.task_scheduling:TaskScheduling",
    "target_hunting": "hil.cases.target_hunting:TargetHunting",
    "target_hunting_acoustic": "hil.cases.target_hunting:TargetHuntingAcoustic",
    "target_hunting_diamond": "hil.cases.target_hunting:TargetHuntingDiamond",
}


class Case(ABC):
    """One experiment.

    `scenario`: a preset. `title`: a headline. `paper`: what the paper shows. `method`: how this project does it, if
    that needs explanation. `criterion`: of success. `show` is called with the progress as text. `viewer`: live view.
    """

    name: str
    scenario: str
    title: str
    paper: str
    criterion: str
    method: str = ""
    show: Callable[[str], None] = staticmethod(lambda text: None)
    viewer: Viewer = Viewer()

    @abstractmethod
    def fly(self, mode: Mode, seed: int, folder: str) -> Run:
        """Fly once, write the files of the flight into the existing `folder`, and return the flight.

        "sil" runs in this process and in simulated time; "hil" uses slave processes, with this process as their master.
        Seed 1 is the scenario unchanged; other seeds change the noise and other values, depending on the case. A failed
        mission is a result. Raises the errors of hil/common/errors.py if the flight is not possible.
        """

    @abstractmethod
    def draw(self, runs: Sequence[Run], path: str) -> None:
        """Draw the paper's figure of this case from these flights (SIL and HIL of one seed), as a PNG at `path`."""


def find_case(name: str) -> Case:
    """Return the case of that name. Raises ConfigError, which lists all cases."""
    if name not in CASES:
        raise ConfigError(f"no case {name!r}{nearest(name, list(CASES))}; there are: {', '.join(CASES)}")
    module, _, attribute = CASES[name].partition(":")
    case: Case = getattr(import_module(module), attribute)()
    return case
