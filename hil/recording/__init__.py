"""Recordings in MCAP: write, read, index, receive from the network, play back, check a run bit by bit.

Public: `hil.recording.recorder`, `hil.recording.reader`. It must not know the slave's loop.
"""
