"""The sensors, one file each. They share one error model and one table of their classes.

Public: `kinds.SENSORS`, the table of them, and `sensor_set.select_sensors`; also `error`, `extra_samples`,
`magnetometer`, `mounting`, `own`, `pressure`, `samples`, `variances`. It must not use messages, nor depend on their
receivers.
"""
