from collections.abc import Sequence

# Whatever the buffer protocol takes: array, memoryview, numpy.
Buffer = object

def picture(
    geometry: object,
    settings: Sequence[float],
    colours: Buffer,
    grain: Buffer,
    decays: Buffer,
    depths: Buffer,
    texture: Buffer,
    directions: Buffer,
    radiance: Buffer,
    ranges: Buffer,
    objects: Buffer,
    /,
) -> None: ...
def develop(
    key: int,
    numbers: tuple[float, float, float, float, float],
    light: Buffer,
    falloff: Buffer,
    axial: Buffer,
    ranges: Buffer,
    quantiles: Buffer,
    grey: Buffer,
    pixels: Buffer,
    depths: Buffer,
    /,
) -> None: ...
