"""Messages of commands that wait for a vehicle, or publish without a subscriber."""

from pathlib import Path

import pytest

from tests.support.processes import Program, write_scenario


def test_gateway_and_foxglove_report_that_they_wait_for_a_vehicle(tmp_path: Path) -> None:
    path, port = write_scenario(tmp_path)
    address = f"127.0.0.1:{port}"
    waiting = (
        ("gateway", "json", "--connect", address, "--listen", "0"),
        ("gateway", "foxglove", "--connect", address, "--listen", "0"),
    )
    with Program(tmp_path, *waiting[0]) as gateway, Program(tmp_path, *waiting[1]) as foxglove:
        gateway.expect(f"no vehicle at tcp/{address} yet; waiting for one")
        foxglove.expect(f"waiting for a vehicle at tcp/{address}")
        assert "connected: uuv1" not in gateway.output + foxglove.output
        with Program(tmp_path, "slave", path):
            gateway.expect("connected: uuv1")
            foxglove.expect("connected: uuv1")
            with Program(
                tmp_path, "topic", "pub", "/uuv1/cmd_vell", "geometry_msgs/msg/Twist", "--connect", address
            ) as pub:
                pub.expect(r"nobody subscribes to /uuv1/cmd_vell yet; .*did you mean '/uuv1/cmd_vel'\?")
                pub.expect("publishing geometry_msgs/msg/Twist")
        gateway.expect("no vehicle at .* yet[^$]*no vehicle at")


@pytest.mark.parametrize(
    "command",
    [("gateway", "mavlink", "--endpoint", "udpin:127.0.0.1:0"), ("view", "--listen", "0", "--no-browser")],
    ids=" ".join,
)
def test_mavlink_and_view_report_that_they_wait_for_a_vehicle(tmp_path: Path, command: tuple[str, ...]) -> None:
    path, port = write_scenario(tmp_path)
    where = f"127.0.0.1:{port}"
    with Program(tmp_path, *command, "--connect", where) as program:
        program.expect(f"no vehicle at tcp/{where} yet; waiting for one")
        assert "connected: uuv1" not in program.output
        with Program(tmp_path, "slave", path):
            program.expect("connected: uuv1")
