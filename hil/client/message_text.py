"""Convert messages from and to text: YAML flow style, JSON or TOML in, indented lines out."""

import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from hil.common.errors import ConfigError
from hil.common.schema import shortened
from hil.common.tables import parse_toml

LONGEST = 64  # elements of an array that are shown
MAX_MESSAGES, FEW_MESSAGES = 128, 4  # a longer array of messages is cut to a few
_BARE = re.compile(r"[^,:\[\]{}\"']+")
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}
_WORDS |= {"yes": True, "on": True, "no": False, "off": False}  # as in YAML 1.1, and in ROS's own tools
_NUMBERS = {".nan": "nan", ".inf": "inf", "-.inf": "-inf", "+.inf": "inf"}  # as YAML writes them


def parse_values(text: str) -> dict[str, Any]:
    """Return the fields in `text`: "{linear: {x: 0.5}}", '{"linear": {"x": 0.5}}' or "linear.x = 0.5".

    Raises ConfigError that shows the position of the error.
    """
    stripped = text.strip()
    if not stripped:
        return {}
    if stripped.startswith("{"):
        return _parse_flow(stripped)
    try:
        return parse_toml(stripped)
    except (ValueError, RecursionError) as error:  # ValueError also for a number with thousands of digits
        raise ConfigError(
            f"{shortened(stripped)} is not a message: {error}; write it as '{{linear: {{x: 0.5}}}}'"
        ) from None


def _parse_flow(text: str) -> dict[str, Any]:
    with suppress(ValueError, RecursionError):
        fields: dict[str, Any] = json.loads(text)
        return fields
    import yaml

    try:
        value: dict[str, Any] = _value_of(yaml.compose(text, yaml.BaseLoader))
    except RecursionError:
        raise ConfigError("braces within braces, too deep for any message") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        at = f" at {text[mark.index : mark.index + 20]!r}" if mark else ""
        raise ConfigError(f"{getattr(error, 'problem', None) or error}{at} of {shortened(text)}") from None
    return value


def _value_of(node: Any) -> Any:
    """Return the value of a YAML node; keys are texts, also those that look like numbers or words such as `no`."""
    if isinstance(node.value, str):
        return plain_value(node.value) if node.style is None else node.value
    if node.id == "mapping":
        return {str(key.value): _value_of(value) for key, value in node.value}
    return [_value_of(item) for item in node.value]


def plain_value(word: str) -> Any:
    """Return a word without quotes: a number, true (yes, on), false (no, off), null, or itself."""
    if word.lower() in _WORDS:
        return _WORDS[word.lower()]
    try:
        return int(word, 0)
    except ValueError:
        pass
    try:
        return float(_NUMBERS.get(word.lower(), word))
    except ValueError:
        return word


def lines(message: Mapping[str, Any], indent: str = "") -> list[str]:
    """Return a message as lines of YAML; long arrays are cut short."""
    text_lines = []
    for name, value in message.items():
        if isinstance(value, Mapping):
            text_lines += [f"{indent}{name}:", *lines(value, f"{indent}  ")]
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            text_lines.append(f"{indent}{name}:")
            long = len(value) > MAX_MESSAGES
            for item in value[: FEW_MESSAGES if long else None]:
                first, *others = lines(item, f"{indent}  ")
                text_lines += [f"{indent}- {first.strip()}", *others]
            if long:
                text_lines.append(f"{indent}- ... ({len(value)} in all)")
        else:
            text_lines.append(f"{indent}{name}: {_value_text(value)}")
    return text_lines


def _value_text(value: Any) -> str:
    if isinstance(value, str):
        return value if _BARE.fullmatch(value) and plain_value(value) is value else json.dumps(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Sequence):
        cut = f", ... ({len(value)} in all)" if len(value) > LONGEST else ""
        return f"[{', '.join(map(_value_text, value[:LONGEST]))}{cut}]"
    return str(value)
