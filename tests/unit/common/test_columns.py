"""Tables fit the terminal and lose no text."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.common.columns import GAP, MIN_WIDTH, aligned, fit_to_terminal

CELL = st.text(st.characters(categories=("L", "N"), include_characters=" /_-."), max_size=90)
TABLES = st.integers(1, 6).flatmap(lambda n: st.lists(st.lists(CELL, min_size=n, max_size=n), min_size=1, max_size=5))


@given(TABLES, st.integers(60, 120))
def test_no_line_exceeds_the_terminal_and_no_character_is_lost(rows: list[list[str]], width: int) -> None:
    lines = aligned(rows, width=width)
    assert max(map(len, lines)) <= max(width, len(rows[0]) * (MIN_WIDTH + len(GAP)))
    assert sorted("".join(map("".join, rows)).replace(" ", "")) == sorted("".join(lines).replace(" ", ""))


def test_lines_are_wrapped_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "30")
    text = "delay by hop: network 0.314 ms, wake-up 0.081 ms\n\nloop: 400 Hz"
    assert fit_to_terminal(text) == text
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert fit_to_terminal(text).split("\n") == [
        "delay by hop: network 0.314", "    ms, wake-up 0.081 ms", "", "loop: 400 Hz",
    ]  # fmt: skip
