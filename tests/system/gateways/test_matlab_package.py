"""The package +uuv in GNU Octave with a real vehicle: simulation services, pictures, and error messages."""

import signal
from pathlib import Path

import pytest

import hil
from hil.client.fleet import Fleet
from hil.gateways.json_lines.server import JsonGateway
from tests.support.clients.json_client import gateway, own_state, seeing_fleet, seeing_vehicle
from tests.support.octave import needs_octave, run, write_script
from tests.support.processes import Program, free_port, wait_for, write_scenario

__all__ = ["gateway", "own_state", "seeing_fleet"]  # the fixtures

pytest.importorskip("numpy", reason="pictures and maps need numpy")
pytestmark = needs_octave


SIMULATION = """
vehicle.set_pose(7, 3, 1.5, 1.0);
pause(0.3);
there = vehicle.get('ground_truth');
vehicle.reset();
pause(0.3);
back = vehicle.get('ground_truth');
printf('%.2f\\n', there.position, there.heading, back.position);
vehicle.fail('front_right');
vehicle.fail('front_right', 'efficiency', 0.5);
vehicle.repair('front_right');
vehicle.disarm();
vehicle.arm();
"""


def test_poses_are_set_and_reset(tmp_path: Path, gateway: JsonGateway) -> None:
    figures = [float(line) for line in run(tmp_path, gateway, SIMULATION)]
    assert figures == pytest.approx([7, 3, 1.5, 1.0, 4, 4, 2], abs=0.4)


PICTURES = """
picture = vehicle.camera();
[echoes, sonar] = vehicle.sonar();
scan = vehicle.laser();
map = vehicle.map();
printf('%s %d %d %d\\n', class(picture), size(picture));
printf('%d\\n', all(size(echoes) == [sonar.bins numel(sonar.beams)]) && max(echoes(:)) > 0);
printf('%s %d %d %d\\n', class(scan.ranges), numel(scan.ranges), isreal(scan.ranges), any(scan.ranges > 0));
printf('%s %d %d %.2f %g\\n', class(map.occupied), size(map.occupied), map.resolution, map.south);
imwrite(picture, 'octave.png');
"""


def test_pictures_scan_and_map_are_read(tmp_path: Path, gateway: JsonGateway, fleet: Fleet) -> None:
    """A picture has the orientation and colours that Pillow decodes from the same bytes."""
    image = pytest.importorskip("PIL.Image")
    fleet["uuv1"].stop()  # the picture then stays nearly the same
    picture, echoes, scan, known = run(tmp_path, gateway, PICTURES)
    assert picture == "uint8 48 64 3"
    assert echoes == "1"
    assert scan == "double 91 1 1"
    rows, columns = map(int, known.split()[1:3])
    cells = fleet["uuv1"].newest("map")
    assert known.split() == ["logical", str(rows), str(columns), "0.25", f"{cells.south:g}"]
    assert (rows * columns, columns) == (len(cells.cells), cells.columns)
    sent = fleet["uuv1"].newest("camera/image_raw")
    ours = image.frombytes("RGB", (sent.width, sent.height), sent.data).resize((4, 3), image.Resampling.BOX)
    theirs = image.open(tmp_path / "octave.png").convert("RGB").resize((4, 3), image.Resampling.BOX)
    differences = [abs(a - b) for a, b in zip(ours.tobytes(), theirs.tobytes(), strict=True)]
    assert max(differences) < 30


def test_a_jpeg_picture_is_read(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    pytest.importorskip("PIL", reason="JPEG needs Pillow")
    folder = tmp_path_factory.mktemp("jpeg")
    with seeing_vehicle(folder, "jpeg") as fleet, JsonGateway(fleet, "127.0.0.1", 0) as gateway:
        lines = run(tmp_path, gateway, "printf('%s %d %d %d\\n', class(vehicle.camera()), size(vehicle.camera()));")
    assert lines == ["uint8 48 64 3"]


ATTEMPT = """
function attempt(what)
  try
    what();
    disp('nothing');
  catch problem
    printf('%s|%s\\n', problem.identifier, problem.message);
  end
end
"""


def test_another_master_is_named_in_the_error(tmp_path: Path, gateway: JsonGateway, fleet: Fleet) -> None:
    with hil.connect(*fleet.endpoints, take_over=True) as other:
        other["uuv1"].drive(surge=0.1)
        assert wait_for(fleet["uuv1"].client.refusal)
        script = f"{ATTEMPT}attempt(@() vehicle.drive('surge', 0.1)); attempt(@() vehicle.set_pose(4, 4, 2));"
        for line in run(tmp_path, gateway, script):
            assert line.startswith("uuv:refused|uuv1 is commanded by another master")
            assert "end that one first, or take over with --take-over" in line


LOSS = """
disp('ready'); fflush(stdout);
attempt(@() vehicle.wait(60));
attempt(@() vehicle.drive('surge', 0.1));
disp('vehicle'); fflush(stdout);
attempt(@() arrayfun(@(k) try_again(vehicle), 1:1e6));
"""


def test_a_lost_vehicle_and_a_lost_gateway_are_named(tmp_path: Path) -> None:
    scenario, port = write_scenario(tmp_path)
    listen = free_port()
    script = f"""{ATTEMPT}
function x = try_again(vehicle)
  x = 0;
  try
    vehicle.status();
  catch problem
    if ~strcmp(problem.identifier, 'uuv:refused')
      rethrow(problem);
    end
  end
end
vehicle = uuv.Vehicle('uuv1', uuv.Gateway('127.0.0.1', {listen}));
vehicle.go_to(8, 8, 2);{LOSS}"""
    with Program(tmp_path, "slave", scenario) as slave:
        slave.expect("ready")
        endpoint = f"tcp/127.0.0.1:{port}"
        with Program(tmp_path, "gateway", "json", "--connect", endpoint, "--listen", f"127.0.0.1:{listen}") as serving:
            serving.expect("uuv1")
            write_script(tmp_path / "loss.m", script)
            command = ["octave-cli", "--norc", "--quiet"]
            with Program(tmp_path, "loss.m", command=command, cwd=tmp_path) as octave:
                octave.expect("ready")
                slave.stop(signal.SIGTERM)
                octave.expect(r"vehicle\n")
                lost = r"(uuv1 .*its slave has ended|no vehicle 'uuv1' .*is `uuv-hil slave` running)"
                octave.expect(rf"ready\nuuv:(over|refused)\|.*{lost}.*\nuuv:refused\|.*{lost}")
                serving.stop(signal.SIGTERM)
                octave.expect(rf"uuv:lost\|the connection to the gateway at 127.0.0.1:{listen} has ended")
                assert octave.wait() == 0
