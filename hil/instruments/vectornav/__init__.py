"""VectorNav's inertial units at their wire: registers, ASCII lines and binary outputs.

Public: `unit`, the instrument; also `outputs`. They must not know wires or the network.
"""
