"""What a driver sees at the wires of a vehicle's instruments, and how late.

Public: every module here. They read the bytes by themselves and must not use the codecs of `hil.instruments`.
"""
