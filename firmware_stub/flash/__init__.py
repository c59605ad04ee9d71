"""Writing a shipped image to a board: by a debug probe (pyOCD) or by the USB bootloader in the chip's ROM (dfu-util).

`content.py` is what is written, the wiring, and the check that chip and image match; `probe.py` and `dfu.py` write it.
Both have been tried with emulated chips only. This package prints nothing and asks nobody.
"""
