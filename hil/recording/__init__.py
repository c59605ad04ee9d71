"""Recordings in MCAP: write, read, index, tap the network, replay, check a run bit for bit.

Public: `hil.recording.recorder`, `hil.recording.reader`. It must not know the slave's loop.
"""
