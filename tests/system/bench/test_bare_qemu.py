"""The latency floor of an STM32 in QEMU, in the protocol of the scenario."""

import shutil
from typing import Any

import pytest

from firmware_stub import qemu
from hil.bench.delay_run import Plan, measure
from hil.bench.floors import bare_qemu
from hil.bench.floors.bare_qemu import TIMES, answer_ms
from hil.bench.harness import Bench
from hil.common.errors import DeviceError, NetworkError
from hil.scenario.config import load_scenario

needs_qemu = pytest.mark.skipif(not shutil.which(qemu.PROGRAM), reason=f"needs {qemu.PROGRAM}")


@pytest.mark.qemu
@needs_qemu
def test_the_firmware_in_qemu_answers_in_the_protocol_of_the_link() -> None:
    """The response time depends on the machine."""
    scenario = load_scenario("paper_field")
    mavlink = scenario._replace(link=scenario.link._replace(protocol="mavlink"))
    took = answer_ms(scenario), answer_ms(mavlink)
    assert 0.0 < took[0] < 50.0
    assert took[1] > 0.0


@pytest.mark.qemu
@needs_qemu
def test_the_floor_is_not_above_the_measured_time_of_the_stm32() -> None:
    """The time of the firmware is not split where nothing was measured."""
    with Bench("paper_field", {"stm32": "qemu"}) as bench:
        result = measure(bench, Plan(seconds=2.0, steps=0))
    assert 0.0 < result.wire < result.at(0.5)
    assert result.wire <= min(result.hops["STM32"])
    assert set(result.hops["wire"]) == {0.0}


def test_the_shortest_response_time_is_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    class Machine:
        wire = None

        def __init__(self, *_: Any, **__: Any) -> None:
            pass

        def close(self) -> None:
            pass

    def answer_ns(_link: object, _channels: int, number: int) -> int:
        return (TIMES + 1 - number) * 1_000_000

    monkeypatch.setattr(bare_qemu, "QemuStm32", Machine)
    monkeypatch.setattr(bare_qemu, "_answer_ns", answer_ns)
    assert answer_ms(load_scenario("paper_field")) == 1.0


def test_a_missing_qemu_is_reported_with_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qemu, "PROGRAM", "no-such-emulator")
    with pytest.raises(DeviceError, match="apt install"):
        answer_ms(load_scenario("paper_field"))


def test_a_benchmark_without_qemu_reports_it_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    with Bench("paper_field", {"stm32": "qemu"}) as bench, pytest.raises(NetworkError, match="apt install"):
        measure(bench, Plan(seconds=0.1))
