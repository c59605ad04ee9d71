"""Single-board computers (boards) as data, with one TOML file per board. To add a board, add a file.

A file gives the source of every number: every table has a `source`, and every number outside a table an entry in
`sources`. "unverified" at the beginning of a source marks a common statement that no document confirmed.

Public: `load_board` and every module here. It imports only `hil.common`, and must not know the slave or the commands.
"""

from typing import Annotated, Literal, NamedTuple

from boards.tree import Tree
from hil.common.schema import Range, find_preset, load, preset_names
from hil.common.tables import read_table

FOLDER = "boards"
MODEL_FILES = ("/proc/device-tree/model", "/sys/class/dmi/id/product_name")  # on most Arm boards; on PCs

Memory = Annotated[float, Range(64, 1_048_576, "MiB")]


class Serial(NamedTuple):
    """A serial port: its device, its pins (`at`), and the steps that it `needs` before use."""

    device: str
    at: str
    source: str
    needs: str = ""


class Can(NamedTuple):
    """A CAN interface: its name in the kernel, its controller, and the steps that it `needs` before use.

    `module` is its kernel module, if the system does not load it at boot.
    """

    interface: str
    controller: str
    source: str
    needs: str = ""
    module: str = ""


class PowerMode(NamedTuple):
    """A power mode: the command that selects it, the number of active cores, and the power limit."""

    name: str
    command: str
    source: str
    cores: Annotated[int, Range(1, 256)]
    watts: Annotated[float, Range(0.5, 1000.0, "W")] = 0.0  # 0: unknown


class Recommended(NamedTuple):
    """Recommended periods of the slave (s), and its limits: share of one core (0..1), and memory (MiB)."""

    step: Annotated[float, Range(0.0002, 0.02, "s")]
    control_period: Annotated[float, Range(0.001, 0.2, "s")]
    core_share: Annotated[float, Range(0.01, 1.0)]
    memory: Memory
    source: str


class Budgets(NamedTuple):
    """Limits of the slave on the board, as measured by `uuv-hil bench table`. `reason`: source of the numbers.

    startup: from exec until the master's first sample. memory: resident, with the default sensors.
    slave_cpu: share of one core at 400 Hz. delay: of a command, from publish to applied, over a pseudo terminal.
    """

    startup: Annotated[float, Range(0.001, 100.0, "s")]
    memory: Annotated[float, Range(1.0, 4096.0, "MiB")]
    slave_cpu: Annotated[float, Range(0.001, 16.0)]
    delay_p50: Annotated[float, Range(1e-5, 10.0, "s")]
    delay_p99: Annotated[float, Range(1e-5, 10.0, "s")]
    reason: str


class Board(NamedTuple):
    """A single-board computer.

    It is recognised by `models`: prefixes of the text in /proc/device-tree/model, or of the DMI product name; the
    longest counts. The first of `serial` is the port on its pin header. `ram` are the available memory sizes. `system`
    is an operating system with Python 3.10 or later, or one and how to install that Python. The service needs systemd
    239 or later.
    `thermal_zones` are possible names of the processor's thermal zone. The processor throttles from `throttles_at` (°C,
    0: unknown). `throttling` is where that is reported: by the firmware of a Raspberry Pi ("vcgencmd"), or the kernel.
    """

    name: str
    source: str
    architecture: Literal["aarch64", "armv7l", "x86_64"]
    cpu: str
    cores: Annotated[int, Range(0, 256)]  # 0: it depends
    recommended: Recommended
    budgets: Budgets
    ram: tuple[Memory, ...] = ()
    models: tuple[str, ...] = ()
    system: str = ""
    wlan: str = ""
    thermal_zones: tuple[str, ...] = ()
    throttles_at: Annotated[float, Range(0.0, 150.0, "°C")] = 0.0
    throttling: Literal["kernel", "vcgencmd"] = "kernel"
    serial: tuple[Serial, ...] = ()
    can: tuple[Can, ...] = ()
    power: tuple[PowerMode, ...] = ()
    sources: dict[str, str] = {}  # noqa: RUF012 - never changed

    @property
    def uart(self) -> str:
        """The serial port on the pin header; empty if it has none."""
        return self.serial[0].device if self.serial else ""


def load_board(name: str) -> Board:
    """Return the board called `name`, or the file at a path ending in `.toml`. Raises ConfigError."""
    return load(find_preset(FOLDER, name), Board)


def model(root: str = "/") -> str:
    """Return the model name of the machine whose files are below `root`; empty if it has none."""
    tree = Tree(root)
    return next(filter(None, map(tree.text, MODEL_FILES)), "")


def detect(root: str = "/") -> Board | None:
    """Return the board of this machine, by its model name below `root`; None if it is not known."""
    this_model = model(root)
    if not this_model:
        return None
    best, found = "", ""  # the longest prefix: "Raspberry Pi 3 Model B" also begins the name of the B Plus
    for name in preset_names(FOLDER):
        path = find_preset(FOLDER, name)
        for prefix in read_table(path).get("models", ()):
            if this_model.startswith(prefix) and len(prefix) > len(best):
                best, found = prefix, path
    return load(found, Board) if found else None
