"""The package +uuv in GNU Octave flies a vehicle; more of it is in tests/system/gateways/test_matlab_package.py."""

from pathlib import Path

import pytest

from hil.gateways.json_lines.server import JsonGateway
from tests.support.clients.json_client import fleet, gateway, own_state
from tests.support.octave import needs_octave, run

__all__ = ["fleet", "gateway", "own_state"]  # the fixtures

pytestmark = needs_octave

FLIGHT = """
here = vehicle.state().position;
vehicle.go_to(here(1) + 0.4, here(2), here(3), 'heading', vehicle.state().heading);
vehicle.wait(30);
after = vehicle.state().position;
vehicle.subscribe('imu', 50);
count = 0;
while count < 25
  count = count + strcmp(gateway.next(5).sensor, 'imu');
end
vehicle.unsubscribe('imu');
vehicle.follow([here(1) here(2) here(3)], 'speed', 0.5, 'lookahead', 0.8, 'tolerance', 0.5);
vehicle.hold_depth(2);
vehicle.hold_heading(0.5);
vehicle.push('x', 5);
vehicle.thrust([1 1 1 1 0 0]);
vehicle.stop();
vehicle.release();
printf('%s\\n%d\\n%.3f\\n', strjoin(gateway.vehicles()), count, after(1) - here(1));
"""


def test_the_matlab_package_flies_a_vehicle(tmp_path: Path, gateway: JsonGateway) -> None:
    names, count, moved = run(tmp_path, gateway, FLIGHT)
    assert (names, count) == ("uuv1", "25")
    assert float(moved) == pytest.approx(0.4, abs=0.4)
