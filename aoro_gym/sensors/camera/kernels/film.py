"""From light to numbers: photons, electrons with their noise, and the converter's steps (EMVA standard 1288, release 4)."""

import warp as wp


@wp.struct
class Film:
    """A sensor for one exposure."""

    electrons: wp.vec3  # of a radiance of 1 W/(m² sr) in red, green and blue over the exposure
    full: float  # electrons that a pixel holds
    read: float  # standard deviation [electrons] of dark noise
    step: float  # electrons of a step of the converter
    most: float  # its largest number
    black: float  # its number in the dark, so that noise is not cut off
    noisy: bool


@wp.kernel(enable_backward=False)
def expose(radiance: wp.array3d(dtype=wp.vec3), film: Film, seed: int, numbers: wp.array3d(dtype=wp.vec3)):
    """Numbers of the converter of a pixel, for its red, green and blue."""
    world, row, column = wp.tid()
    state = wp.rand_init(seed, (world * radiance.shape[1] + row) * radiance.shape[2] + column)
    for band in range(3):
        mean = wp.max(radiance[world, row, column][band] * film.electrons[band], 0.0)
        held = mean
        if film.noisy:
            if mean < 1.0e4:
                held = float(wp.poisson(state, mean))
            else:  # Poisson's law is normal within 1 % of its deviation
                held = mean + wp.sqrt(mean) * wp.randn(state)
        held = wp.min(held, film.full)
        if film.noisy:
            held += film.read * wp.randn(state)
        numbers[world, row, column][band] = wp.clamp(wp.round(held / film.step + film.black), 0.0, film.most)
