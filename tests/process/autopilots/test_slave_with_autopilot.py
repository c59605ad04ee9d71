"""A slave that a model of ArduPilot flies: over the thruster link to the STM32, in real time, with faults."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hil.client.client import VehicleClient
from hil.common.ports import free_ports
from hil.view.sources.recorded import RecordedSource
from tests.support.autopilots.autopilot_flyer import FORWARD_PWM_US, SCENARIO, Flyer
from tests.support.processes import Program, children_of, free_port, wait_for


@contextmanager
def flying_slave(folder: Path, stm32: str, extra_keys: str = "") -> Iterator[tuple[Program, Flyer, VehicleClient]]:
    port, udp = free_port(), free_ports(1)[0]
    path = folder / "flown.toml"
    path.write_text(SCENARIO.format(stm32=stm32, port=port, udp=udp) + extra_keys)
    with Program(folder, "slave", path) as slave:
        slave.expect("waiting for ArduPilot on udp")
        flyer = Flyer(udp)
        try:
            with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1", role="observer") as client:
                assert client.wait_for_vehicle(60)
                yield slave, flyer, client
        finally:
            flyer.close()
    assert "thrusters neutral" in slave.output


def reported(client: VehicleClient, condition: Callable[[Any], bool]) -> Any:
    """Wait for diagnostics of which that holds."""
    assert wait_for(lambda: bool(client.diagnostics()) and condition(client.diagnostics()), 60.0), client.diagnostics()
    return client.diagnostics()


@pytest.mark.parametrize("stm32", ["python", "process"])
def test_outputs_of_the_autopilot_reach_the_stm32(tmp_path: Path, stm32: str) -> None:
    """An STM32 in another process gets them too; a silent autopilot stops the thrusters until it sends again."""
    with flying_slave(tmp_path, stm32) as (slave, flyer, client):
        figures = reported(client, lambda figures: figures.pwm_us == FORWARD_PWM_US)
        assert figures.controller == "autopilot"
        assert figures.autopilot_frame == "vectored"
        assert figures.autopilot_outputs[:6] == FORWARD_PWM_US
        assert figures.autopilot_delay_p50_ms > 0.0
        flyer.going.clear()
        reported(client, lambda figures: figures.pwm_us == (1500,) * 6)  # by the STM32's watchdog, or by a command
        reported(client, lambda figures: figures.autopilot_silences >= 1)
        slave.expect("no outputs for 0.2 s: thrusters neutral")
        flyer.going.set()
        reported(client, lambda figures: figures.pwm_us == FORWARD_PWM_US)


def test_a_flight_with_an_autopilot_is_recorded(tmp_path: Path) -> None:
    with flying_slave(tmp_path, "python", '[recording]\nslave = true\nfolder = "{}"\n'.format(tmp_path / "runs")) as (
        _,
        _,
        client,
    ):
        reported(client, lambda figures: figures.pwm_us == FORWARD_PWM_US)
        wait_for(lambda: client.latest.get("odom") and client.latest["odom"].value.nu[0] > 0.1)
    source = RecordedSource(str(next(tmp_path.rglob("*.mcap"))))
    source.playback.change(source.playback.duration)
    assert source.names == ["uuv1"]
    assert source.latest("uuv1")["odom"].nu[0] > 0.1, "it goes ahead"
    assert (source.diagnostics("uuv1").autopilot_outputs or ())[:6] == FORWARD_PWM_US


def test_a_killed_stm32_is_restarted_and_gets_the_outputs_of_the_autopilot_again(tmp_path: Path) -> None:
    with flying_slave(tmp_path, "process") as (slave, _, client):
        reported(client, lambda figures: figures.pwm_us == FORWARD_PWM_US)
        stm32 = children_of(slave.process.pid)
        assert stm32
        for pid in stm32:
            os.kill(pid, signal.SIGKILL)
        slave.expect("thruster link lost")
        slave.expect("thruster link back")
        reported(client, lambda figures: figures.pwm_us == FORWARD_PWM_US and figures.link_losses >= 1)
