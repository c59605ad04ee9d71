"""Underwater communication between vehicles by sound or light: which messages arrive where and when.

Public: `acoustic.AcousticChannel`, `optical_channel.OpticalChannel`, `optical`. It must not use the network that
carries messages between processes.
"""
