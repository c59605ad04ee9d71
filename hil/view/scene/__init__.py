"""Three-dimensional scene of the live view, and the server that draws it (viser).

Public: `server.SceneServer`; `world.WorldScene`, `vehicle.VehicleScene`, `sensors.SensorScene`, `fleet.FleetScene`. It
must not know where samples come from, nor command vehicles.
"""
