"""Thruster links of the campaign: kind of STM32, protocol and wire, and the time limits that follow from them."""

from typing import NamedTuple

DEADMAN_S, WATCHDOG_S = 0.5, 0.2
REPORT_S = 0.02  # longest time between two reports of the STM32: the resolution of its measured outputs


class Link(NamedTuple):
    """One kind of thruster link: kind of STM32, protocol, wire; `thorough`: only with --all."""

    stm32: str
    protocol: str
    wire: str
    thorough: bool = False

    @property
    def name(self) -> str:
        """Name in the table, such as "python frame pty"."""
        return f"{self.stm32} {self.protocol} {self.wire}"

    @property
    def frame_s(self) -> float:
        """Return the longest time of a command on the line, s: 200 bytes at 115,200 Bd, 0 on a network."""
        return 200 * 10 / 115_200 if self.wire == "pty" else 0.002

    @property
    def limit_s(self) -> float:
        """Return the time (s) until the outputs must be neutral: deadman, watchdog, one frame, and one report of it."""
        return DEADMAN_S + WATCHDOG_S + self.frame_s + REPORT_S


LINKS = (
    Link("python", "frame", "pty"),
    Link("python", "mavlink", "udp"),
    Link("native", "frame", "pty"),
    Link("native", "mavlink", "pty"),
    Link("python", "mavlink", "pty"),
    Link("python", "frame", "udp"),
    Link("python", "frame", "tcp"),
    Link("python", "vesc", "can"),
    Link("python", "dronecan", "can"),
    Link("unicorn", "frame", "pty", thorough=True),
    Link("unicorn", "mavlink", "pty", thorough=True),
)
USUAL = LINKS[0]
