"""Single-board computers (boards) as data: one TOML file a board. Adding a board is adding a file.

A number in a file has its source beside it: every table has its `source`, every number outside a table an entry in
`sources`. A source that begins with "unverified" is commonly stated but was not read anywhere.

Public: `load_board`, `detect`. It imports only `hil.common`, and must not know the slave or the commands.
"""

from typing import Annotated, Literal, NamedTuple

from boards.tree import Tree
from hil.common.schema import Range, find_preset, load, preset_names
from hil.common.tables import read_table

FOLDER = "boards"
MODEL_FILES = ("/proc/device-tree/model", "/sys/class/dmi/id/product_name")  # on most Arm boards; on PCs

Memory = Annotated[float, Range(64, 1_048_576, "MiB")]


class Serial(NamedTuple):
    """A serial port: its device, its pins, and what has to be done before it can be used."""

    device: str
    at: str
    source: str
    needs: str = ""


class Can(NamedTuple):
    """A CAN interface: its name in the kernel, its driver, and what has to be done to have it.

    `module` is the kernel's module for it, where the system does not load that by itself at boot.
    """

    interface: str
    controller: str
    source: str
    needs: str = ""
    module: str = ""


class PowerMode(NamedTuple):
    """A setting of clocks and cores: how it is selected, and what it leaves."""

    name: str
    command: str
    source: str
    cores: Annotated[int, Range(1, 256)]
    watts: Annotated[float, Range(0.5, 1000.0)] = 0.0  # 0: unknown


class Recommended(NamedTuple):
    """Recommended periods of the slave, and the most it may use of one core (0..1) and of the memory."""

    step: Annotated[float, Range(0.0002, 0.02, "s")]
    control_period: Annotated[float, Range(0.001, 0.2, "s")]
    core_share: Annotated[float, Range(0.01, 1.0)]
    memory: Memory
    source: str


class Budgets(NamedTuple):
    """Limits of the slave on the board, as `uuv-hil bench table` measures them; `reason`: source of the numbers.

    startup: from exec until the master's first sample. memory: resident, with the usual sensors.
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

    `models` are beginnings of the text in /proc/device-tree/model, or of the DMI product name, by which it is
    recognised; the first of `serial` is the port on its pin header. `ram` are the sizes it is sold with. `system` is
    an operating system for it with Python 3.10 or later, or one and how to get that. The service needs systemd 239 or
    later.
    `thermal_zones` are names of the processor's zone, whichever of them the kernel has; it slows down from
    `throttles_at` (°C, 0: unknown). `throttling` is the source of that: the firmware of a Raspberry Pi by
    "vcgencmd", else the kernel.
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
    throttles_at: Annotated[float, Range(0.0, 150.0)] = 0.0
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
    """Return the board this machine is, by its model name below `root`; None when it is none of ours."""
    here = model(root)
    if not here:
        return None
    for name in preset_names(FOLDER):
        path = find_preset(FOLDER, name)
        if here.startswith(tuple(read_table(path).get("models", ()))):
            return load(path, Board)
    return None
