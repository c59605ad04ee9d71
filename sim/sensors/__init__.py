"""The sensors, one file each. They share one error model and one table of their classes.

Public: `sensor_set.SENSORS`, the table of their classes, and `sensor_set.select_sensors`; also `error`,
`extra_samples`, `magnetometer`, `mounting`, `own`, `pressure`, `samples`, `variances`. It must not use messages, nor
depend on their receivers.
"""
