"""The same mission over every kind of link and with every kind of STM32."""

import json
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import pytest

from firmware_stub.build import native_compiler
from tests.support.processes import Program, write_scenario

# stm32, port, protocol
FLIGHTS = {
    "frame on a pty": ("python", "pty:", "frame"),
    "frame, slow as 115200 baud": ("python", "pty:", "frame"),
    "mavlink on a pty": ("python", "pty:", "mavlink"),
    "mavlink over udp, in a process": ("process", "udp://127.0.0.1:{port}", "mavlink"),
    "dronecan": ("python", "can:mcast:77", "dronecan"),
    "vesc": ("python", "can:virtual:bus0", "vesc"),
    "image in Unicorn": ("unicorn", "pty:", "frame"),
    "image in Unicorn, mavlink": ("unicorn", "pty:", "mavlink"),
    "image in Unicorn, vesc on its CAN": ("unicorn", "can:virtual:bus0", "vesc"),
    "C as a process": ("native", "pty:", "frame"),
    "C as a process, mavlink": ("native", "pty:", "mavlink"),
}


def missing(stm32: str, port: str, protocol: str) -> str:
    """Return what this machine lacks for such a flight, or ""."""
    if stm32 == "native" and not native_compiler():
        return "a C compiler"
    wanted = {"unicorn": stm32 == "unicorn", "pymavlink": protocol == "mavlink", "can": port.startswith("can:")}
    return next((name for name, needed in wanted.items() if needed and not find_spec(name)), "")


def fly(name: str, folder: Path) -> None:
    """Fly once, with a slave and a master of its own."""
    stm32, port, protocol = FLIGHTS[name]
    folder.mkdir()
    slow = "\n[link.faults]\nbaud = 115200" if "115200" in name else ""
    link = f'port = "{port}"\nprotocol = "{protocol}"{slow}'
    scenario, number = write_scenario(folder, top=f'stm32 = "{stm32}"', link=link)
    scenario.write_text(scenario.read_text().replace("{port}", str(number + 1000)))
    with Program(folder, "demo", scenario, "--output", folder / "run") as program:
        assert program.wait() == 0, f"{name}:\n{program.output}"
        assert "goal reached" in program.output, f"{name}:\n{program.output}"
        assert "Traceback" not in program.output, f"{name}:\n{program.output}"


def test_the_mission_succeeds_over_every_link(tmp_path: Path) -> None:
    """Three flights run at a time, as more would not keep real time on two processors."""
    ready = [name for name, flight in FLIGHTS.items() if not missing(*flight)]

    with ThreadPoolExecutor(3) as pool:
        flights = [pool.submit(fly, name, tmp_path / name.replace(" ", "_")) for name in ready]
    for flight in flights:
        flight.result()
    assert len(ready) >= 5


@pytest.mark.parametrize(
    ("top", "link", "expected_text"),
    [
        ("", 'protocol = "vesc"', "protocol 'vesc' needs a CAN bus, can:INTERFACE:CHANNEL, and the port is 'pty:'"),
        ("", 'port = "can:virtual:a"', "protocol 'frame' needs a wire of bytes"),
        ("", 'port = "COM3"', "'COM3' is not the address of a wire"),
        ('stm32 = "native"', 'frame = "aa55"', "stm32 = 'native' does not speak [link] frame = 'aa55'"),
        ('stm32 = "unicorn"', 'port = "can:virtual:a"\nprotocol = "dronecan"', "'unicorn' does not speak [link]"),
        ('controller = "external"\nstm32 = "native"', "", "'native' would hide"),
        ("", 'protocol = "mavlink"\noptions = { sistem = 2 }', "no key 'sistem'; did you mean 'system'?"),
    ],
)
def test_impossible_links_are_refused(top: str, link: str, expected_text: str, tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path, top=top, link=link)
    with Program(tmp_path, "slave", scenario) as slave:
        assert slave.wait() == 2, slave.output
    assert expected_text in slave.output
    assert "Traceback" not in slave.output


def test_topics_that_a_planner_does_not_use_are_not_sent_in_a_mission(tmp_path: Path) -> None:
    """The same mission runs twice: in the second run the master records it, and so subscribes to all topics."""
    rates, folders, demos = [], [tmp_path / "spared", tmp_path / "whole"], []
    for folder, wish in zip(folders, ("", '[recording]\nmaster = true\ncompression = "none"\n'), strict=True):
        folder.mkdir()
        scenario, _ = write_scenario(folder)
        scenario.write_text(scenario.read_text().replace("goal = [8, 7]", "goal = [5.5, 5]") + wish)
        demos.append(Program(folder, "demo", scenario, "--output", folder / "run"))
    with demos[0], demos[1]:
        for demo in demos:
            assert demo.wait() == 0, demo.output
    for folder in folders:
        table = json.loads((folder / "run" / "table.json").read_text())["table"]
        slave = table["slave"]
        listened_s = float(slave["uptime_s"]) - table["startup_s"]  # before that there is nobody to send to
        simulated_s = listened_s - float(slave["steps_skipped"]) / 100.0  # what is skipped is not measured
        rates.append(float(slave["messages_sent"]) / simulated_s)
    spared, whole = rates
    assert whole > 150, "203 a second"
    assert spared < 0.5 * whole, "61 a second"
