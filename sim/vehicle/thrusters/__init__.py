"""Thrusters: from pulse widths to the wrench on the vehicle. `model` is one thruster, `bank` those of a vehicle.

`curves` and `t200` are models that a vehicle's file selects. `propulsion` are thrusters with a battery. These modules
are loaded only for a vehicle that needs them.

Public: `model.Thruster`, `bank.ThrusterSet`, `azimuth`, `curves`, `t200`. It must not know the water around the
vehicle.
"""
