"""Thrusters: from pulse widths to the wrench on the vehicle. `model` is one thruster, `bank` those of a vehicle.

`curves`, `lags` and `t200` are models that a vehicle's file selects (read by `tables`). `propulsion` are thrusters with
such models or with a battery. These modules are loaded only for a vehicle that needs them.

Public: `model.Thruster`, `bank.ThrusterSet`, `tables.read_curve`, `azimuth`, `curves`, `lags`, `t200`. It must not
know the water around the vehicle.
"""
