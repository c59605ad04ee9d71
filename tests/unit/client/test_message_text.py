"""Messages as text: what a person may type."""

from contextlib import suppress

from hypothesis import given
from hypothesis import strategies as st

from hil.client.message_text import parse_values
from hil.common.errors import ConfigError


@given(st.text(max_size=30))
def test_random_text_raises_no_other_error(text: str) -> None:
    for noise in (text, f"{{{text}", f"{{a: {text}}}"):
        with suppress(ConfigError):
            assert isinstance(parse_values(noise), dict)
