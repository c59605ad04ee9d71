"""The vehicle's instruments at their wire: each sensor as the device that a vehicle's own computer reads.

An instrument is a codec without I/O, one file each: samples in, bytes out; bytes of its clients in, settings and
answers out. One transport layer serves all of them, in a process of their own beside the slave.

Public: `contract`, from which an instrument derives (entry points of the kind "instruments" add others), and `table`,
their names; `process` serves them, `station` says what was sent. They know the Python interface to vehicles
(`hil.client`) and the simulated sensors (`sim`), and they must not know slaves.
"""
