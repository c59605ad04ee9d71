"""The slave as a service of the board: which files that takes, and writing and taking them away again.

Everything that is written is planned first, shown, and noted in a manifest with what was there before; taking away
puts that back.
"""

import hashlib
import json
import os
import re
import sys
from contextlib import suppress
from difflib import unified_diff
from typing import Any, NamedTuple

from boards import FOLDER, Board
from boards.tree import Tree
from hil.clock import LOOP_PRIORITY
from hil.config import Scenario
from hil.errors import ConfigError, DeviceError
from hil.links.address import parse_address
from hil.schema import preset_folder

UNIT = "/etc/systemd/system/uuv-hil.service"
CAN_UNIT = "/etc/systemd/system/uuv-hil-can.service"
RULES = "/etc/udev/rules.d/70-uuv-hil.rules"
LIMITS = "/etc/security/limits.d/uuv-hil.conf"
MANIFEST = "/etc/uuv-hil/installed.json"  # not in /var/lib: the service's user could write there what root deletes
# Kinds of serial devices as the kernel lists them, for a link whose device is not there yet.
SERIAL_DRIVERS = ("ttyS", "ttyAMA", "ttyTHS", "ttyUSB", "ttyACM")
LEAK = 4  # times the recommended memory
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")  # of users, devices and interfaces, as units and rules take them


class Change(NamedTuple):
    """One file: where, what it is to hold (None: it goes), and what it holds now (None: it is not there)."""

    path: str
    after: str | None
    before: str | None


class Service(NamedTuple):
    """What the service is to run: the slave of `scenario` as `user`, listening at `listen` or where that says."""

    scenario: Scenario
    name: str  # as it was given
    user: str
    listen: str | None = None
    board: str | None = None


def plan_install(tree: Tree, service: Service, board: Board | None) -> list[Change]:
    """The files that are missing, differ, or are of an installation before and not needed any more.

    Raises ConfigError when the user cannot be meant, or a name cannot stand in a unit.
    """
    check_user(tree, service.user)
    texts = {UNIT: unit(tree, service, board), RULES: rules(tree, service, board), LIMITS: limits(service)}
    if _can(service.scenario):
        texts[CAN_UNIT] = can_unit(service.scenario)
    changes = [Change(path, text, _read(tree, path)) for path, text in sorted(texts.items())]
    if tree.exists(MANIFEST):
        changes += [change for change in plan_uninstall(tree)[0] if change.path not in texts]
    return [change for change in changes if change.after != change.before]


def plan_uninstall(tree: Tree) -> tuple[list[Change], list[str]]:
    """What takes away all that the manifest names, and the paths that somebody has changed since: they stay.

    Raises ConfigError when nothing is installed.
    """
    changes, changed = [], []
    for path, note in _manifest(tree).items():
        now = _read(tree, path)
        if now is None:
            continue
        if _digest(now) == note["sha256"]:
            changes.append(Change(path, note["before"], now))
        else:
            changed.append(path)
    return changes, changed


def show(change: Change) -> str:
    """A change as a unified diff."""
    (old_name, old), (new_name, new) = (
        (change.path, text.splitlines()) if text is not None else ("/dev/null", [])
        for text in (change.before, change.after)
    )
    return "\n".join(unified_diff(old, new, old_name, new_name, lineterm=""))


def install(tree: Tree, changes: list[Change]) -> None:
    """Do what `plan_install` says. Raises DeviceError when that is not permitted; then nothing was written."""
    check_permission(tree, [change.path for change in changes] + [MANIFEST])
    notes = _manifest(tree) if tree.exists(MANIFEST) else {}
    for change in changes:
        if change.after is not None:
            before = notes.get(change.path, {"before": change.before})["before"]  # that of the first time
            notes[change.path] = {"sha256": _digest(change.after), "before": before}
    _put(tree, MANIFEST, json.dumps(notes, indent=1, sort_keys=True) + "\n")  # first: what follows can be undone
    for change in changes:
        _put(tree, change.path, change.after)


