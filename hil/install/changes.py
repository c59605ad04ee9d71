"""Write files to a machine, and restore its former state.

All changes are planned first, so that they can be shown. A manifest stores which files were written, their former
contents, and the folders that were made for them.
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
TEMPORARY_SUFFIX = ".new"  # programs that read these folders ignore files with this suffix


class Change(NamedTuple):
    """Change of one file: its path, its new content `after` (None: remove it), its content `before` (None: no file).

    `owner`: numbers of user and group.
    """

    path: str
    after: str | None
    before: str | None
    mode: int = MODE
    owner: tuple[int, int] = SAME


class ManifestEntry(NamedTuple):
    """Entry of a file in the manifest: hash of the new content, content `before`, folders that were made for it."""

    sha256: str
    before: str | None = None
    folders: tuple[str, ...] = ()
    mode: Annotated[int, Range(0, 0o7777)] = MODE
    owner: tuple[int, int] = SAME


class Plan(NamedTuple):
    """Changes to make: files to be `written`, and files to be restored or `removed`.

    `changed` are the paths of files that somebody has changed since the installation; they are left alone.
    """

    written: tuple[Change, ...] = ()
    removed: tuple[Change, ...] = ()
    changed: tuple[str, ...] = ()

    @property
    def changes(self) -> tuple[Change, ...]:
        """All changes, in order."""
        return self.written + self.removed


def plan_install(tree: Tree, texts: dict[str, str]) -> Plan:
    """Return the files to write, and those of an earlier installation that are no longer needed.

    `texts`: path -> content. Raises ConfigError if a path is a link, such as that of a masked unit, or cannot be a
    file.
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
    """Return the changes that remove all files of the manifest. Raises ConfigError if nothing is installed."""
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
    return text.encode(errors="surrogateescape").decode(errors="replace")  # bytes that are not UTF-8 cannot be printed


def carry_out(tree: Tree, plan: Plan) -> None:
    """Write and remove the files. Call `check_permission` before. Raises DeviceError when a file cannot be written."""
    entries = _manifest(tree) or {}
    done = dict(entries)
    for change in plan.written:
        # the former content is the one before the first installation
        first = entries.get(change.path) or _manifest_entry(tree, change)
        done[change.path] = first._replace(sha256=_digest(change.after or ""))
    folders = {os.path.dirname(MANIFEST), *(folder for entry in done.values() for folder in entry.folders)}
    try:
        record = [_record(done)] if plan.written else []
        _put(tree, [*record, *plan.changes])  # the manifest first, so that the other changes can be undone
        left = {path: entry for path, entry in done.items() if _read(tree, path) != entry.before}
        if left != done or not left:
            with suppress(DeviceError):  # a manifest with too many entries does no harm
                _put(tree, [_record(left)])
    finally:
        for folder in sorted(folders, key=len, reverse=True):
            with suppress(OSError):  # the folder is not empty
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
            continue  # never written, because the installation was interrupted, or restored by hand
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
    """Return the entries of the manifest; None if there is none.

    Raises ConfigError if it is damaged.
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
    """Return the manifest as a change. Only users who could read all former files may read it."""
    text = json.dumps({path: entry._asdict() for path, entry in entries.items()}, indent=1, sort_keys=True) + "\n"
    mode = MODE
    for entry in entries.values():
        mode &= entry.mode | 0o600
    return Change(MANIFEST, text if entries else None, None, mode)


def _read(tree: Tree, path: str) -> str | None:
    """Return the content of a file, in any encoding without loss; None if there is no file.

    Raises ConfigError if it is no regular file, DeviceError if it cannot be read.
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
    """Write all files under temporary names, then rename them. So a full disk changes nothing.

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
            with suppress(OSError):  # it was renamed
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
