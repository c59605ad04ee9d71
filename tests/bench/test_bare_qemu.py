"""The floor of an STM32 in QEMU is that of a real one in the scenario's protocol."""

import shutil

import pytest

from firmware_stub import qemu
from hil.bench.bare_qemu import answer_ms
from hil.config import load_scenario
from hil.errors import DeviceError


@pytest.mark.qemu
@pytest.mark.skipif(not shutil.which(qemu.PROGRAM), reason=f"needs {qemu.PROGRAM}")
def test_it_answers_in_the_protocol_of_the_link() -> None:
    """22 bytes there and 32 back cannot be had in a twentieth of a millisecond; MAVLink's are longer."""
    scenario = load_scenario("paper_field")
    mavlink = scenario._replace(link=scenario.link._replace(protocol="mavlink"))
    took = answer_ms(scenario), answer_ms(mavlink)
    assert 0.05 < took[0] < 50.0
    assert 0.05 < took[1] < 50.0


def test_without_qemu_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qemu, "PROGRAM", "no-such-emulator")
    with pytest.raises(DeviceError, match="apt install"):
        answer_ms(load_scenario("paper_field"))
