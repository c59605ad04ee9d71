"""Text from others cannot control a terminal, forge a log line, or fill a log."""

import pytest

from hil.common.columns import aligned
from hil.common.tables import value_of
from hil.common.text import clean, toml_text
from hil.network.tokens import Presence, presence_key, read_presence
from hil.slave.log import Log


@pytest.mark.parametrize(
    ("text", "cleaned"),
    [
        ("uuv1", "uuv1"),
        ("Prüfstand 5 µm", "Prüfstand 5 µm"),
        ("\x1b[2Jgone", "?[2Jgone"),
        ("a\nslave: ready", "a?slave: ready"),
        ("\u202eright to left\x9b", "?right to left?"),
        ("x" * 300, "x" * 197 + "..."),
    ],
)
def test_text_from_others_is_cleaned(text: str, cleaned: str) -> None:
    assert clean(text) == cleaned
    assert aligned([[text]], width=300) == [cleaned]


def test_a_value_written_as_toml_reads_back() -> None:
    """As a slave passes the changes of its command line on to the processes that it starts."""
    value = {"below": 1.5, "at": ["tcp:127.0.0.1:1", 'a "b" \\'], "settings": {"is_on": True, "n": 3}, "empty": {}}
    assert value_of(toml_text(value)) == value


def test_a_log_message_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    log = Log("slave")
    log.write_line("master evil\n[    0.000] slave: ready\x1b]0;owned\x07 is there")
    log.write_line("y" * 5000)
    log.flush()
    first, second = capsys.readouterr().err.splitlines()
    assert first.endswith("slave: master evil?[    0.000] slave: ready?]0;owned? is there")
    assert len(second) < 1100


def test_presence_names_from_others_are_cleaned_and_shortened() -> None:
    honest = Presence("uuv1", "master", 0, "ab" * 16, "laptop:42")
    assert read_presence(presence_key(honest)) == honest
    evil = read_presence("uuv_hil/uuv\x1b1/alive/master/0/" + "ab" * 16 + "/\x1b[31m\nslave: ready" + "z" * 500)
    assert evil
    assert evil.node == "uuv_1"
    assert evil.process == "__31m_slave:_ready" + "z" * 46
    assert read_presence(f"uuv_hil/uuv1/alive/master/0/{'ab' * 40}/x") is None
