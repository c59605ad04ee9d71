"""JSON Schemas of all files, generated from the records that parse them, for TOML editors.

Public: `schema(kind)` and `KINDS` of `hil.schemas.files`, and `hil.schemas.meanings`, the meaning of each key, for
schemas and reference pages. This package imports the records and must not import commands.
"""
