"""Thruster messages as a binary frame that a TOML file describes.

Public: `protocol.open_frame`; `layout.FrameLayout`, the file's record; `check`, which explains captured bytes; also
`checksums`, `forms`. It must not know a particular frame, nor the wire.
"""
