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

    `scenario` is a preset; `title` a headline, `paper` what the paper shows, `method` how it is done here where that
    needs explanation, `criterion` what success is.
    """

    name: str
    scenario: str
    title: str
    paper: str
    criterion: str
    method: str = ""
    show: Callable[[str], None] = staticmethod(lambda text: None)  # what gets a text again and again, how far it is
    viewer: Viewer = Viewer()

    @abstractmethod
    def fly(self, mode: Mode, seed: int, folder: str) -> Run:
        """Fly once and leave the files of the flight in `folder`, which is there.

        "sil" is in this process and in simulated time, "hil" with slaves as processes of their own and this process as
        their master. Seed 1 is the case as it stands, others vary noise and whatever the case lets vary. A mission that
        fails is a result; raises the errors of hil/common/errors.py for what could not be flown at all.
        """

    @abstractmethod
    def draw(self, runs: Sequence[Run], path: str) -> None:
        """Draw the paper's figure of this case from these flights (SIL and HIL of one seed), as a PNG at `path`."""


def find_case(name: str) -> Case:
    """Return the case of that name. Raises ConfigError that lists the cases there are."""
    if name not in CASES:
        raise ConfigError(f"no case {name!r}{nearest(name, list(CASES))}; there are: {', '.join(CASES)}")
    module, _, attribute = CASES[name].partition(":")
    case: Case = getattr(import_module(module), attribute)()
    return case
