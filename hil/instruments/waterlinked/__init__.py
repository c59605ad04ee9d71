"""Instruments of Water Linked.

Public: the classes that `hil.instruments.table` names. They must not know wires: bytes come in and go out.
"""
