"""Wires that carry a link's bytes or CAN frames: terminals, sockets, CAN buses, and a wire with injected faults."""
