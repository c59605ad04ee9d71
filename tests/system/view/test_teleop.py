"""`uuv-hil teleop` in a real terminal: keys move the vehicle, and it stops when they end."""

import os
import pty
from math import dist
from pathlib import Path

import hil
from hil.common.children import module_command, package_environment, start_child
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


def test_where_nobody_is_it_says_so() -> None:
    code, output = run_here("teleop", "--connect", f"127.0.0.1:{free_port()}")
    assert code == 4
    assert output.count("\n") == 1


def test_a_gamepad_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    code, output = run_here("teleop", "--scenario", str(scenario), "--gamepad")
    assert code == 3
    assert "no gamepad is plugged in; leave out --gamepad" in output
