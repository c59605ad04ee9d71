"""The pictures of docs/validation.md, a module for each part of the simulator. `tools/validation.py` draws them."""
