"""Write files to a machine, and restore its former state.

Everything is planned first, so that it can be shown. A manifest notes what was written, what was there before, and
which folders had to be made for it.
"""

import hashlib
import json
import os
import stat
from collections.abc import Sequence
from contextlib import suppress
from difflib import unified_diff
from typing import Annotated, NamedTuple

from boards.tree import Tree
from hil.common.errors import ConfigError, DeviceError
from hil.common.schema import Range, parse

MANIFEST = "/etc/uuv-hil/installed.json"  # not in /var/lib: the service's user could write there what root deletes
MODE = 0o644
SAME = (-1, -1)  # for chown(2): the owner does not change
TEMPORARY_SUFFIX = ".new"  # an ending that none of those who read these folders looks for


class Change(NamedTuple):
    """One file: where, what it is to hold (None: it goes), what it holds now (None: it is not there), and whose it is.

    `owner`: numbers of user and group.
    """

    path: str
    after: str | None
    before: str | None
    mode: int = MODE
    owner: tuple[int, int] = SAME


class ManifestEntry(NamedTuple):
    """Entry of a file in the manifest: what was written, what was `before`, and folders that were made for it."""

    sha256: str
    before: str | None = None
    folders: tuple[str, ...] = ()
    mode: Annotated[int, Range(0, 0o7777)] = MODE
    owner: tuple[int, int] = SAME


class Plan(NamedTuple):
    """Changes to make: files to be `written`, and files to be restored or `removed`.

    `changed` are the paths of what somebody has changed since it was written: they stay.
    """

    written: tuple[Change, ...] = ()
    removed: tuple[Change, ...] = ()
    changed: tuple[str, ...] = ()

    @property
    def changes(self) -> tuple[Change, ...]:
        """All changes, in order."""
        return self.written + self.removed


def plan_install(tree: Tree, texts: dict[str, str]) -> Plan:
    """Return the files that are missing or differ, and those of an installation before that are not needed any more.

    `texts`: path -> what it is to hold. Raises ConfigError when one is a link, for instance of a masked unit, or cannot
    be a file.
    """
    for path in (*texts, MANIFEST):
        if os.path.islink(tree.entry(path)):
            raise ConfigError(f"{path}: is a link to {tree.link(path)}; take that away first")
        _check_folder(tree, path)
    written = [Change(path, text, _read(tree, path)) for path, text in sorted(texts.items())]
    earlier = _plan_removal(tree, _manifest(tree) or {})
    return Plan(
        tuple(change for change in written if change.after != change.before),
        tuple(change for change in earlier.removed if change.path not in texts),
        tuple(path for path in earlier.changed if path not in texts),
    )


def plan_uninstall(tree: Tree) -> Plan:
    """Return the changes that remove all files of the manifest. Raises ConfigError when nothing is installed."""
    entries = _manifest(tree)
    if entries is None:
        raise ConfigError(f"nothing is installed here: there is no {MANIFEST}")
    return _plan_removal(tree, entries)


def show(change: Change) -> str:
    """Return a change as a unified diff."""
    (old_name, old), (new_name, new) = (
        (change.path, text.splitlines()) if text is not None else ("/dev/null", [])
        for text in (change.before, change.after)
    )
    text = "\n".join(unified_diff(old, new, old_name, new_name, lineterm=""))
    return text.encode(errors="surrogateescape").decode(errors="replace")  # what is no UTF-8 cannot be printed


def carry_out(tree: Tree, plan: Plan) -> None:
    """Write and remove the files. Call `check_permission` before. Raises DeviceError when a file cannot be written."""
    entries = _manifest(tree) or {}
    done = dict(entries)
    for change in plan.written:
        # what was there before is that of the first time
        first = entries.get(change.path) or _manifest_entry(tree, change)
        done[change.path] = first._replace(sha256=_digest(change.after or ""))
    folders = {os.path.dirname(MANIFEST), *(folder for entry in done.values() for folder in entry.folders)}
    try:
        record = [_record(done)] if plan.written else []
        _put(tree, [*record, *plan.changes])  # the record first: what follows can be undone
        left = {path: entry for path, entry in done.items() if _read(tree, path) != entry.before}
        if left != done or not left:
            with suppress(DeviceError):  # a record that names too much does no harm
                _put(tree, [_record(left)])
    finally:
        for folder in sorted(folders, key=len, reverse=True):
            with suppress(OSError):  # something is in it
                os.rmdir(tree.path(folder))


def check_permission(tree: Tree, plan: Plan) -> None:
    """Check that all files can be written and missing folders made. Raises DeviceError."""
    for path in (*(change.path for change in plan.changes), MANIFEST):
        place = tree.path(path)
        while not os.path.exists(place):
            place = os.path.dirname(place) or "."
        if not os.access(place, os.W_OK):
            raise DeviceError(
                f"{path}: no permission to write it; run the same command with sudo (nothing was changed)"
            )


