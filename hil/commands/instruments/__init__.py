"""`uuv-hil instruments`: serve a vehicle's instruments at their wires, and check what a driver sees of them."""
