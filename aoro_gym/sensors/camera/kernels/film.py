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
    seed: int  # of the noise ...
    world: int  # ... and which of the pictures of this seed it is


@wp.kernel(enable_backward=False)
def expose(
    radiance: wp.array3d(dtype=wp.vec3),
    films: wp.array(dtype=Film),
    numbers: wp.array4d(dtype=wp.uint16),
):
    """Numbers of the converter of a pixel, for its red, green and blue."""
    n, row, column = wp.tid()
    film = films[n]
    state = wp.rand_init(film.seed, (film.world * radiance.shape[1] + row) * radiance.shape[2] + column)
    for band in range(3):
        mean = wp.max(radiance[n, row, column][band] * film.electrons[band], 0.0)
        held = mean
        if film.noisy:
            if mean < 1.0e4:
                held = float(wp.poisson(state, mean))
            else:  # Poisson's law is normal within 1 % of its deviation
                held = mean + wp.sqrt(mean) * wp.randn(state)
        held = wp.min(held, film.full)
        if film.noisy:
            held += film.read * wp.randn(state)
        number = wp.clamp(wp.round(held / film.step + film.black), 0.0, film.most)
        numbers[n, row, column, band] = wp.uint16(number)
