"""A vehicle that is served by `uuv-hil gateway rosbridge`, over a network that is not trusted."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hil.commands.keys import add_machine, init
from tests.support.processes import Program, free_port, write_scenario


@contextmanager
def served_vehicle(folder: Path) -> Iterator[str]:
    """Provide the address with its token, once the vehicle uuv1 is there."""
    init(str(folder))
    for machine in ("uuv1", "laptop"):
        add_machine(str(folder), machine, ["localhost"])
    security = f'[security]\nslave = "{folder}/uuv1"\nmaster = "{folder}/laptop"\nmay_command = ["laptop"]\n'
    path, port = write_scenario(folder, security)
    with Program(folder, "slave", path) as slave:
        slave.expect("ready")
        words = ("--connect", f"tcp/127.0.0.1:{port}", "--keys", folder / "laptop", "--listen", free_port())
        with Program(folder, "gateway", "rosbridge", *words) as gateway:
            gateway.expect("connected: uuv1")
            yield gateway.expect(r"ws://\S+").group()
