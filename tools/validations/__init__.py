"""Pictures of docs/reference/validation.md: one module per part of the simulator."""
