"""The core in C as VESCs on a CAN bus, compared with its specification in Python and run on the emulated chip."""

import struct

import pytest

from firmware_stub.stub import Stm32
from hil.links.can_thrusters import MotorValues
from hil.links.contract import ThrusterCommand
from hil.links.protocols import open_protocol
from hil.links.wires.can_frame import CanFrame, pack_frame, unpack_frames
from tests.support.firmware.c_core import Clock, Script, StepOutput, run_c
from tests.support.firmware.c_vesc import vesc_script


def run_python(script: Script) -> list[StepOutput]:
    """Return the specification: at each step the frame, if there is one, else the time."""
    unmeasured, clock = MotorValues(0.0, 0.0, 273.15), Clock()
    device = open_protocol("vesc", "device", script.channels, motor_values=lambda *_: unmeasured, clock=clock)
    stm32 = Stm32(script.channels, script.watchdog_us * 1000)
    received_any, results = False, []
    for step in script.steps:
        output, now_ns = b"", step.now_us * 1000
        clock.now_ns = now_ns
        for message in device.feed(pack_frame(step.can)) if step.can else []:
            assert isinstance(message, ThrusterCommand)
            if stm32.command(message, now_ns):
                output += device.encode(stm32.telemetry(now_ns))
        received_any = received_any or (step.can is not None and step.can.id & 0xFF in range(1, script.channels + 1))
        if step.can is None and stm32.tick(now_ns):
            output += device.encode(stm32.telemetry(now_ns))
        results.append(StepOutput(b"", tuple(stm32.pwm_us), 0, tuple(unpack_frames(output)) if received_any else ()))
    return results


def decode_frame(frame: CanFrame) -> tuple[int, int, int]:
    """Return identifier, current and duty of a STATUS; its ERPM follows from the duty."""
    erpm, current, duty = struct.unpack(">ihh", frame.data)
    assert abs(erpm - duty * 24.5) <= 24.5
    return frame.id, current, duty


@pytest.mark.parametrize("seed", range(4))
def test_the_core_matches_the_specification(core: str, seed: int) -> None:
    script = vesc_script(seed, 400)
    for step, c, python in zip(script.steps, run_c(core, script), run_python(script), strict=True):
        assert c.pwm_us == python.pwm_us, step
        if c.sent:  # nothing was received yet: it still reports by the frame
            continue
        reported, wanted = list(map(decode_frame, c.can)), list(map(decode_frame, python.can))
        assert [row[:2] for row in reported] == [row[:2] for row in wanted], step
        assert all(abs(a[2] - b[2]) <= 1 for a, b in zip(reported, wanted, strict=True)), step
