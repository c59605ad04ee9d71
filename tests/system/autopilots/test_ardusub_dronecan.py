"""The real ArduSub, whose SITL program UUV_HIL_ARDUSUB names, with its thrusters on DroneCAN: the emulated STM32."""

from math import isclose
from pathlib import Path

import pytest

from hil.autopilots.parameters import FOLDER
from hil.common.schema import preset_folder
from hil.links.dronecan.settings import FULL_RPM
from tests.support.autopilots.ardusub_dive import PROGRAM, Dive
from tests.support.clients.ground_station import Mission
from tests.support.processes import Program

pytestmark = [
    pytest.mark.skipif(not PROGRAM, reason="UUV_HIL_ARDUSUB does not name ArduSub's SITL program"),
    pytest.mark.timeout(900),
]
BUS = """
CAN_P1_DRIVER 1
CAN_D1_PROTOCOL 1
CAN_D1_UC_ESC_BM 255
CAN_D1_UC_ESC_RV 255
SIM_CAN_TYPE1 1
"""
SPAN_US = 400


def test_ardusub_outputs_reach_the_stm32_and_motor_speeds_are_reported(tmp_path: Path) -> None:
    own = tmp_path / "bus.parm"
    shipped = Path(preset_folder(FOLDER), "ardupilot_bluerov2_heavy.parm").read_text()
    own.write_text(shipped + BUS)
    pairs: list[tuple[int, int]] = []

    with Program(tmp_path, "stm32", "--protocol", "dronecan", "--port", "can:mcast:0", "--channels", "8"):
        dive = Dive(tmp_path, autopilot=f'parameters = "{own}"')

        def mission() -> Mission:
            yield from dive.dive(2.0)
            dive.station.sticks = (400, 0, 500, 0)
            yield 4.0
            front, rear = (dive.station.latest[f"ESC_TELEMETRY_{which}"] for which in ("1_TO_4", "5_TO_8"))
            pairs.extend(zip(dive.run.pwm_us, [*front.rpm, *rear.rpm], strict=False))

        dive.fly(mission(), 200.0)
    print(pairs)
    assert len(pairs) == 8
    assert sum(abs(pulse - 1500) > 50 for pulse, _ in pairs) >= 4
    for pulse, speed in pairs:
        assert isclose(speed, abs(pulse - 1500) / SPAN_US * FULL_RPM, abs_tol=150.0)
