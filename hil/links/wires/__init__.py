"""What carries a link's bytes or CAN frames: terminals, sockets, buses, and faults made on purpose."""
