"""Two real slaves of one name behind one router: the second ends and names the first."""

from pathlib import Path

from tests.support.processes import Program, free_port, wait_for, write_scenario


def test_the_second_slave_of_a_name_ends(tmp_path: Path) -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    network = f'[network]\nmode = "routed"\nrouter = "{router}"\n'
    folders = [tmp_path / "first", tmp_path / "second"]
    scenarios = []
    for folder in folders:
        folder.mkdir()
        scenario, _ = write_scenario(folder)
        scenario.write_text(scenario.read_text() + network)
        scenarios.append(scenario)
    with Program(tmp_path, "router", "--listen", router) as program:
        program.expect("forwarding")
        with Program(folders[0], "slave", scenarios[0]) as first:
            first.expect("ready", 60)
            with Program(folders[1], "slave", scenarios[1]) as second:
                ended = wait_for(lambda: second.process.poll() is not None, 60)
                assert ended, f"the first:\n{first.output}\nthe second:\n{second.output}"
                assert second.process.returncode == 4
                assert f":{first.process.pid}; end that one" in second.output
                assert "thrusters neutral" in second.output
                assert "Traceback" not in second.output
            assert first.process.poll() is None
