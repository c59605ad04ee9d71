"""JSON Schemas of all files, made from the records that read them, for editors of TOML.

Public: `schema(kind)` and `KINDS` of `hil.schemas.files`, and `hil.schemas.meanings`, the meaning of each key, for
schemas and for the reference pages. It uses every record and must not know commands.
"""
