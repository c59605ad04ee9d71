"""Instruments of the ping protocol: Blue Robotics Ping1D, Ping2 and Ping360, Cerulean S500."""
