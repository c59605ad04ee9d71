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

# Root deletes what the manifest names, so it is not in a folder of the service's user, such as /var/lib/uuv-hil.
MANIFEST = "/etc/uuv-hil/installed.json"
MODE = 0o644
SAME_OWNER = (-1, -1)  # for chown(2): the owner does not change
TEMPORARY_SUFFIX = ".new"  # programs that read these folders ignore files with this suffix


class Change(NamedTuple):
    """Change of one file: its path, its new content `after` (None: remove it), its content `before` (None: no file).

    `owner`: numbers of user and group.
    """

    path: str
    after: str | None
    before: str | None
    mode: int = MODE
    owner: tuple[int, int] = SAME_OWNER


class ManifestEntry(NamedTuple):
    """Entry of a file in the manifest: hash of the new content, content `before`, folders that were made for it."""

    sha256: str
    before: str | None = None
    folders: tuple[str, ...] = ()
    mode: Annotated[int, Range(0, 0o7777)] = MODE
    owner: tuple[int, int] = SAME_OWNER


class Plan(NamedTuple):
    """Changes to make: files to be `written`, and files to be restored or `removed`.

    `changed` are the paths of files that were edited after the installation; they are not touched.
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
            raise ConfigError(f"{path}: is a link to {tree.link(path)}; remove it first")
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
        raise ConfigError(f"nothing is installed on this machine: there is no {MANIFEST}")
    return _plan_removal(tree, entries)


def to_diff(change: Change) -> str:
    """Return a change as a unified diff."""
    (old_name, old), (new_name, new) = (
        (change.path, text.splitlines()) if text is not None else ("/dev/null", [])
        for text in (change.before, change.after)
    )
    text = "\n".join(unified_diff(old, new, old_name, new_name, lineterm=""))
    return text.encode(errors="surrogateescape").decode(errors="replace")  # bytes that are not UTF-8 cannot be printed


def apply_plan(tree: Tree, plan: Plan) -> None:
    """Write and remove the files. Call `check_permission` before. Raises DeviceError when a file cannot be written."""
    entries = _manifest(tree) or {}
    merged = dict(entries)
    for change in plan.written:
        # The former content is that before the first installation.
        first = entries.get(change.path) or _manifest_entry(tree, change)
        merged[change.path] = first._replace(sha256=_digest(change.after or ""))
    folders = {os.path.dirname(MANIFEST), *(folder for entry in merged.values() for folder in entry.folders)}
    try:
        manifest = [_manifest_change(merged)] if plan.written else []
        _write_files(tree, [*manifest, *plan.changes])  # the manifest first: it is needed to undo the rest
        remaining = {path: entry for path, entry in merged.items() if _read(tree, path) != entry.before}
        if remaining != merged or not remaining:
            with suppress(DeviceError):  # a manifest with too many entries does no harm
                _write_files(tree, [_manifest_change(remaining)])
    finally:
        for folder in sorted(folders, key=len, reverse=True):
            with suppress(OSError):  # the folder is not empty
                os.rmdir(tree.path(folder))


def check_permission(tree: Tree, plan: Plan) -> None:
    """Check that all files can be written and missing folders made. Raises DeviceError."""
    for path in (*(change.path for change in plan.changes), MANIFEST):
        existing = tree.path(path)
        while not os.path.exists(existing):
            existing = os.path.dirname(existing) or "."
        if not os.access(existing, os.W_OK):
            raise DeviceError(
                f"{path}: no permission to write it; run the same command with sudo (nothing was changed)"
            )


def _plan_removal(tree: Tree, entries: dict[str, ManifestEntry]) -> Plan:
    removed, changed = [], []
    for path, entry in entries.items():
        content = _read(tree, path)
        if content == entry.before:
            continue  # never written, because the installation was interrupted, or restored by hand
        if content is None or _digest(content) == entry.sha256:
            removed.append(Change(path, entry.before, content, entry.mode, entry.owner))
        else:
            changed.append(path)
    return Plan(removed=tuple(removed), changed=tuple(changed))


def _check_folder(tree: Tree, path: str) -> None:
    """Check that the folder of a file exists or can be made. Raises ConfigError."""
    folder = os.path.dirname(path)
    while not os.path.lexists(tree.entry(folder)):
        folder = os.path.dirname(folder)
    if not os.path.isdir(tree.path(folder)):
        raise ConfigError(f"{folder}: is not a folder, but {path} belongs into it; remove it first")


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
        raise ConfigError(f"{MANIFEST}: is damaged; {remedy}") from None


def _manifest_change(entries: dict[str, ManifestEntry]) -> Change:
    """Return the manifest as a change. It may be read only by users who could read all former files."""
    text = json.dumps({path: entry._asdict() for path, entry in entries.items()}, indent=1, sort_keys=True) + "\n"
    mode = MODE
    for entry in entries.values():
        mode &= entry.mode | 0o600
    return Change(MANIFEST, text if entries else None, None, mode)


def _read(tree: Tree, path: str) -> str | None:
    """Return the content of a file; None if there is no file. Bytes that are not UTF-8 are preserved.

    Raises ConfigError if it is not a regular file, DeviceError if it cannot be read.
    """
    real_path = tree.path(path)
    if not os.path.exists(real_path):
        return None
    if not os.path.isfile(real_path):
        raise ConfigError(f"{path}: is not a regular file; remove it first")
    try:
        with open(real_path, newline="", errors="surrogateescape", encoding="utf-8") as file:
            return file.read()
    except OSError as error:
        raise DeviceError(f"{path}: {error.strerror}; run the same command with sudo") from None


def _write_files(tree: Tree, changes: Sequence[Change]) -> None:
    """Write all files under temporary names, then rename them, so that a full disk changes nothing.

    Raises DeviceError.
    """
    try:
        for change in changes:
            _write_temporary(tree, change)
        for change in changes:
            real_path = tree.entry(change.path)
            if change.after is not None:
                os.replace(real_path + TEMPORARY_SUFFIX, real_path)
            elif os.path.lexists(real_path):
                os.remove(real_path)
    except OSError as error:
        text = f"{change.path}: cannot be written: {error.strerror}"
        raise DeviceError(f"{text}; correct this and run the same command again") from None
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
