"""The slave as a service of a whole emulated board: its own kernel, systemd, two CAN controllers, a network.

It takes one to three minutes, and is skipped unless it is asked for:

    pytest -m board
"""

import pytest

from hil.autonomy.control import VelocityCommand
from hil.master.client import VehicleClient
from tests.boards.emulated import built_board
from tests.processes import free_port, wait_for
from tools.virtual_board.commands import TO_BOOT, missing
from tools.virtual_board.system import Booted

pytestmark = [pytest.mark.board, pytest.mark.skipif(bool(missing(TO_BOOT)), reason=missing(TO_BOOT))]


@pytest.fixture(autouse=True)
def asked_for(request: pytest.FixtureRequest) -> None:
    """Skips what nobody asked for."""
    if "board" not in str(request.config.option.markexpr):
        pytest.skip("boots a whole emulated board: pytest -m board")


# The slave as a service under a real systemd, its STM32 on the other of two CAN controllers of the board.
JOB = r"""
set -e
cat >/etc/board.toml <<'END'
vehicle = "paper_six"
world = "pool"
stm32 = "device"
[start]
north = 4
east = 4
depth = 2
[slave]
listen = "tcp/0.0.0.0:7447"
step = "20 ms"
control_period = "50 ms"
deadman = "2 s"
[link]
protocol = "vesc"
port = "can:socketcan:can0"
watchdog = "1 s"
[sensors.imu]
rate = "25 Hz"
[master]
goal = [8, 7]
END
echo 'pilot:x:1000:1000::/tmp:/bin/sh' >>/etc/passwd
echo 'pilot:x:1000:' >>/etc/group
ip link set can1 up type can bitrate 1000000
python3 -m hil.cli stm32 --protocol vesc --port can:socketcan:can1 --channels 6 >/tmp/stm32.log 2>&1 &
python3 -m hil.cli board install /etc/board.toml --user pilot --yes
systemctl start uuv-hil
echo "service: $(systemctl is-active uuv-hil uuv-hil-can | xargs)"
until journalctl -u uuv-hil | grep -q 'commands arrive'; do sleep 1; done
echo "can0: $(ip -s -d link show can0 | grep -o 'state ERROR-ACTIVE\|bitrate [0-9]*' | xargs)"
kill -STOP $(systemctl show -P MainPID uuv-hil)
until test $(systemctl show -P NRestarts uuv-hil) -gt 0 && systemctl -q is-active uuv-hil; do sleep 1; done
echo "watchdog: $(journalctl -u uuv-hil | grep -o 'Watchdog timeout' | head -1)"
until journalctl -u uuv-hil | tail -5 | grep -q 'commands arrive'; do sleep 1; done
echo flown
systemctl stop uuv-hil
journalctl -u uuv-hil -o cat | grep 'thrusters neutral'
python3 -m hil.cli board uninstall --yes >/dev/null
ls /etc/systemd/system | grep uuv-hil || echo 'nothing is left'
"""


def test_the_service_on_a_whole_board() -> None:
    board = built_board()
    port = free_port()
    with Booted(board, JOB, {port: 7447}) as booted:
        assert wait_for(lambda: "service: " in booted.output or booted.status is not None, 240), booted.output
        assert "service: active active" in booted.output, booted.output
        with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1") as client:

            def flown() -> bool:
                client.command(VelocityCommand(surge=0.3))
                return "flown" in booted.output or booted.status is not None

            assert wait_for(flown, 240), booted.output
            assert client.received["imu"] > 50
            assert client.diagnostics()["cores"] == "2"
            assert client.contact.losses >= 1
        assert booted.wait(60) == 0, booted.output
    assert "can0: state ERROR-ACTIVE bitrate 1000000" in booted.output
    assert "watchdog: Watchdog timeout" in booted.output
    assert "nothing is left" in booted.output
