"""Random and mutated bytes into the decoder of every frame: nothing raises, hangs or grows."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.common.schema import preset_names
from hil.links.contract import ThrusterCommand
from hil.links.frame.protocol import open_frame
from hil.links.protocols import Role
from tests.support.examples import examples
from tools.faults.decoders import feed_link

NAMES = preset_names("firmware_stub/frames")


@pytest.mark.parametrize("role", ["host", "device"])
@pytest.mark.parametrize("name", NAMES)
def test_a_thousand_mutated_strings_cause_no_fault(name: str, role: Role) -> None:
    outcome = feed_link("frame", role, 1000, 1, frame=name)
    assert outcome.fault == ""
    assert int(outcome.remark.split()[0]) > 100, "many of the strings carry a sound frame"


@pytest.mark.parametrize("name", NAMES)
@examples(30)
@given(st.lists(st.binary(min_size=1, max_size=64), max_size=20), st.integers(0, 200))
def test_repeated_bytes_and_long_reads_cause_no_fault(name: str, pieces: list[bytes], times: int) -> None:
    """These bytes cost a careless decoder quadratic time or memory; the frame after them is decoded."""
    protocol = open_frame("device", 3, name)
    command = ThrusterCommand(1, True, (1200, 1500, 1801))
    for piece in pieces:
        protocol.feed(piece * times)
        assert len(protocol.reader.unfinished) < 300
    received = [message for _ in range(12) for message in protocol.feed(protocol.encode(command))]
    assert command.pwm_us in [message.pwm_us for message in received]
