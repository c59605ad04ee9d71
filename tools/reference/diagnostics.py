"""The page of the diagnostics, out of their table."""

from hil.ros.diagnostics import Diagnostics

HEAD = """\
# Diagnostics

What a slave publishes once a second on `/NODE/diagnostics` (diagnostic_msgs/DiagnosticArray), as keys and values of one
status. `uuv-hil top` shows a part of it, `uuv-hil top --prometheus` serves numbers in base units, and in Python
`vehicle.diagnostics` has every figure as an attribute of its type: `vehicle.diagnostics.cpu_s`. A figure that this
slave or its machine does not have is left out (None in Python). A counter begins at 0 with the slave, but for those of
the machine's network.

This page is made by `python -m tools.reference` from `hil/ros/diagnostics.py`.

| name | type | unit | meaning |
|---|---|---|---|
"""


def page() -> str:
    """Return the text of the document."""
    rows = [
        f"| `{name}` | {figure.kind} | {figure.unit} | {figure.meaning} |\n"
        for name, figure in Diagnostics.FIGURES.items()
    ]
    return HEAD + "".join(rows)
