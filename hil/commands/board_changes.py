"""Files of a machine that are written and taken away again, as they were.

Everything is planned first, so that it can be shown. A manifest notes what was written, what was there before, and
which folders had to be made for it.
"""

import hashlib
import json
import os
from contextlib import suppress
from difflib import unified_diff
from typing import Any, NamedTuple

from boards.tree import Tree
from hil.errors import ConfigError, DeviceError

MANIFEST = "/etc/uuv-hil/installed.json"  # not in /var/lib: the service's user could write there what root deletes


class Change(NamedTuple):
    """One file: where, what it is to hold (None: it goes), and what it holds now (None: it is not there)."""

    path: str
    after: str | None
    before: str | None


class Plan(NamedTuple):
    """What is to be done: files to be `written`, files of before to be put back or `removed`.

    `changed` are the paths of what somebody has changed since it was written: they stay.
    """

    written: tuple[Change, ...] = ()
    removed: tuple[Change, ...] = ()
    changed: tuple[str, ...] = ()

    @property
    def changes(self) -> tuple[Change, ...]:
        """All of them."""
        return self.written + self.removed


def plan_install(tree: Tree, texts: dict[str, str]) -> Plan:
    """The files that are missing or differ, and those of an installation before that are not needed any more.

    `texts`: path -> what it is to hold. Raises ConfigError when one is a link, for instance of a masked unit.
    """
    for path in texts:
        if os.path.islink(tree.entry(path)):
            raise ConfigError(f"{path}: is a link to {tree.link(path)}; take that away first")
    written = [Change(path, text, _read(tree, path)) for path, text in sorted(texts.items())]
    earlier = plan_uninstall(tree) if tree.exists(MANIFEST) else Plan()
    return Plan(
        tuple(change for change in written if change.after != change.before),
        tuple(change for change in earlier.removed if change.path not in texts),
        tuple(path for path in earlier.changed if path not in texts),
    )


def plan_uninstall(tree: Tree) -> Plan:
    """What takes away all that the manifest names. Raises ConfigError when nothing is installed."""
    removed, changed = [], []
    for path, note in _manifest(tree).items():
        now = _read(tree, path)
        if now is None:
            continue
        if _digest(now) == note["sha256"]:
            removed.append(Change(path, note["before"], now))
        else:
            changed.append(path)
    return Plan(removed=tuple(removed), changed=tuple(changed))


def show(change: Change) -> str:
    """A change as a unified diff."""
    (old_name, old), (new_name, new) = (
        (change.path, text.splitlines()) if text is not None else ("/dev/null", [])
        for text in (change.before, change.after)
    )
    text = "\n".join(unified_diff(old, new, old_name, new_name, lineterm=""))
    return text.encode(errors="surrogateescape").decode(errors="replace")  # what is no UTF-8 cannot be printed


def carry_out(tree: Tree, plan: Plan) -> None:
    """Do it. Call `check_permission` before."""
    notes = _manifest(tree) if tree.exists(MANIFEST) else {}
    done = notes | {change.path: _note(tree, change, notes.get(change.path)) for change in plan.written}
    folders = [folder for note in done.values() for folder in note.get("folders", ())]
    if plan.written:
        _put(tree, MANIFEST, _json(done))  # first: what follows can be undone
    for change in plan.changes:
        _put(tree, change.path, change.after)
    gone = {change.path for change in plan.removed}
    left = {path: note for path, note in done.items() if path not in gone and tree.exists(path)}
    _put(tree, MANIFEST, _json(left) if left else None)
    for folder in sorted({*folders, os.path.dirname(MANIFEST)}, key=len, reverse=True):
        with suppress(OSError):  # something is in it
            os.rmdir(tree.path(folder))


def check_permission(tree: Tree, plan: Plan) -> None:
    """Raises DeviceError unless all can be written, folders made where they are missing."""
    for path in (*(change.path for change in plan.changes), MANIFEST):
        place = tree.path(path)
        while not os.path.exists(place):
            place = os.path.dirname(place) or "."
        if not os.access(place, os.W_OK):
            raise DeviceError(
                f"{path}: no permission to write it; run the same command with sudo (nothing was changed)"
            )


def _note(tree: Tree, change: Change, earlier: dict[str, Any] | None) -> dict[str, Any]:
    """What the manifest says of a file that is written; what was there before is that of the first time."""
    first = earlier or {"before": change.before, "folders": _missing_folders(tree, change.path)}
    return {**first, "sha256": _digest(change.after or "")}


def _missing_folders(tree: Tree, path: str) -> list[str]:
    folder, missing = os.path.dirname(path), []
    while not tree.exists(folder):
        missing.append(folder)
        folder = os.path.dirname(folder)
    return missing


def _manifest(tree: Tree) -> dict[str, dict[str, Any]]:
    try:
        notes: dict[str, dict[str, Any]] | None = json.loads(tree.text(MANIFEST) or "null")
    except ValueError:
        raise ConfigError(f"{MANIFEST}: is not what was written there; remove the files by hand") from None
    if notes is None:
        raise ConfigError(f"nothing is installed here: there is no {MANIFEST}")
    return notes


def _json(notes: dict[str, dict[str, Any]]) -> str:
    return json.dumps(notes, indent=1, sort_keys=True) + "\n"


def _read(tree: Tree, path: str) -> str | None:
    """A file to the byte, whatever encoding it is in."""
    try:
        with open(tree.path(path), newline="", errors="surrogateescape") as file:
            return file.read()
    except OSError:
        return None


def _put(tree: Tree, path: str, text: str | None) -> None:
    place = tree.entry(path)
    if text is None:
        with suppress(FileNotFoundError):
            os.remove(place)
        return
    os.makedirs(os.path.dirname(place), exist_ok=True)
    with open(place, "w", newline="", errors="surrogateescape") as file:
        file.write(text)
    os.chmod(place, 0o644)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()
