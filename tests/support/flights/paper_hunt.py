"""The hunt of Zhang et al. 2022: starts and target in m, the paper's x and y taken as north and east."""

FORMATIONS: dict[str, tuple[tuple[float, float], ...]] = {
    "line": ((0.0, 0.0), (3.0, 0.0), (6.0, 0.0), (9.0, 0.0)),
    "diamond": ((4.5, 2.0), (3.0, 1.0), (6.0, 1.0), (4.5, 0.0)),
}
TARGET = (5.0, 8.0)
