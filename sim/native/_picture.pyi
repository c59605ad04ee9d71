from collections.abc import Sequence

# Whatever the buffer protocol takes: array, memoryview, numpy.
Buffer = object

def shade(
    settings: Sequence[float],
    distances: Buffer,
    normals: Buffer,
    objects: Buffer,
    toward: Buffer,
    colours: Buffer,
    grain: Buffer,
    fades: Buffer,
    depths: Buffer,
    texture: Buffer,
    out: Buffer,
    /,
) -> None: ...
def develop(
    gain: float,
    full_well: float,
    dark: float,
    radiance: Buffer,
    falloff: Buffer,
    noise: Buffer,
    grey: Buffer,
    pixels: Buffer,
    /,
) -> None: ...
