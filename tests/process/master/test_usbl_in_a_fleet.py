"""A fleet of a vessel and an AUV in processes of their own: the vessel receives the AUV's position by USBL."""

from contextlib import ExitStack
from pathlib import Path

from hil.cases.target_hunting import members_on_free_ports
from hil.scenario.variant import write_variant
from tests.support.processes import Program


def test_a_vessel_receives_the_auvs_position(tmp_path: Path) -> None:
    """The AUV starts 20 m south of the vessel; both drift a little until the first message."""
    members = members_on_free_ports("vessel_and_auv")
    path = write_variant("vessel_and_auv", str(tmp_path), {"member": members, "modem.usbl_period": 0.6})
    with ExitStack() as stack:
        for member in members:
            stack.enter_context(Program(tmp_path, "slave", path, "--member", member["node"])).expect("ready")
        stack.enter_context(Program(tmp_path, "fleet", "channel", path)).expect("acoustic modems")
        echo = "topic", "echo", "/vessel/modem_position", "--connect", members[0]["listen"]
        received = stack.enter_context(Program(tmp_path, *echo))
        received.expect(r"frame_id: auv\n.*\n.*\n.*\n.*x: .*\n.*y: -[12]\d\.\d+\n.*z: -(9|1\d)\.")
