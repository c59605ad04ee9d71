"""Text for terminals, logs and other programs: without control characters, of limited length, as JSON or TOML."""

import re
from collections.abc import Callable
from math import isfinite
from typing import Any

from hil.common.errors import ConfigError

LONGEST = 200  # characters of one name or value from somebody else in a line
ELLIPSIS = "..."


def clean(text: str, most: int = LONGEST) -> str:
    """Return `text` on one line, cut to `most` characters, with "?" for characters that do not print."""
    if len(text) > most:
        text = text[: most - len(ELLIPSIS)] + ELLIPSIS
    return text if text.isprintable() else "".join([c if c.isprintable() else "?" for c in text])


def json_text(value: Any, indent: int | None = None) -> str:
    """Return a value as JSON text: tuples as arrays, bytes in hexadecimal, nan and inf as null."""
    import json

    return json.dumps(json_value(value), indent=indent)


def json_value(value: Any) -> Any:
    """Return a value converted to JSON types, for `json_text` and for further processing."""
    if isinstance(value, dict):
        return {str(key): json_value(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [json_value(item) for item in value]
    if isinstance(value, bytes):
        return value.hex()
    return value if not isinstance(value, float) or isfinite(value) else None


def toml_text(value: Any, number: Callable[[float], str] = repr) -> str:
    """Return a value as TOML text, a matrix in rows; `number` converts floats to text.

    Raises ConfigError for a value that TOML cannot express.
    """
    if isinstance(value, str):
        plain = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in plain) + '"'
    if isinstance(value, dict):
        return "{" + ", ".join(f"{toml_key(key)} = {toml_text(item, number)}" for key, item in value.items()) + "}"
    if isinstance(value, (tuple, list)):
        items = [toml_text(item, number) for item in value]
        if len(items) not in (9, 36) or not isinstance(value[0], float):
            return f"[{', '.join(items)}]"
        size = 3 if len(items) == 9 else 6
        rows = [", ".join(items[start : start + size]) for start in range(0, len(items), size)]
        return "[\n  " + ",\n  ".join(rows) + ",\n]"
    if isinstance(value, (bool, int)):
        return str(value).lower()
    try:
        return number(float(value))
    except (TypeError, ValueError):
        raise ConfigError(f"{value!r} cannot be written as TOML") from None


def toml_key(key: str) -> str:
    """Return a key as TOML text, in quotes if it has to be."""
    return key if key.isascii() and key.replace("_", "").replace("-", "").isalnum() else toml_text(key)


def wrap_command(line: str, width: int) -> list[str]:
    """Return a line "command   remark" as lines of at most `width` characters, with the same meaning to a shell."""
    if len(line) <= width or not line.strip():
        return [line]
    _, indent, command, remark = re.split(r"^( *)(\S+(?: \S+)*)(?:  +)?", line, maxsplit=1)
    lines = [indent]
    for word in re.findall(r"(?:'[^']*'|\"[^\"]*\"|[^ '\"])+", command):
        if len(lines[-1]) + len(word) + 2 > width and lines[-1].strip():
            lines[-1] += "\\"
            lines.append(f"{indent}    ")
        lines[-1] += f"{word} "
    from textwrap import wrap  # by few commands

    begin = f"{indent}    # "
    about = wrap(remark, width, initial_indent=begin, subsequent_indent=begin, break_long_words=False)
    return [piece.rstrip() for piece in lines] + about
