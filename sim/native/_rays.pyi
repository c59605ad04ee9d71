from collections.abc import Sequence

# Whatever the buffer protocol takes: array, memoryview, numpy.
Buffer = object

def grow(mesh: Buffer, nodes: Buffer, triangles: Buffer, root: int, group: int, /) -> int: ...

class Caster:
    def __new__(
        cls,
        ground: tuple[int, int, float, float, float, float],
        depths: Buffer,
        solids: Buffer,
        nodes: Buffer,
        triangles: Buffer,
        /,
    ) -> Caster: ...
    def cast(
        self,
        origin: Sequence[float],
        rotation: Sequence[float],
        directions: Buffer,
        reach: float,
        distances: Buffer,
        points: Buffer = ...,
        normals: Buffer = ...,
        objects: Buffer = ...,
        /,
    ) -> None: ...
    def geometry(self) -> object: ...