def uninstall(tree: Tree, changes: list[Change]) -> None:
    """Do what `plan_uninstall` says. Raises DeviceError when that is not permitted; then nothing was removed."""
    check_permission(tree, [change.path for change in changes] + [MANIFEST])
    for change in changes:
        _put(tree, change.path, change.after)
    _put(tree, MANIFEST, None)
    with suppress(OSError):  # somebody keeps something there
        os.rmdir(os.path.dirname(tree.path(MANIFEST)))


def units(changes: list[Change]) -> list[str]:
    """The names of the units among `changes`."""
    return [os.path.basename(change.path) for change in changes if change.path.endswith(".service")]


def unit(tree: Tree, service: Service, board: Board | None) -> str:
    """The service's unit for systemd."""
    scenario = service.scenario
    recording = scenario.recording.folder if scenario.recording.slave else ""
    values = {
        "description": " ".join((scenario.description or service.name).split()).replace("%", "%%"),
        "can_unit": os.path.basename(CAN_UNIT) if _can(scenario) else "",
        "command": " ".join(word(part).replace("$", "$$") for part in command(service)),
        "pythonpath": word(os.path.dirname(preset_folder(FOLDER))),
        "user": service.user,
        "rtprio": str(LOOP_PRIORITY if scenario.slave.realtime else 0),
        "memory_max": f"{LEAK * (board.recommended.memory if board else 64):.0f}M",
        # Others find a pty by its name in /tmp only if it is not a /tmp of the service's own.
        "private_tmp": "no" if scenario.link.port.startswith("pty:/tmp/") else "yes",
        "devices": "\n".join(_devices(tree, scenario, board)),
        "writable": f"ReadWritePaths={word('-' + recording)}" if os.path.isabs(recording) else "",
    }
    return _fill("systemd/uuv-hil.service", values)


def can_unit(scenario: Scenario) -> str:
    """The unit that gives the CAN interface of the link its bit rate."""
    values = {"interface": _can(scenario), "bitrate": str(scenario.link.bitrate), "ip": "/sbin/ip"}
    return _fill("systemd/uuv-hil-can.service", values)


def rules(tree: Tree, service: Service, board: Board | None) -> str:
    """The rules for udev."""
    device = serial_device(service.scenario, board)
    kernel = _name(os.path.basename(tree.resolve(device)), device) if device else ""
    permitted = 'SUBSYSTEM=="tty", KERNEL=="{}", GROUP="dialout", MODE="0660", ENV{{ID_MM_DEVICE_IGNORE}}="1"'
    line = permitted.format(kernel) if kernel else "# None: it is no serial port of this board."
    return _fill("udev/70-uuv-hil.rules", {"serial": line, "iw": "/usr/sbin/iw"})


def limits(service: Service) -> str:
    """What the user is granted in a shell."""
    return _fill("systemd/limits.conf", {"user": service.user, "rtprio": str(LOOP_PRIORITY)})


def serial_device(scenario: Scenario, board: Board | None) -> str:
    """The serial port that a scenario's link uses on a board; empty when it uses none."""
    address = parse_address(scenario.link.port)
    if address.kind in ("uart", "rs485") or (address.interface == "slcan"):
        return address.place
    return board.uart if board and scenario.stm32 == "device" and scenario.link.port == "pty:" else ""


def drivers(tree: Tree, scenario: Scenario, board: Board | None) -> tuple[str, ...]:
    """The kinds of serial devices the service may open: that of its link, or all while the link is not there."""
    device = serial_device(scenario, board)
    if not device:
        return ()
    kind = os.path.basename(tree.resolve(device)).rstrip("0123456789")
    return (kind,) if kind in SERIAL_DRIVERS else SERIAL_DRIVERS


