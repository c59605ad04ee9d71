"""Noise on the line of a CAN adapter, which drivers of others decode: in a slave beside the measured one."""

import random
from collections.abc import Callable
from contextlib import closing

from hil.common.children import module_command
from hil.common.errors import NetworkError
from hil.common.ports import free_ports
from hil.links.wires.terminal import PtyWire
from tools.faults.rig import START_S, Rig
from tools.faults.rows import Fault

NOISE = 100_000  # bytes
PIECE_S = 0.001  # between pieces of 40 bytes, a fast line's pace
DRIVERS = ("serial", "seeedstudio", "slcan")
STARTS = (b"", b"\xaa", b"\xaa\xaa", b"\rT", b"\rt8")  # of these drivers' frames


def _noise(driver: str) -> Callable[[Rig], None]:
    """Let a slave at such an adapter read noise; it must run on, and end as usual."""

    def apply(rig: Rig) -> None:
        with closing(PtyWire()) as adapter:
            link = (f'link.port="can:{driver}:{adapter.path}"', 'link.protocol="vesc"')
            words = [str(rig.scenario), "--listen", f"tcp/127.0.0.1:{free_ports(1)[0]}"]
            command = module_command("hil.cli", "slave", *words, *(f"--set={change}" for change in link))
            generator, written = random.Random(1), 0
            with rig.beside(driver, command, "ready") as slave:
                end_s = rig.pause(0.0) + START_S
                while written < NOISE and slave.running and rig.pause(PIECE_S) < end_s:
                    written += adapter.write(generator.choice(STARTS) + generator.randbytes(40))
                    adapter.read()
            if written < NOISE:
                raise NetworkError(f"the slave at can:{driver} has read {written} bytes only")

    return apply


FAULTS = tuple(
    Fault("driver", f"noise on can:{driver}", _noise(driver), lambda _: None, cuts=False, hold_s=0.0)
    for driver in DRIVERS
)
