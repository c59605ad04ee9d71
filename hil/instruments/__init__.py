"""The vehicle's instruments at their wire: each sensor as the device that a vehicle's own computer reads.

An instrument is a codec without I/O: samples in, bytes out; bytes of its clients in, settings and answers out. What is
data of a device (messages, registers, limits, values at power on) stands in devices/NAME.toml. One transport layer
serves all of them, in a process of their own beside the slave.

Public: `contract`, from which an instrument derives (entry points of the kind "instruments" add others), and `table`,
their names; `process` serves them, `station` says what was sent. They know the Python interface to vehicles
(`hil.client`) and the simulated sensors (`sim`), and they must not know slaves.
"""
