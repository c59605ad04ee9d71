"""Parts of the pages of topics, diagnostics, instruments, sensors, STM32 chips and faults, from the code's tables."""

import inspect
import json
from pathlib import Path
from typing import Any, get_type_hints

from firmware_stub.image import CHIPS, load_image
from hil.common.tables import read_table
from hil.instruments.contract import NoSettings
from hil.instruments.table import INSTRUMENTS, load_instrument
from hil.ros.diagnostics import Diagnostics
from hil.ros.topics import COMMANDS, TOPICS, Qos
from sim.sensors.kinds import SENSORS
from sim.sensors.sensor_set import load_sensor, select_sensors
from tools.faults.report import markdown
from tools.faults.rows import Row
from tools.reference.records import default_of, kind_of, rows

FOLDER = Path(__file__).parent
FAULTS = FOLDER.parents[1] / "docs" / "explanation" / "reliability" / "faults.json"
ENTRIES = read_table(str(FOLDER / "sensors.toml"))  # sensor -> title, and captions by picture
CONTENT = {stream.topic: stream.meaning for kind in SENSORS.values() for stream in kind.streams}
CONTENT |= read_table(str(FOLDER / "topics.toml"))


def diagnostics() -> str:
    """Return the rows of the figures of a slave."""
    return rows((f"`{name}`", row.kind, row.unit, row.meaning) for name, row in Diagnostics.FIGURES.items())


def faults() -> str:
    """Return the tables of the fault campaign, from the file of its last run."""
    results = []
    for values in json.loads(FAULTS.read_text(encoding="utf-8"))["rows"]:
        known: dict[str, Any] = {key: float("nan") if values[key] is None else values[key] for key in Row._fields}
        results.append(Row(**known | {"problems": tuple(known["problems"])}))
    return markdown(results)


def topics(sender: str) -> str:
    """Return the rows of the topics from a "vehicle", of a fleet's "planners", or of the "commands"."""
    table = []
    for topic in TOPICS.values():
        if sender != ("commands" if topic.name in COMMANDS else "planners" if topic.from_master else "vehicle"):
            continue
        qos = ["reliable" if topic.qos.reliable else "best effort", f"depth {topic.qos.depth}"]
        qos = ([] if topic.qos == Qos() else qos) + (["latched"] if topic.qos.latched else [])
        rate = f"{topic.rate_hz:g}" if topic.rate_hz else "on events"
        name = f"`{topic.full_name('NODE')}`"
        table.append((name, f"`{topic.type}`", rate, ", ".join(qos), CONTENT[topic.name]))
    return rows(table)


def instruments() -> str:
    """Return the rows of all instruments."""
    table = []
    for name in sorted(INSTRUMENTS):
        kind = load_instrument(name, "reference")
        words = [", ".join(f"`{word}`" for word in each) for each in (kind.sensors, kind.wires)]
        table.append((f"[`{name}`](#{name})", *words, kind.baud, f"{kind.warm_up_s:g}"))
    return rows(table)


def instrument_sections() -> str:
    """Return a section for each instrument: its text and its settings."""
    parts = []
    for name in sorted(INSTRUMENTS):
        kind = load_instrument(name, "reference")
        parts.append(f"## {name}\n\n{inspect.getdoc(kind)}\n")
        if kind.Model is not NoSettings:
            head = "| setting | type | unit | default | range |\n|---|---|---|---|---|\n"
            hints = get_type_hints(kind.Model, include_extras=True)
            table = rows(_setting(kind.Model, key, hint) for key, hint in hints.items())
            parts.append(f"{inspect.getdoc(kind.Model)}\n\n{head}{table}")
    return "\n".join(parts)


def _setting(record: Any, key: str, hint: Any) -> tuple[str, ...]:
    kind = kind_of(hint)
    shown = "table, keys as in the scenario" if kind.inner else kind.type
    return f"`{key}`", shown, kind.unit, default_of(record, key), kind.range


def sensors() -> str:
    """Return a section for each sensor that has a description."""
    lines = []
    for name, entry in ENTRIES.items():
        fitted = select_sensors(**{name: load_sensor(name).Model()})[name]
        about = (inspect.getdoc(fitted.sensor) or "").split("\n\n")
        source = (inspect.getdoc(type(fitted.model)) or "").split("\n\n")[-1]  # of its numbers
        text = "\n\n".join([" ".join(part.split()) for part in (*about, source)])
        keys = f"Keys and defaults: [`{name}`](sensor_keys.md#{name})."
        lines += [f"## {entry['title']}", "", f"`[sensors.{name}]`", "", text, "", keys, ""]
        for picture, caption in entry.get("pictures", {}).items():
            lines += [f"![{picture.replace('_', ' ')}](sensors/{picture}.png)", "", " ".join(caption.split()), ""]
    return "\n".join(lines)


def chips() -> str:
    """Return the rows of the STM32 chips."""
    table = []
    for image in map(load_image, CHIPS):
        ids = ", ".join(f"{number:#05x}" for number in image.device_ids)
        can = "yes" if image.can else "no: the chip has no controller"
        table.append(
            (f"`{image.name}`", image.chip, ", ".join(image.boards), ids, image.clock, can, f"{image.size} bytes")
        )
    return rows(table)


def wiring() -> str:
    """Return a section for each chip with the pin of each signal, and its header on a Nucleo board."""
    parts = []
    for image in map(load_image, CHIPS):
        serial, can = image.serial, image.can
        signals = [(f"output {i}", pin, "") for i, pin in enumerate(image.outputs, 1)]
        signals += [(f"{serial['port']} TX", serial["tx"], serial["note"]), (f"{serial['port']} RX", serial["rx"], "")]
        signals += [("CAN RX", can["rx"], can["note"]), ("CAN TX", can["tx"], "")] if can else []
        titles = ("signal", "pin", *(["Nucleo"] if image.headers else []), "note")
        line = f"|{'---|' * len(titles)}\n"
        headers = {pin: [image.headers.get(pin, "")] if image.headers else [] for _, pin, _ in signals}
        table = rows((signal, pin, *headers[pin], note) for signal, pin, note in signals)
        parts.append(f"## {image.chip}\n\n{rows([titles])}{line}{table}")
    return "\n".join(parts)
