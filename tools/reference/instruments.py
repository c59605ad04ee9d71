"""Reference page of the instruments: what each does at its wire, and its settings, from the classes."""

from inspect import getdoc
from typing import Any, get_type_hints

from hil.instruments.contract import Instrument, NoSettings
from hil.instruments.table import INSTRUMENTS, load_instrument
from tools.reference.records import default_of, kind_of

HEAD = """\
# Instruments

A sensor with the key `instrument` stands at its own wire, as the device that a vehicle's computer reads:

```toml
[sensors.gps]
position = [0.0, 0.0, -0.6]
instrument = "ublox_m9"
at = ["pty:/tmp/gps", "tcp:127.0.0.1:5000"]
```

`gpsd -N /tmp/gps` then finds a u-blox receiver, and a program that connects to port 5000 configures and reads the same
one. A slave starts the process of the instruments, `uuv-hil instruments`. [The keys](sensor_keys.md#instrument) are
those of every instrument; `settings` has those below. A message goes out with the sample that it carries, so a client
gets no more measurements in a second than the sensor's `rate`, unless the text says that the instrument measures
itself. What a client sets is kept while the power is off, not when the process ends. At a pseudo terminal a client at
another baud rate than the instrument's reads rubbish. Xsens, Nortek, EvoLogics and Valeport, and imaging sonars other
than those below, have no instrument here; [a plug-in](../how-to/plugins.md) adds one.

This page is made by `python -m tools.reference` from `hil/instruments`.

"""


def page() -> str:
    """Return the page of all instruments."""
    kinds = {name: load_instrument(name, "reference") for name in sorted(INSTRUMENTS)}
    rows = [
        f"| [`{name}`](#{name}) | {_words(kind.sensors)} | {_words(kind.wires)} | {kind.baud} | {kind.warm_up_s:g} |\n"
        for name, kind in kinds.items()
    ]
    table = "| instrument | sensor | wires | baud rate | warm-up (s) |\n|---|---|---|---|---|\n" + "".join(rows)
    return HEAD + table + "".join(_section(name, kind) for name, kind in kinds.items())


def _words(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _section(name: str, kind: type[Instrument]) -> str:
    text = f"\n## {name}\n\n{getdoc(kind)}\n"
    if kind.Model is NoSettings:
        return text
    rows = "".join(_row(kind.Model, key, hint) for key, hint in get_type_hints(kind.Model, include_extras=True).items())
    head = "| setting | type | unit | default | range |\n|---|---|---|---|---|\n"
    return f"{text}\n{getdoc(kind.Model)}\n\n{head}{rows}"


def _row(record: Any, key: str, hint: Any) -> str:
    kind = kind_of(hint)
    shown = "table, keys as in the scenario" if kind.inner else kind.type
    return f"| `{key}` | {shown} | {kind.unit} | {default_of(record, key)} | {kind.range} |\n"
