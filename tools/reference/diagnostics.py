"""Reference page of the diagnostics, from their table."""

from hil.ros.diagnostics import Diagnostics

HEAD = """\
# Diagnostics

A slave publishes these figures once a second on `/NODE/diagnostics` (diagnostic_msgs/DiagnosticArray), as keys and
values of one status. `uuv-hil top` shows some of them, `uuv-hil top --prometheus` serves the numbers in base units. In
Python, `vehicle.diagnostics` has each figure as an attribute, such as `vehicle.diagnostics.cpu_s`. A figure that this
slave or its machine does not have is left out (None in Python). Counters are 0 when the slave starts, except for those
of the machine's network.

This page is made by `python -m tools.reference` from `hil/ros/diagnostics.py`.

| name | type | unit | meaning |
|---|---|---|---|
"""


def page() -> str:
    """Return the page of the diagnostics."""
    rows = [
        f"| `{name}` | {figure.kind} | {figure.unit} | {figure.meaning} |\n"
        for name, figure in Diagnostics.FIGURES.items()
    ]
    return HEAD + "".join(rows)
