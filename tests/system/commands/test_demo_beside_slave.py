"""A demo where a slave runs already."""

import signal
from pathlib import Path

from tests.support.processes import Program, write_scenario


def test_a_slave_that_is_already_running_is_not_commanded(tmp_path: Path) -> None:
    scenario, _ = write_scenario(tmp_path)
    scenario.write_text(scenario.read_text().replace("goal = [8, 7]", "goal = [5.5, 5]"))
    folder = tmp_path / "run"
    with Program(tmp_path, "slave", scenario) as outsider:
        outsider.expect("ready")
        with Program(tmp_path, "demo", scenario, "--output", folder) as demo:
            assert demo.wait() == 4, demo.output
        (line,) = demo.output.strip().splitlines()
        free = line.rpartition(" ")[2]
        with Program(tmp_path, "demo", scenario, "--output", folder, "--listen", free) as demo:
            assert demo.wait() == 0, demo.output
        assert "goal reached" in demo.output
        assert "to the first sample" in " ".join(demo.output.split())
        assert "thrusters armed" in (folder / "slave.log").read_text()
        assert outsider.stop(signal.SIGTERM) == 0
    assert "thrusters armed" not in outsider.output
