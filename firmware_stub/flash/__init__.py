"""Write a shipped image to a board: by a debug probe (pyOCD), or by the USB bootloader in the chip's ROM (dfu-util).

Public: `content.py` has the content, the wiring, and the check that chip and image match; `probe.py` and `dfu.py`
write it. Both were tested with emulated chips only. It must not print or prompt.
"""