def _devices(tree: Tree, scenario: Scenario, board: Board | None) -> list[str]:
    lines = [f"DeviceAllow=char-{driver} rw" for driver in drivers(tree, scenario, board)]
    awake = scenario.slave.realtime and scenario.slave.stay_awake
    return lines + (["DeviceAllow=/dev/cpu_dma_latency w"] if awake else [])


def command(service: Service) -> list[str]:
    """What the service executes."""
    name = os.path.abspath(service.name) if service.name.endswith(".toml") else service.name
    words = [sys.executable, "-m", "hil.cli", "slave", name]
    for option, value in (("--listen", service.listen), ("--board", service.board)):
        words += [option, value] if value else []
    return words


def word(text: str) -> str:
    """A word or path as a unit has to have it, see systemd.syntax(7); in commands $ is $$ on top of that.

    Raises ConfigError for characters that no unit can have.
    """
    if not text.isprintable():
        raise ConfigError(f"{text!r} has characters that cannot stand in a unit: rename it")
    for character, written in (("\\", "\\\\"), ('"', '\\"'), ("%", "%%")):
        text = text.replace(character, written)
    return f'"{text}"' if re.search(r"[\s'\\;]", text) else text


def check_user(tree: Tree, user: str) -> None:
    """Raises ConfigError for root and for users the machine does not have."""
    if user in ("root", "0") or not NAME.fullmatch(user):
        raise ConfigError(
            f"--user: {user!r} cannot be meant: name the user that the slave is to run as; it needs no root"
        )
    known = [line.partition(":")[0] for line in tree.text("/etc/passwd").splitlines()]
    if known and user not in known:
        raise ConfigError(f"--user: there is no user {user!r} here; make one: sudo useradd --system -G dialout {user}")


def check_permission(tree: Tree, paths: list[str]) -> None:
    """Raises DeviceError unless every one of `paths` can be written, its folders made where they are missing."""
    for path in paths:
        place = tree.path(path)
        while not os.path.exists(place):
            place = os.path.dirname(place) or "."
        if not os.access(place, os.W_OK):
            raise DeviceError(
                f"{path}: no permission to write it; run the same command with sudo (nothing was changed)"
            )


def _can(scenario: Scenario) -> str:
    address = parse_address(scenario.link.port)
    real = address.interface == "socketcan" and not address.place.startswith("vcan")
    return _name(address.place, scenario.link.port) if real else ""


def _name(text: str, where: str) -> str:
    if not NAME.fullmatch(text):
        raise ConfigError(f"{where}: {text!r} cannot stand in a unit or rule: letters, digits, _ . - only")
    return text


def _fill(template: str, values: dict[str, str]) -> str:
    """A file of boards/ with every @name@ replaced; @at@ is an @ itself."""
    with open(os.path.join(preset_folder(FOLDER), template)) as file:
        text = file.read()
    text = re.sub(r"@([a-z_]+)@", lambda found: {"at": "@", **values}[found[1]], text)
    return re.sub(r"[ \t]+$", "", re.sub(r"\n{3,}", "\n\n", text), flags=re.MULTILINE)


def _manifest(tree: Tree) -> dict[str, dict[str, Any]]:
    try:
        notes: dict[str, dict[str, Any]] | None = json.loads(tree.text(MANIFEST) or "null")
    except ValueError:
        raise ConfigError(f"{MANIFEST}: is not what was written there; remove the files by hand") from None
    if notes is None:
        raise ConfigError(f"nothing is installed here: there is no {MANIFEST}")
    return notes


def _read(tree: Tree, path: str) -> str | None:
    try:
        with open(tree.path(path)) as file:
            return file.read()
    except OSError:
        return None


def _put(tree: Tree, path: str, text: str | None) -> None:
    place = tree.path(path)
    if text is None:
        os.remove(place)
        return
    os.makedirs(os.path.dirname(place), exist_ok=True)
    with open(place, "w") as file:
        file.write(text)
    os.chmod(place, 0o644)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
