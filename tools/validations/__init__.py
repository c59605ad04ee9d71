"""The pictures of the page validation.md, a module for each part of the simulator. `tools/validation.py` draws them."""
