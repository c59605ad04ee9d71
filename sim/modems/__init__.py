"""Underwater communication between vehicles by sound: which messages arrive where and when.

Public: `acoustic.AcousticChannel`, `usbl.UsblRounds`. It must not use the network that carries messages between
processes.
"""