def _plan_removal(tree: Tree, entries: dict[str, ManifestEntry]) -> Plan:
    removed, changed = [], []
    for path, entry in entries.items():
        now = _read(tree, path)
        if now == entry.before:
            continue  # never written, as the installation ended before; or somebody put it back
        if now is None or _digest(now) == entry.sha256:
            removed.append(Change(path, entry.before, now, entry.mode, entry.owner))
        else:
            changed.append(path)
    return Plan(removed=tuple(removed), changed=tuple(changed))


def _check_folder(tree: Tree, path: str) -> None:
    """Check that the folder of a file exists or can be made. Raises ConfigError."""
    folder = os.path.dirname(path)
    while not os.path.lexists(tree.entry(folder)):
        folder = os.path.dirname(folder)
    if not os.path.isdir(tree.path(folder)):
        raise ConfigError(f"{folder}: is no folder, where {path} belongs; take it away first")


def _manifest_entry(tree: Tree, change: Change) -> ManifestEntry:
    """Return the manifest's entry of a file that is written for the first time."""
    entry = ManifestEntry("", change.before, tuple(_missing_folders(tree, change.path)))
    if change.before is None:
        return entry
    status = os.stat(tree.path(change.path))
    return entry._replace(mode=stat.S_IMODE(status.st_mode), owner=(status.st_uid, status.st_gid))


def _missing_folders(tree: Tree, path: str) -> list[str]:
    folder, missing = os.path.dirname(path), []
    while not tree.exists(folder):
        missing.append(folder)
        folder = os.path.dirname(folder)
    return missing


def _manifest(tree: Tree) -> dict[str, ManifestEntry] | None:
    """Return what is installed; None if there is no manifest.

    Raises ConfigError when it is not what was written there.
    """
    text = _read(tree, MANIFEST)
    if text is None:
        return None
    try:
        table = json.loads(text)
        values = {
            path: {key: value for key, value in entry.items() if value is not None} for path, entry in table.items()
        }
        return {path: parse(entry, ManifestEntry, MANIFEST) for path, entry in values.items()}
    except (ValueError, AttributeError, ConfigError):
        remedy = "remove it, and the files that this finds: grep -rl 'uuv-hil board install' /etc"
        raise ConfigError(f"{MANIFEST}: is not what was written there; {remedy}") from None


def _record(entries: dict[str, ManifestEntry]) -> Change:
    """Return the manifest, for nobody to read who could not read what it says was there before."""
    text = json.dumps({path: entry._asdict() for path, entry in entries.items()}, indent=1, sort_keys=True) + "\n"
    mode = MODE
    for entry in entries.values():
        mode &= entry.mode | 0o600
    return Change(MANIFEST, text if entries else None, None, mode)


def _read(tree: Tree, path: str) -> str | None:
    """Return a file to the byte, whatever encoding it is in; None if it is not there.

    Raises HilError when it is no file.
    """
    place = tree.path(path)
    if not os.path.exists(place):
        return None
    if not os.path.isfile(place):
        raise ConfigError(f"{path}: is no file, and one belongs there; take it away first")
    try:
        with open(place, newline="", errors="surrogateescape", encoding="utf-8") as file:
            return file.read()
    except OSError as error:
        raise DeviceError(f"{path}: {error.strerror}; run the same command with sudo") from None


def _put(tree: Tree, changes: Sequence[Change]) -> None:
    """Write all files beside their places, then rename them: a full disk leaves all as it was.

    Raises DeviceError.
    """
    try:
        for change in changes:
            _write_temporary(tree, change)
        for change in changes:
            place = tree.entry(change.path)
            if change.after is not None:
                os.replace(place + TEMPORARY_SUFFIX, place)
            elif os.path.lexists(place):
                os.remove(place)
    except OSError as error:
        text = f"{change.path}: cannot be written: {error.strerror}"
        raise DeviceError(f"{text}; mend that and run the same command again") from None
    finally:
        for change in changes:
            with suppress(OSError):  # it is in its place
                os.remove(tree.entry(change.path) + TEMPORARY_SUFFIX)


def _write_temporary(tree: Tree, change: Change) -> None:
    if change.after is None:
        return
    temporary = tree.entry(change.path) + TEMPORARY_SUFFIX
    os.makedirs(os.path.dirname(temporary), exist_ok=True)
    with open(temporary, "w", newline="", errors="surrogateescape", encoding="utf-8") as file:
        with suppress(PermissionError):  # only root can give files away
            os.chown(temporary, *change.owner)
        os.chmod(temporary, change.mode)
        file.write(change.after)
        file.flush()
        os.fsync(file.fileno())


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()
