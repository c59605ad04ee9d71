"""Doppler velocity logs: Water Linked's A50 and A125 (`unit`) in all their formats, and Teledyne's `pathfinder`.

Public: the classes that `hil.instruments.table` names. They must not know wires: bytes come in and go out.
"""
