"""Pictures of docs/explanation/validation.md: one module per part of the simulator."""
