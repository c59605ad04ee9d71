"""Convert messages from and to text: YAML flow style, JSON or TOML in, indented lines out."""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from hil.common.errors import ConfigError
from hil.common.schema import shortened

LONGEST = 64  # elements of an array that are shown
MAX_MESSAGES, FEW_MESSAGES = 128, 4  # a longer array of messages is cut to a few
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
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
    from hil.common.tables import parse_toml

    try:
        return parse_toml(stripped)
    except (ValueError, RecursionError) as error:  # ValueError also for a number with thousands of digits
        raise ConfigError(
            f"{shortened(stripped)} is not a message: {error}; write it as '{{linear: {{x: 0.5}}}}'"
        ) from None


def _parse_flow(text: str) -> dict[str, Any]:
    flow = _Flow(text)
    try:
        value = flow.mapping()
    except RecursionError:
        raise ConfigError("braces within braces, too deep for any message") from None
    if flow.unread_text():
        raise flow.error("nothing more was expected")
    return value


class _Flow:
    """Parser of YAML's flow style, which includes JSON."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0

    def error(self, words: str) -> ConfigError:
        """Return an error with its position in the text."""
        return ConfigError(f"{words} at {self._text[self._at : self._at + 20]!r} of {self._text!r}")

    def unread_text(self) -> str:
        """Return the text that has not been read."""
        return self._text[self._at :].strip()

    def mapping(self) -> dict[str, Any]:
        """Return a mapping in braces."""
        fields: dict[str, Any] = {}
        self._expect("{")
        while not self._skip_mark("}"):
            key = self._scalar(plain=True)
            self._expect(":")
            fields[str(key)] = self._value()
            if not self._skip_mark(",") and self._peek() != "}":
                raise self.error("expected , or }")
        return fields

    def _list(self) -> list[Any]:
        items = []
        self._expect("[")
        while not self._skip_mark("]"):
            items.append(self._value())
            if not self._skip_mark(",") and self._peek() != "]":
                raise self.error("expected , or ]")
        return items

    def _value(self) -> Any:
        first = self._peek()
        if first == "{":
            return self.mapping()
        if first == "[":
            return self._list()
        return None if first in ("", ",", "}", "]") else self._scalar()  # an empty value is null

    def _scalar(self, plain: bool = False) -> Any:
        """Return a text in quotes, or a word; with `plain` always a text."""
        first = self._peek()
        if first == '"':
            return self._quoted()
        if first == "'":
            self._at += 1
            end = self._text.find("'", self._at)
            if end < 0:
                raise self.error("no closing '")
            text, self._at = self._text[self._at : end], end + 1
            return text
        word = self._match(_BARE).strip()
        return word if plain else plain_value(word)

    def _quoted(self) -> Any:
        """Return a text in double quotes."""
        start = self._at
        try:
            return json.loads(self._match(_STRING), strict=False)  # a text may have line breaks in it
        except json.JSONDecodeError as error:
            self._at = start
            raise self.error(error.msg) from None

    def _match(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self._text, self._at)
        if match is None:
            raise self.error("expected a value")
        self._at = match.end()
        return match.group()

    def _peek(self) -> str:
        while self._text[self._at : self._at + 1].isspace():
            self._at += 1
        return self._text[self._at : self._at + 1]

    def _skip_mark(self, mark: str) -> bool:
        is_next = self._peek() == mark
        self._at += is_next
        return is_next

    def _expect(self, mark: str) -> None:
        if not self._skip_mark(mark):
            raise self.error(f"expected {mark}")


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
