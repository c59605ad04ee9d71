"""Reference page of the diagnostics, from their table."""

from hil.ros.diagnostics import Diagnostics

HEAD = """\
# Diagnostics

A slave publishes these figures once a second on `/NODE/diagnostics` (diagnostic_msgs/DiagnosticArray), as the keys
and values of one status.

- `uuv-hil top` shows some of them. `uuv-hil top --prometheus` serves the numbers in base units.
- In Python, each figure is an attribute of `vehicle.diagnostics`, for example `vehicle.diagnostics.cpu_s`.
- A figure that this slave or its machine does not have is left out. In Python it is None.
- Counters are 0 when the slave starts, except those of the machine's network interfaces.
- A flag is true or false.

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
