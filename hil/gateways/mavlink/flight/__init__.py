"""Modes, sticks, targets and missions: from what a person wants to the command of the vehicle.

Public: `pilot.Pilot`, `mission_flight.MissionFlight`, `modes`, `targets`. It must not use sockets or a clock, nor know
who sent a packet.
"""
