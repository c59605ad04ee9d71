"""Wires that carry a link's bytes or CAN frames: terminals, sockets, CAN buses, and a wire with injected faults.

Public: the classes of wires, which `hil.links.address` opens, and `faults.Faults`; also `can_frame`, `net`, `pty_name`,
`suspension`, `terminal`. It must not know protocols.
"""
