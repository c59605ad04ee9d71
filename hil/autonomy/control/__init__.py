"""Controllers, thruster allocation, and the vehicle model that they use.

Public: `controller.VelocityCommand` and `controller.CascadedController`, `allocation.Allocator`, and
`families.make_controller` for all other control laws. It must not know paths, fleets, or where measurements come from.
"""
