"""The slave as a service of a whole emulated board: its own kernel, systemd, two CAN controllers, a network.

It takes one to three minutes, and is skipped unless selected:

    pytest -m board
"""

import pytest

from hil.autonomy.control.controller import VelocityCommand
from hil.client.client import VehicleClient
from tests.support.boards.emulated import held_board
from tests.support.processes import free_port, wait_for
from tools.virtual_board.commands import TO_BOOT, missing
from tools.virtual_board.system import Booted

pytestmark = [
    pytest.mark.board,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(bool(missing(TO_BOOT)), reason=missing(TO_BOOT)),
]


@pytest.fixture(autouse=True)
def requires_marker(request: pytest.FixtureRequest) -> None:
    """Skip the test unless its marker was selected with -m."""
    if "board" not in str(request.config.option.markexpr):
        pytest.skip("boots a whole emulated board: pytest -m board")


# The slave as a service under a real systemd. First its device is a pty that is not there yet; then its STM32 is on the
# other of two CAN controllers of the board.
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
port = "can:socketcan:can-a"
watchdog = "1 s"
[sensors.imu]
rate = "25 Hz"
[master]
goal = [8, 7]
END
echo 'pilot:x:1000:1000::/tmp:/bin/sh' >>/etc/passwd
echo 'pilot:x:1000:' >>/etc/group
cp /etc/board.toml /root/board.toml
chmod 700 /root
python3 -m hil.cli board install /root/board.toml --user pilot --yes || echo "refused: $?"
sed 's/^protocol.*//; s/^port.*/port = "\/dev\/late"/' /etc/board.toml >/etc/late.toml
python3 -m hil.cli board install /etc/late.toml --user pilot --yes
udevadm settle
echo "awake: $(stat -c '%G %a' /dev/cpu_dma_latency)"
systemctl start --no-block uuv-hil
until test $(systemctl show -P NRestarts uuv-hil) -gt 5; do sleep 1; done
python3 -c '
import os, pty, time
name = os.ttyname(pty.openpty()[1])
os.chmod(name, 0o666)
os.symlink(name, "/dev/late")
time.sleep(600)' &
until systemctl -q is-active uuv-hil; do sleep 1; done
echo 'late: came up'
ip link set can0 name can-a
ip link set can1 up type can bitrate 1000000
python3 -m hil.cli stm32 --protocol vesc --port can:socketcan:can1 --channels 6 >/tmp/stm32.log 2>&1 &
python3 -m hil.cli board install /etc/board.toml --user pilot --yes
systemctl restart uuv-hil
echo "service: $(systemctl is-active uuv-hil uuv-hil-can | xargs)"
until journalctl -u uuv-hil | grep -q 'commands arrive'; do sleep 1; done
echo "can-a: $(ip -s -d link show can-a | grep -o 'state ERROR-ACTIVE\|bitrate [0-9]*\|qlen [0-9]*' | xargs)"
before=$(systemctl show -P NRestarts uuv-hil)
echo "restarts so far: $before"
kill -STOP $(systemctl show -P MainPID uuv-hil)
until test $(systemctl show -P NRestarts uuv-hil) -gt $before && systemctl -q is-active uuv-hil; do sleep 1; done
echo "watchdog: $(journalctl -u uuv-hil | grep -o 'Watchdog timeout' | head -1)"
# Its own lines: on a busy machine the STM32 is slow to answer, and that is reported behind it.
until journalctl _PID=$(systemctl show -P MainPID uuv-hil) | grep -q 'commands arrive'; do sleep 1; done
echo flown
systemctl stop uuv-hil
journalctl -u uuv-hil -o cat
python3 -m hil.cli board install /etc/late.toml --user pilot --yes >/dev/null
systemctl start --no-block uuv-hil
echo "dropped: $(systemctl is-active uuv-hil-can || true) $(find /etc/systemd -name '*uuv-hil-can*')"
python3 -m hil.cli board uninstall --yes
left=$(find /etc/systemd -name '*uuv-hil*'; systemctl list-units --all --plain --no-legend 'uuv-hil*')
echo "${left:-nothing is left}"
"""


def last_of(booted: Booted) -> str:
    """Return the last lines that the job printed."""
    return "\n".join(booted.output.splitlines()[-30:])


def test_the_service_runs_on_a_whole_board() -> None:
    port = free_port()
    with held_board() as board:
        whole = Booted(board, JOB, {port: 7447})
    with whole as booted:
        assert wait_for(lambda: "service: " in booted.output or booted.status is not None, 900), last_of(booted)
        assert "service: active active" in booted.output, last_of(booted)
        with VehicleClient(f"tcp/127.0.0.1:{port}", "uuv1") as client:

            def flown() -> bool:
                client.command(VelocityCommand(surge=0.3))
                return "flown" in booted.output or booted.status is not None

            assert wait_for(flown, 600), last_of(booted)
            assert "flown" in booted.output, last_of(booted)
            assert client.received["imu"] > 20
            assert client.diagnostics().cores == 2
            losses = client.contact.losses
        assert booted.wait() == 0, last_of(booted)
        assert losses >= 1, booted.output
        # The emulated board may be too slow for the STM32's word of it in time.
        assert "thrusters neutral" in booted.output or "did not confirm neutral thrusters" in booted.output
    assert "uuv-hil board: the slave would not start as pilot: /root/board.toml: cannot be read" in booted.output
    assert "refused: 2" in booted.output
    assert "awake: dialout 660" in booted.output
    assert "late: came up" in booted.output
    assert "can-a: qlen 100 state ERROR-ACTIVE bitrate 1000000" in booted.output
    assert "dropped: inactive\n" in booted.output
    assert "remove them with: sudo rm -r /var/lib/uuv-hil /var/cache/uuv-hil" in booted.output
    assert "watchdog: Watchdog timeout" in booted.output
    assert "nothing is left" in booted.output
