"""From pulse widths to the wrench of all thrusters: `model` is the record of one, `bank` the thrusters of a vehicle.

`curves`, `lags` and `t200` are models that a vehicle's file selects (`tables` reads them), `propulsion` the thrusters
that have such models or a battery. None of these is loaded for a vehicle that does without.
"""
