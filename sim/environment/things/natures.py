"""The materials of seabeds in charts: their numbers in S-57 (NATSUR), and their echo, colour and texture.

Echoes of the kinds in sim.environment.bottom are those given there; the echoes of other kinds lie between them. Colours
and textures are our choice.
"""

from typing import NamedTuple

from sim.environment.bottom import PROPERTIES


class Nature(NamedTuple):
    """One kind of seabed: its number in S-57, its echo (dB relative to sand), colour, and strength of texture."""

    code: int
    echo: float
    colour: tuple[float, float, float]
    texture: float


NATURES: dict[str, Nature] = {
    "mud": Nature(1, PROPERTIES["mud"].echo, (0.17, 0.14, 0.10), 0.4),
    "clay": Nature(2, -5.0, (0.26, 0.22, 0.18), 0.4),
    "silt": Nature(3, -4.0, (0.25, 0.21, 0.15), 0.5),
    "sand": Nature(4, PROPERTIES["sand"].echo, (0.42, 0.36, 0.26), 1.0),
    "stone": Nature(5, 4.0, (0.24, 0.23, 0.21), 1.6),
    "gravel": Nature(6, PROPERTIES["gravel"].echo, (0.31, 0.28, 0.23), 1.4),
    "pebbles": Nature(7, 3.5, (0.30, 0.28, 0.25), 1.5),
    "cobbles": Nature(8, 4.0, (0.26, 0.25, 0.22), 1.7),
    "rock": Nature(9, PROPERTIES["rock"].echo, (0.17, 0.16, 0.14), 1.5),
    "lava": Nature(11, 5.0, (0.10, 0.10, 0.10), 1.5),
    "coral": Nature(14, 4.0, (0.45, 0.34, 0.28), 1.8),
    "shells": Nature(17, 2.0, (0.50, 0.47, 0.40), 1.5),
    "boulder": Nature(18, 5.0, (0.20, 0.19, 0.17), 1.9),
}
