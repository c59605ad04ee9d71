"""The words of the code: names use the terms of the field, and docstrings state what a thing is or does."""

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import PurePath

from tools.pages.rooms import ROOT

METAPHORS = {
    "anew", "befell", "berth", "breath", "crowd", "errand", "errands", "inbox", "misfit", "outbox", "reckon",
    "reckoned", "stranger", "strangers", "telegram", "visitor",
}  # fmt: skip
# Good in the sentence that is a test's name, but too vague for what a function does or a variable holds.
VAGUE = {
    "beside", "eases", "fate", "gone", "hear", "heard", "kept", "news", "obey", "obeyed", "obeys", "said", "say",
    "says", "sea", "tell", "tells", "told", "unheard", "unspoken", "whoever", "whom", "whose",
}  # fmt: skip
SPOKEN = {"hear", "heard", "said", "told", "unheard"}  # of these, what no helper or variable of a test is named
WITH_OBJECT = {"keep", "look", "note", "take"}  # verbs that say too little alone
FILE_METHODS = {("hil/recording/mcap_file.py", "tell"), ("hil/recording/mcap_writer.py", "tell")}  # of Python's files


# A vehicle is lost or does not answer; it executes commands.
PERSONIFIED = re.compile(r"\b(?:is|are|was|were) gone\b|\bobey")
# A docstring that begins so is a fragment ("Whether it is there", "Of a thruster"): no statement, or no verb.
FRAGMENTS = {
    "And", "As", "How", "If", "Of", "So", "Such", "That", "Those", "What", "When", "Where", "Whether", "Which", "Who",
    "Why",
}  # fmt: skip
# The docstring of a test says what holds, and so begins with its subject, not with circumstances ("On 25 maps").
CIRCUMSTANCES = {
    "About", "Above", "Across", "After", "Against", "Along", "Also", "At", "Before", "Behind", "Below", "Beneath",
    "Beside", "Between", "Beyond", "But", "By", "During", "For", "From", "However", "In", "Inside", "On", "Once", "Or",
    "Otherwise", "Outside", "Over", "Since", "Through", "To", "Twice", "Under", "Until", "Whatever", "Wherever",
    "Whether", "While", "With", "Within", "Without",
}  # fmt: skip


@functools.cache
def _definitions(room: str) -> dict[str, list[ast.AST]]:
    """Return the nodes of each file of a room that define names, may have a docstring, or are constants."""
    kinds = (
        ast.Module, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.arg, ast.Name, ast.Attribute, ast.Constant
    )  # fmt: skip
    return {
        path.relative_to(ROOT).as_posix(): [
            node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, kinds)
        ]
        for path in sorted((ROOT / room).rglob("*.py"))
    }


def _names(nodes: list[ast.AST]) -> Iterator[tuple[bool, str]]:
    """Yield each name that is defined, and whether it is that of a function."""
    for node in nodes:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield not isinstance(node, ast.ClassDef), node.name
        elif isinstance(node, ast.arg):
            yield False, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield False, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield False, node.attr


@functools.cache
def _words(name: str) -> set[str]:
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+", name)}


def test_names_have_no_metaphors_and_vague_words() -> None:
    """The rule is for files, classes, functions, arguments, variables and attributes; tests may have vague words."""
    violations = []
    for room in ("hil", "sim", "boards", "firmware_stub", "tools", "tests"):
        old = METAPHORS if room == "tests" else METAPHORS | VAGUE
        for where, nodes in _definitions(room).items():
            violations += [where] if _words(PurePath(where).stem) & old else []
            for is_function, name in _names(nodes):
                is_alone = room != "tests" and is_function and name.strip("_") in WITH_OBJECT
                is_spoken = not name.startswith("test_") and _words(name) & SPOKEN
                if (_words(name) & old or is_alone or is_spoken) and (where, name) not in FILE_METHODS:
                    violations.append(f"{where}: {name}")
    assert not violations, "\n".join(violations)


def test_texts_of_packages_and_tools_do_not_personify() -> None:
    """Errors, logs, help and docstrings use the terms of the field for a lost vehicle and for its commands."""
    violations = []
    for room in ("hil", "sim", "boards", "firmware_stub", "tools"):
        for where, nodes in _definitions(room).items():
            texts = [node for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
            violations += [f"{where}:{text.lineno}" for text in texts if PERSONIFIED.search(str(text.value))]
    assert not violations, "\n".join(violations)


def test_docstrings_begin_with_a_statement() -> None:
    """First lines in packages, tools and tests begin with "Return ...", "Error of ...", "True if ..."."""
    violations = []
    for room in ("hil", "sim", "boards", "firmware_stub", "tools", "tests"):
        for where, nodes in _definitions(room).items():
            for node in nodes:
                if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
                    text = ast.get_docstring(node, clean=False) or ""
                    if text and text.split()[0].rstrip(",:;") in FRAGMENTS:
                        violations.append(f"{where}: {text.strip().splitlines()[0]}")
    assert not violations, "\n".join(violations)


def test_docstrings_of_tests_begin_with_their_subject() -> None:
    """A docstring begins "The speed is ...", not "At 1 m: ..." or "0.3 m/s, and then ..."."""
    violations = []
    for where, nodes in _definitions("tests").items():
        for node in nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name.startswith("test_"):
                first = (ast.get_docstring(node) or "The").split()[0]
                is_word = first[0].isalpha() or first[0] in "`'\""
                if not is_word or first.endswith(":") or first.rstrip(",") in CIRCUMSTANCES:
                    violations.append(f"{where}: {node.name}: {first} ...")
    assert not violations, "\n".join(violations)


def test_docstrings_of_functions_begin_with_a_plain_word() -> None:
    """A docstring begins "Encode sensor_msgs/Imu" or "Return C_L", not with the name of the result alone."""
    violations = []
    for room in ("hil", "sim", "boards", "firmware_stub"):
        for where, nodes in _definitions(room).items():
            for node in nodes:
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                    is_noun = any("property" in ast.unparse(each) for each in node.decorator_list)
                    first = (ast.get_docstring(node) or "Return").split()[0]
                    if not is_noun and not re.fullmatch(r"[A-Z][a-z]+[.,:;]?", first):
                        violations.append(f"{where}: {node.name}: {first} ...")
    assert not violations, "\n".join(violations)
