"""Pictures of validation.md, a module for each part of the simulator; `tools/pages/validation.py` draws them."""
