"""JSON Schemas of all files, made from the records that read them, for editors of TOML.

`schema(kind)` of `hil.schemas.files` returns one, `KINDS` lists them. `hil.schemas.meanings` has what each key means,
for schemas and for the reference pages. The room knows every record and no command; nothing but commands imports it.
"""
