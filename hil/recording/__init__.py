"""Recordings in MCAP: write, read, index, receive from the network, play back, check a run bit by bit.

Public: `recorder`, `reader`, `check`, `events`, `mcap_file`, `mcap_writer`, `player`, `run`, `stamps`, `tap`. It must
not know the slave's loop.
"""
