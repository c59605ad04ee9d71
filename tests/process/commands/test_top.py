"""`uuv-hil top` beside real slaves: the table, the rates of counters, Prometheus, and slaves that ended."""

import re
import signal
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from boards import Board, load_board
from boards.tree import Tree
from hil.client.client import VehicleClient
from hil.client.health_watch import PACED, HealthWatch, Status
from hil.commands.top import table
from hil.common.clock import now_ns
from hil.gateways.prometheus import Endpoint
from hil.network.roles import open_master_session
from hil.ros.diagnostics import Diagnostics
from hil.slave.health.machine_figures import add_machine_figures, network_bytes
from tests.support.diagnostics import reported
from tests.support.processes import Program, run_here, wait_for, write_scenario


@pytest.fixture(scope="module")
def slave(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    folder = tmp_path_factory.mktemp("top")
    path, port = write_scenario(folder, step=0.0025)
    with Program(folder, "slave", path) as program:
        program.expect("ready")
        yield port


def row(text: str, name: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(name))[len(name) :].strip()


def test_the_table_of_a_real_slave(slave: int) -> None:
    text = print_once(slave)
    assert row(text, "loop (Hz)") == "400"
    assert row(text, "state") == "waiting for commands, thrusters neutral"
    assert 0.1 < float(row(text, "CPU (of a core)").rstrip("%")) < 100.0
    assert 5.0 < float(row(text, "memory (PSS)").split()[0]) < 60.0
    assert float(row(text, "messages sent (1/s)")) < 10.0, "nobody else listens"
    assert row(text, "link").startswith("frame /dev/pts/")
    assert len(row(text, "late p50 / p99 / max (us)").split("/")) == 3
    assert len(row(text, "the same since the start").split("/")) == 3
    assert "nobody at" not in text


def print_once(*ports: int, wait_s: int = 10) -> str:
    endpoints = [word for port in ports for word in ("--connect", f"tcp/127.0.0.1:{port}")]
    code, output = run_here("top", *endpoints, "--once", "--wait", f"{wait_s}")
    assert code == 0, output
    return output


def test_the_message_rate_with_a_client_of_all_topics(slave: int) -> None:
    """The rates are IMU 100, DVL 8, its twist and altitude, pressure 20, odometry and truth 20: about 184 a second."""
    with VehicleClient(f"tcp/127.0.0.1:{slave}", "uuv1", role="observer") as client:
        assert wait_for(lambda: client.received["imu"] > 150)  # for longer than a second
        assert 110.0 < float(row(print_once(slave), "messages sent (1/s)")) < 350.0, "more than the IMU, not twice"


def test_two_slaves_of_one_name_are_reported(slave: int, tmp_path: Path) -> None:
    path, port = write_scenario(tmp_path)
    with Program(tmp_path, "slave", path) as other:
        other.expect("ready")
        output = print_once(slave, port, wait_s=2)
    assert "2 slaves are called uuv1, and their figures are mixed" in output


def test_prometheus_listens_at_an_ipv6_address() -> None:
    with open_master_session("tcp/127.0.0.1:1") as session, Endpoint(("::1", 0), HealthWatch(session)) as endpoint:
        assert endpoint.address.startswith("http://[::1]:")
        with urllib.request.urlopen(endpoint.address, timeout=60) as answer:
            assert answer.status == 200


def test_prometheus_shows_a_real_slave_until_it_ends(tmp_path: Path) -> None:
    path, port = write_scenario(tmp_path, step=0.0025)
    with Program(tmp_path, "slave", path) as vehicle:
        vehicle.expect("ready")
        with Program(tmp_path, "top", "--connect", f"tcp/127.0.0.1:{port}", "--prometheus", "0") as top:
            address = top.expect(r"serving (http://127.0.0.1:\d+/metrics)").group(1)

            def page() -> str:
                with urllib.request.urlopen(address, timeout=60) as answer:
                    assert answer.headers["Content-Type"].startswith("text/plain; version=0.0.4")
                    return str(answer.read().decode())

            assert wait_for(lambda: "uuv_hil_cpu_share{" in page()), page()
            text = page()
            assert re.search(r'^uuv_hil_up\{node="uuv1",board="[^"]*"\} 1$', text, re.M)
            assert re.search(r'^uuv_hil_loop_rate_hertz\{node="uuv1",board="[^"]*"\} 400$', text, re.M)
            assert re.search(r"^uuv_hil_pss_bytes\{[^}]*\} [1-9]\d{7}", text, re.M), "some 20 MiB"
            with pytest.raises(urllib.error.HTTPError, match="404") as refusal:
                urllib.request.urlopen(address.replace("metrics", "other"), timeout=60)
            refusal.value.close()  # it is an open answer
            vehicle.process.kill()
            assert wait_for(lambda: re.search(r"^uuv_hil_up\{[^}]*\} 0$", page(), re.M)), page()
            assert "uuv_hil_cpu_share{" not in page(), "figures of one that is gone would be lies"
            assert top.stop(signal.SIGTERM) in (0, 130)
    assert "Traceback" not in top.output


def test_every_figure_of_the_table_is_reported_by_a_slave(slave: int) -> None:
    with open_master_session(f"tcp/127.0.0.1:{slave}") as session:
        watch = HealthWatch(session)
        assert wait_for(lambda: [status for status in watch.statuses() if status.paces])
        (status,) = watch.statuses()
    assert {figure.name for figure in PACED} == set(status.paces)
    assert set(status.figures.raw) <= set(Diagnostics.FIGURES), "nothing that is not in the table"
    missing = set(Diagnostics.FIGURES) - set(status.figures.raw)
    # what machines may not have
    unsaid = ("temperature_c", "throttled", "cpu_mhz", "labels", "memory_available_mib", "services")
    # with certificates, a master, a camera, an autopilot, faults on the link, software of others
    elsewhere = ("may_", "clock_", "imaging_", "autopilot", "link_faults", "thrusters_driven")
    assert [name for name in missing if not name.startswith((*unsaid, *elsewhere))] == []
    assert status.figures.link_wire == "pty"


def printed(**values: Any) -> Status:
    return Status("uuv1", 0, "running", reported(**values), {}, now_ns(), True)


def machine_figures(tree: Tree, board: Board | None) -> Diagnostics:
    output = Diagnostics()
    add_machine_figures(output, tree, board)
    return output


def test_figures_of_a_machine_are_read_from_its_files(tmp_path: Path) -> None:
    files = {
        "proc/net/dev": "Inter-|   Receive\n face |bytes    packets\n    lo: 100 1 0 0 0 0 0 0 100 1 0 0 0 0 0 0\n"
        "  wlan0: 5000 9 0 0 0 0 0 0 700 9 0 0 0 0 0 0\n",
        "proc/meminfo": "MemTotal: 4000000 kB\nMemAvailable:    2048000 kB\n",
        "sys/class/thermal/thermal_zone0/temp": "48686\n",
        "sys/class/thermal/thermal_zone0/type": "cpu-thermal\n",
        "sys/class/thermal/cooling_device0/type": "cpufreq-cpu0\n",
        "sys/class/thermal/cooling_device0/cur_state": "2\n",
        "sys/devices/system/cpu/cpu0/cpufreq/scaling_cur_freq": "1500000\n",
        "sys/fs/cgroup/system.slice/uuv-hil-view.service/cgroup.procs": "7\n",
    }
    files |= {f"etc/systemd/system/uuv-hil{part}.service": "" for part in ("", "-view", "-record", "-can")}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    tree = Tree(str(tmp_path))
    assert network_bytes(tree) == (5100, 800)
    figures = machine_figures(tree, load_board("raspberry_pi_4b"))
    assert figures.temperature_c == 48.7
    assert figures.throttled == "the clock is capped by the temperature"
    assert (figures.cpu_mhz, figures.memory_available_mib) == (1500, 2000)
    assert figures.services == "not running: record"
    assert re.search("^services beside it +not running: record$", table([printed(services=figures.services)], []), re.M)
    (tmp_path / "proc/meminfo").write_text("MemAvailable:\nMemAvailable: much\n")
    assert machine_figures(tree, None).memory_available_mib is None
    bare = machine_figures(Tree(str(tmp_path / "none")), None)
    assert bare.throttled is None, "who cannot tell does not say no"
    assert bare.temperature_c is None
    assert bare.services is None
