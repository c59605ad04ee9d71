"""`uuv-hil scenario`: list the installed scenarios, show, copy and check one, and print the schemas of all files."""

import argparse
import json
from typing import Any

from hil.commands.files import schema
from hil.common.columns import aligned
from hil.common.errors import ConfigError
from hil.common.options import add_json, add_scenario, add_scenario_name, add_strict, changes_of, new_parser
from hil.common.schema import find_preset, preset_names, shortened
from hil.common.tables import read_bytes
from hil.doctor.vehicle.finding import exit_code
from hil.scenario.config import SCENARIOS, load_scenario

EXAMPLES = """\
`check` finds the problems that a flight would have: wrong keys and values, a rate that the link's baud cannot carry, a
start, a goal or a task inside an obstacle, a speed that the vehicle cannot reach or that tilts it too far, a path that
takes longer than time_limit, overlapping members of a fleet, missing folders of certificates, and what `uuv-hil
vehicle` finds about the vehicle. Its exit code is 1 if
there is a problem, with --strict also if there is a warning; 2 if the file cannot be read.

examples:
  uuv-hil scenario list
  uuv-hil scenario show paper_field
  uuv-hil scenario new mine.toml --copy task_scheduling
  uuv-hil scenario check mine.toml
  uuv-hil scenario check mine.toml --set master.speed=1.5 --set "start.depth='2 m'"
  uuv-hil scenario schema scenario -o scenario.schema.json
  uuv-hil scenario schema -o schemas

The first line of a TOML file then names its schema, for Even Better TOML (VS Code) and taplo:

  #:schema schemas/scenario.schema.json
"""


def main(arguments: list[str]) -> int:
    """Run one action; return the exit code. Raises ConfigError."""
    options = _parser().parse_args(arguments)
    if options.action == "list":
        return _list()
    if options.action == "show":
        print(_text(find_preset(SCENARIOS, options.scenario)), end="")
        return 0
    if options.action == "new":
        return _new(options.file, options.copy)
    if options.action == "schema":
        return schema.write_schemas(options)
    return _check(options.scenario, changes_of(options), options.json, options.strict)


def _parser() -> argparse.ArgumentParser:
    parser = new_parser("scenario", __doc__, EXAMPLES)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    actions.add_parser("list", help="list the installed scenarios")
    shown = actions.add_parser("show", help="print the file of one, with its comments")
    add_scenario_name(shown)
    new = actions.add_parser("new", help="copy an installed one to a file of your own")
    new.add_argument("file", metavar="FILE.toml", help="the new file")
    new.add_argument("--copy", metavar="NAME", default="paper_field", help="installed scenario to copy [%(default)s]")
    checked = actions.add_parser("check", help="check a scenario without flying it")
    add_scenario(checked, None)
    add_json(checked)
    add_strict(checked)
    schema.add_to(actions)
    return parser


def _list() -> int:
    rows = [("name", "vehicle", "world", "description")]
    for name in preset_names(SCENARIOS):
        scenario = load_scenario(name)
        several = f"{len(scenario.member)} x " if len(scenario.member) > 1 else ""
        rows.append((name, several + scenario.vehicle, scenario.world, scenario.description))
    print("\n".join(aligned(rows, rule=True)))
    return 0


def _text(path: str) -> str:
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text; save it as UTF-8") from None


def _new(path: str, name: str) -> int:
    """Copy an installed scenario; it names vehicles and worlds by preset, so that the copy works in any folder."""
    if name not in preset_names(SCENARIOS):
        names = ", ".join(preset_names(SCENARIOS))
        raise ConfigError(f"--copy: no installed scenario {shortened(name)}; there are: {names}")
    if not path.endswith(".toml"):
        raise ConfigError(f"{path}: a scenario's file ends in .toml")
    text = _text(find_preset(SCENARIOS, name))
    try:
        with open(path, "x", encoding="utf-8") as file:  # "x": never overwrite a file
            file.write(text)
    except FileExistsError:
        raise ConfigError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; name a file in a folder of yours") from None
    fleet = load_scenario(name).member
    flight = f"fleet up {path}" if fleet else f"sim {path} --fast"
    print(f"{path}: a copy of {name}; next: uuv-hil scenario check {path}, then uuv-hil {flight}")
    return 0


def _check(name: str, changes: dict[str, Any], as_json: bool, strict: bool) -> int:
    from hil.doctor.scenario.check import check_scenario

    findings = list(check_scenario(load_scenario(name, changes)))
    if as_json:
        print(json.dumps([finding._asdict() for finding in findings]))
    else:
        print("\n".join(map(str, findings)) or f"{name}: no problem found")
    return exit_code(findings, strict)
