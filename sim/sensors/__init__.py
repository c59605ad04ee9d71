"""The sensors, one file each; they share one error model and one table of what they send.

Public: `sensor_set.SENSORS`, the table, and `sensor_set.fit`. It must not use messages, nor depend on their receivers.
"""
