"""The code blocks in README.md and docs."""

import ast
import re
import textwrap
from pathlib import Path
from typing import NamedTuple

from hil.common.tables import parse_toml

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_COMMAND = re.compile(r"^(?:\S*/)?uuv-hil (.*)$")


class Block(NamedTuple):
    """One block: its page, its line, its language ("python", "toml", "shell" or "text"), and its text.

    `before` is the text of the page up to it.
    """

    page: str
    line: int
    language: str
    text: str
    before: str

    @property
    def file(self) -> str:
        """The file name that the text before the block gives."""
        found = re.findall(r"`(\w+\.(?:py|toml))`:?\s*$", self.before.rstrip())
        return found[-1] if found else ""


def blocks(*languages: str, page: Path | None = None) -> list[Block]:
    """Return all blocks in these languages, of one page or of all."""
    pages = [page] if page else PAGES
    return [block for each in pages for block in _blocks(each) if block.language in languages]


def _blocks(path: Path) -> list[Block]:
    lines = path.read_text().split("\n")
    result, number = [], 0
    while number < len(lines):
        begin, language = number, ""
        if lines[number].startswith("```"):
            language = lines[number][3:].strip()
            number = next(end for end in range(number + 1, len(lines)) if lines[end].startswith("```"))
            text = "\n".join(lines[begin + 1 : number])
        elif lines[number].startswith("    ") and not lines[number - 1].strip():
            while number < len(lines) and (lines[number].startswith("    ") or not lines[number].strip()):
                number += 1
            text = textwrap.dedent("\n".join(lines[begin:number])).strip("\n")
        else:
            number += 1
            continue
        number += 1
        before = "\n".join(lines[:begin])
        result.append(
            Block(path.relative_to(ROOT).as_posix(), begin + 1, language or _guess(text), text + "\n", before)
        )
    return result


def _guess(text: str) -> str:
    if any(_COMMAND.match(line) for line in text.splitlines()):
        return "shell"
    if re.match(r"(import|from) \w", text):
        ast.parse(text)
        return "python"
    try:
        return "toml" if parse_toml(text) else "text"
    except ValueError:
        return "text"


def commands() -> list[tuple[str, str]]:
    """Yield the line of each `uuv-hil ...` of a shell block, and its arguments without comments and continuations."""
    command_lines = []
    for block in blocks("shell"):
        for line in block.text.replace("\\\n", " ").splitlines():
            match = _COMMAND.match(re.sub(r"\s#\s.*$", "", line).strip().removesuffix("&").strip())
            if match:
                command_lines.append((f"{block.page}:{block.line}", match[1]))
    return command_lines
