"""Thrusters on VESC motor controllers, in their CAN protocol."""
