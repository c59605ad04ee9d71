"""Underwater communication between vehicles by sound or by light: what arrives where, when, and with which losses.

Public: a class each in `acoustic` and `optical`. It must not know the network that carries messages between processes.
"""
