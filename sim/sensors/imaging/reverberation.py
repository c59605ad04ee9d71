"""Reverberation of the water: echoes of bubbles, plankton and silt at all ranges of a sonar's beams.

The water scatters back the share s_v of the intensity per m³ and sr (10 lg s_v is `volume_strength`, dB re 1/m; Urick
1983, chapter 8). With the beam pattern b and a range bin of dr:

    echo / source = s_v b² dO dr / r² 10^(-2 alpha r / 10)

summed over the directions of a beam in which no ray has hit anything before r: objects cast shadows in the water, too.
"""

import numpy as np

from sim.sensors.imaging.echoes import Bins, Echoes, Floats


def volume_echoes(echoes: Echoes, bins: Bins, weights: Floats, strength: float) -> Floats:
    """Return the echoes of the water by beam and bin (beams x bins, echo / source).

    `weights` are b² dO of the aperture's own rays (beams x rays), `strength` is 10 lg s_v (dB re 1/m).
    """
    beams, rays = weights.shape
    middles = bins.middles
    met = np.clip((echoes.ranges[: beams * rays] - bins.first) / bins.step, 0.0, bins.count).astype(np.int64)
    width = bins.count + 1
    ends = np.bincount(np.repeat(np.arange(beams) * width, rays) + met, weights.ravel(), beams * width)
    blocked = np.cumsum(ends.reshape(beams, width), axis=1)[:, : bins.count]
    free = np.maximum(weights.sum(axis=1)[:, None] - blocked, 0.0)
    law = bins.step / np.maximum(middles, bins.step) ** 2 * 10.0 ** (0.1 * strength - 0.2 * bins.absorption * middles)
    echoed: Floats = free * law
    return echoed
