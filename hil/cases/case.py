"""The interface of a case: one experiment of the reference platform, simulated or with slave processes."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path

from hil.cases.record import Mode, Run
from hil.cases.viewer import Viewer
from hil.common.errors import ConfigError
from hil.common.schema import at_place, nearest
from hil.common.tables import read_table

CASES = read_table(str(Path(__file__).with_name("cases.toml")))


class Case(ABC):
    """One experiment.

    `scenario`: a preset. `about`: for the report, a headline as `title`; what the `paper` shows; the `method` of this
    project, if that needs explanation; the `criterion` of success. `show` is called with the progress as text.
    `viewer`: live view.
    """

    show: Callable[[str], None] = staticmethod(lambda text: None)
    viewer: Viewer = Viewer()

    def __init__(self, name: str) -> None:
        self.name = name
        self.about: dict[str, str] = CASES[name]
        self.scenario = self.about["scenario"]

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
    case: Case = at_place(CASES[name]["class"])(name)
    return case
