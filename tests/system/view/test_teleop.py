"""`uuv-hil teleop` in a real terminal: keys move the vehicle, and it stops without them."""

import contextlib
import os
import pty
import sys
import threading
from math import dist
from pathlib import Path

import hil
from hil.common.children import module_command, package_environment, start_child
from tests.support.clients import virtual_gamepad
from tests.support.processes import Program, free_port, run_here, wait_for, write_scenario


def test_keys_move_the_vehicle_and_it_stops_without_them(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    keyboard, terminal = pty.openpty()
    with Program(tmp_path, "slave", scenario), hil.connect(f"tcp/127.0.0.1:{port}", observe=True) as fleet:
        vehicle = fleet["uuv1"]
        place = vehicle.ground_truth.position
        command = module_command("hil.cli", "teleop", "--scenario", str(scenario))
        teleop = start_child(command, environment=package_environment(), stdin=terminal, stdout=terminal)
        try:

            def moved() -> bool:
                os.write(keyboard, b"w")
                return dist(vehicle.ground_truth.position, place) > 0.5

            assert wait_for(moved, 120.0), "w moves it"
            assert wait_for(lambda: vehicle.ground_truth.speed < 0.05, 60.0), "and without a key it stops"
            os.write(keyboard, b"x")
            assert wait_for(lambda: vehicle.diagnostics.armed is False), "x disarms"
            os.write(keyboard, b"\x03")  # Ctrl-C
        finally:
            teleop.terminate()
            assert teleop.wait(30) == 0
    os.close(keyboard)
    os.close(terminal)


def test_a_gamepad_steers_and_an_unplugged_one_stops_the_vehicle(tmp_path: Path) -> None:
    """The gamepad is SDL's virtual one: all code above its driver is that of a real one."""
    scenario, port = write_scenario(tmp_path)
    keyboard, terminal = pty.openpty()
    os.mkfifo(tmp_path / "pad")
    with Program(tmp_path, "slave", scenario), hil.connect(f"tcp/127.0.0.1:{port}", observe=True) as fleet:
        vehicle = fleet["uuv1"]
        path = str(Path(virtual_gamepad.__file__))
        command = [sys.executable, path, str(tmp_path / "pad"), "teleop", "--scenario", str(scenario), "--gamepad"]
        teleop = start_child(
            command, environment=package_environment(), stdin=terminal, stdout=terminal, stderr=terminal
        )
        shown: list[bytes] = []

        def read() -> None:
            with contextlib.suppress(OSError):  # until the other end is closed
                while data := os.read(keyboard, 65_536):
                    shown.append(data)

        reader = threading.Thread(target=read)
        reader.start()
        pad = open(tmp_path / "pad", "w", encoding="ascii", buffering=1)  # noqa: SIM115  # as long as the program
        try:

            def speed(axis: int) -> float:
                return vehicle.ground_truth.nu[axis]

            pad.write("axis 1 -32768\n")  # the left stick ahead, without the switch
            assert not wait_for(lambda: abs(speed(0)) > 0.1, 3.0)
            pad.write("button 9 1\n")
            assert wait_for(lambda: speed(0) > 0.2, 60.0), "left stick: ahead"
            pad.write("axis 1 0\naxis 2 32767\n")
            assert wait_for(lambda: speed(1) > 0.1, 60.0), "right stick: to starboard"
            pad.write("axis 2 0\naxis 3 32767\n")
            assert wait_for(lambda: speed(2) > 0.1, 60.0), "right stick back: down"
            pad.write("axis 3 0\naxis 0 32767\n")
            assert wait_for(lambda: speed(5) > 0.2, 60.0), "left stick: to the right"
            pad.write("axis 0 0\naxis 1 -32768\n")
            assert wait_for(lambda: speed(0) > 0.2, 60.0)
            pad.write("unplug\n")
            assert wait_for(lambda: abs(speed(0)) < 0.05, 60.0), "unplugged: it stops"
            pad.write("plug\naxis 1 32767\nbutton 10 1\n")
            assert wait_for(lambda: speed(0) < -0.2, 60.0), "plugged in again: astern, by the other button"
            pad.write("button 10 0\n")
            assert wait_for(lambda: abs(speed(0)) < 0.05, 60.0), "let go: it stops"
        finally:
            pad.close()
            teleop.terminate()
            assert teleop.wait(30) == 0
    os.close(terminal)
    reader.join()
    os.close(keyboard)
    assert b"the gamepad is unplugged: plug it in again" in b"".join(shown)


def test_a_missing_slave_is_one_line() -> None:
    code, output = run_here("teleop", "--connect", f"127.0.0.1:{free_port()}")
    assert code == 4
    assert output.count("\n") == 1


def test_a_missing_gamepad_is_one_line(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    code, output = run_here("teleop", "--scenario", str(scenario), "--gamepad")
    assert code == 3
    assert "no gamepad is plugged in; leave out --gamepad" in output
