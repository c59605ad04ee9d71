"""Give a package its public names, each imported on first use."""

TYPE_CHECKING = False  # as typing has it, which a lean process does not load for this
if TYPE_CHECKING:
    from typing import Any


def public_name(package: str, public: "dict[str, tuple[str, ...]]", name: str) -> "Any":
    """Return a public name of a package from its module, imported now. Raises AttributeError for any other name."""
    from importlib import import_module

    for module, names in public.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {package!r} has no attribute {name!r}")
