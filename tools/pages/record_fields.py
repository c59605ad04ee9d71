"""Extension of griffe: a record (NamedTuple) has the signature of its fields, so its page names them."""

from typing import Any

from griffe import Attribute, Class, Extension, Function, Parameter, ParameterKind, Parameters

FIELD = ParameterKind("positional or keyword")


class RecordFields(Extension):
    """Gives every NamedTuple the `__init__` that Python makes of its fields; griffe does so for dataclasses only."""

    def on_class(self, *, cls: Class, **_: Any) -> None:
        """Add `__init__` with the fields of `cls` as parameters, if it is a NamedTuple."""
        if not any(str(base).endswith("NamedTuple") for base in cls.bases):
            return
        fields = [
            Parameter(field.name, kind=FIELD, annotation=field.annotation, default=field.value)
            for field in cls.members.values()
            if isinstance(field, Attribute) and field.annotation is not None and "property" not in field.labels
        ]
        cls.set_member("__init__", Function("__init__", parameters=Parameters(*fields)))
