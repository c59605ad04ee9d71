"""A vehicle that is served by `uuv-hil gateway rosbridge`."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.support.processes import Program, free_port, write_scenario


@contextmanager
def served_vehicle(folder: Path) -> Iterator[str]:
    """Provide the address with its token, once the vehicle uuv1 is there."""
    path, port = write_scenario(folder)
    with Program(folder, "slave", path) as slave:
        slave.expect("ready")
        with Program(
            folder, "gateway", "rosbridge", "--connect", f"tcp/127.0.0.1:{port}", "--listen", free_port()
        ) as gateway:
            gateway.expect("connected: uuv1")
            yield gateway.expect(r"ws://\S+").group()
