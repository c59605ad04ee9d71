"""Write the files of an installation to a machine, and remove them.

All changes are planned first, so that they can be shown. Each file begins with `MARK`, by which the next installation
and an uninstallation find it. A file without it is not ours, and is never touched.
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from difflib import unified_diff
from typing import NamedTuple

from boards.tree import Tree
from hil.common.errors import ConfigError, DeviceError

MARK = "# Written by `uuv-hil board install`; `uuv-hil board uninstall` removes it.\n"
OWN_FOLDER = "/etc/uuv-hil"
FOLDERS = (
    "/etc/systemd/system", "/etc/udev/rules.d", "/etc/security/limits.d", "/etc/NetworkManager/conf.d", OWN_FOLDER,
)  # fmt: skip
TEMPORARY_SUFFIX = ".new"  # programs that read these folders ignore files with this suffix


class Change(NamedTuple):
    """Change of one file: its path, its new content `after` (None: remove it), its content `before` (None: no file)."""

    path: str
    after: str | None
    before: str | None


def plan_install(tree: Tree, texts: dict[str, str]) -> list[Change]:
    """Return the files to write, then those of an earlier installation to remove.

    `texts`: path -> content. Raises ConfigError if a path is a link, such as that of a masked unit, cannot be a file,
    or is a file of somebody else.
    """
    there = _installed(tree)
    for path in texts:
        _check_place(tree, path, path in there)
    written = [Change(path, text, there.get(path)) for path, text in sorted(texts.items()) if text != there.get(path)]
    return written + [Change(path, None, text) for path, text in there.items() if path not in texts]


def plan_uninstall(tree: Tree) -> list[Change]:
    """Return the changes that remove all installed files. Raises ConfigError if nothing is installed."""
    there = _installed(tree)
    if not there:
        raise ConfigError("nothing is installed on this machine: no file begins with the mark of `board install`")
    return [Change(path, None, text) for path, text in there.items()]


def to_diff(change: Change) -> str:
    """Return a change as a unified diff."""
    (old_name, old), (new_name, new) = (
        (change.path, text.splitlines()) if text is not None else ("/dev/null", [])
        for text in (change.before, change.after)
    )
    return "\n".join(unified_diff(old, new, old_name, new_name, lineterm=""))


def apply_changes(tree: Tree, changes: Sequence[Change]) -> None:
    """Write all files under temporary names, then rename them, so that a full disk changes nothing; remove the others.

    Call `check_permission` before. Raises DeviceError.
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
        with suppress(OSError):  # it is not there, or not empty
            os.rmdir(tree.path(OWN_FOLDER))


def check_permission(tree: Tree, changes: Sequence[Change]) -> None:
    """Check that all files can be written and missing folders made. Raises DeviceError."""
    for change in changes:
        folder = os.path.dirname(change.path)
        while not tree.exists(folder):
            folder = os.path.dirname(folder)
        if not os.access(tree.path(folder), os.W_OK):
            raise DeviceError(
                f"{change.path}: no permission to write it; run the same command with sudo (nothing was changed)"
            )


def _installed(tree: Tree) -> dict[str, str]:
    """Return path -> content of the files that begin with `MARK`. Raises DeviceError if one cannot be read."""
    found = {}
    for path in [f"{folder}/{name}" for folder in FOLDERS for name in tree.names(folder)]:
        real_path = tree.entry(path)
        if "uuv-hil" not in path or os.path.islink(real_path) or not os.path.isfile(real_path):
            continue
        try:
            with open(real_path, newline="", errors="replace", encoding="utf-8") as file:
                text = file.read()
        except OSError as error:
            raise DeviceError(f"{path}: {error.strerror}; run the same command with sudo") from None
        if text.startswith(MARK):
            found[path] = text
    return found


def _check_place(tree: Tree, path: str, is_ours: bool) -> None:
    """Check that there is a place for a file, and none of somebody else in it. Raises ConfigError."""
    if os.path.islink(tree.entry(path)):
        raise ConfigError(f"{path}: is a link to {tree.link(path)}; remove it first")
    if tree.exists(path) and not is_ours:
        raise ConfigError(f"{path}: was not written by `uuv-hil board install`; remove it first")
    folder = os.path.dirname(path)
    while not os.path.lexists(tree.entry(folder)):
        folder = os.path.dirname(folder)
    if not os.path.isdir(tree.path(folder)):
        raise ConfigError(f"{folder}: is not a folder, but {path} belongs into it; remove it first")


def _write_temporary(tree: Tree, change: Change) -> None:
    if change.after is None:
        return
    temporary = tree.entry(change.path) + TEMPORARY_SUFFIX
    os.makedirs(os.path.dirname(temporary), exist_ok=True)
    with open(temporary, "w", newline="", encoding="utf-8") as file:
        os.chmod(temporary, 0o644)
        file.write(change.after)
        file.flush()
        os.fsync(file.fileno())
