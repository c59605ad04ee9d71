"""A recorder that stands in for viser's scene."""

from typing import Any


class Handle:
    """An added item; `removed` is set once it has been removed."""

    def __init__(self) -> None:
        self.removed = False

    def remove(self) -> None:
        """Remove it from the scene."""
        self.removed = True


class Recorder:
    """A scene that stores the items added to it, by name: kind, arguments, options."""

    def __init__(self) -> None:
        self.added: dict[str, tuple[str, tuple[Any, ...], dict[str, Any]]] = {}
        self.handles: dict[str, Handle] = {}
        self.scene = self

    def __getattr__(self, kind: str) -> Any:
        def add(name: str, *arguments: Any, **options: Any) -> Handle:
            self.added[name] = kind, arguments, options
            self.handles[name] = Handle()
            return self.handles[name]

        return add
