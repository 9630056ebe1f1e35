"""Light from above: the sun, the clear and the overcast sky, and what the air adds on the way.

The clear sky is light scattered once: by molecules with the phase function 3/4 (1 + cos² γ), by aerosol with that of Henyey
and Greenstein (1941, Astrophys. J. 93), each times 1 - exp(-τ m), the share that is scattered out of a beam of air mass m
(Kasten 1965). The host scales both to the diffuse irradiance that it knows. The overcast sky is that of Moon and Spencer
(1942, Illum. Eng. 37): (1 + 2 cos Z) / 3 of the zenith's. Air takes radiance as Koschmieder (1924) has it,
L exp(-σ d) + A (1 - exp(-σ d)), A the radiance of the horizon.
"""

import warp as wp

STATE = wp.constant(wp.uint32(7))  # of the noise of the far tree line


@wp.struct
class Sky:
    """Light, red, green and blue each."""

    sun: wp.vec3  # unit, towards it
    sunlight: wp.vec3  # [W/m²] at right angles
    disc: float  # cosine of the sun's angular radius
    molecules: wp.vec3  # [W/(m² sr)] factor of what molecules scatter ...
    molecule_depth: wp.vec3  # ... and their optical depth
    aerosol: wp.vec3
    aerosol_depth: wp.vec3
    asymmetry: float  # g of the aerosol
    overcast: wp.vec3  # [W/(m² sr)] of an overcast zenith, as far as there are clouds
    diffuse: wp.vec3  # [W/m²] from all of the sky on level ground
    extinction: float  # σ [1/m] of the air
    airlight: wp.vec3  # A [W/(m² sr)]
    trees: float  # [rad] mean elevation of a far tree line; below -2: there is none
    trees_radiance: wp.vec3  # [W/(m² sr)]


@wp.func
def air_mass(cosine: float):
    """Kasten's (1965) air mass at a zenith's cosine, 0 on the horizon at least."""
    c = wp.clamp(cosine, 0.0, 1.0)
    zenith = wp.acos(c) * 57.29577951
    return 1.0 / (c + 0.15 * wp.pow(93.885 - zenith, -1.253))


@wp.func
def clear_radiance(sky: Sky, direction: wp.vec3):
    """Radiance [W/(m² sr)] of the clear part of the sky."""
    mass = air_mass(direction[2])
    cosine = wp.clamp(wp.dot(direction, sky.sun), -1.0, 1.0)
    molecules = 0.75 * (1.0 + cosine * cosine)
    g = sky.asymmetry
    base = 1.0 + g * g - 2.0 * g * cosine
    aerosol = (1.0 - g * g) / (base * wp.sqrt(base))
    out = wp.vec3()
    for band in range(3):
        out[band] = sky.molecules[band] * molecules * (1.0 - wp.exp(-sky.molecule_depth[band] * mass))
        out[band] += sky.aerosol[band] * aerosol * (1.0 - wp.exp(-sky.aerosol_depth[band] * mass))
    return out


@wp.func
def sky_radiance(sky: Sky, direction: wp.vec3):
    """Radiance [W/(m² sr)] from a direction above the horizon, without the sun's disc."""
    cloud = (1.0 + 2.0 * wp.max(direction[2], 0.0)) / 3.0
    return clear_radiance(sky, direction) + sky.overcast * cloud


@wp.func
def beyond(sky: Sky, direction: wp.vec3, with_sun: bool):
    """Radiance [W/(m² sr)] of what no surface hides: sky, the sun's disc, far trees; black below a bare horizon."""
    elevation = wp.asin(wp.clamp(direction[2], -1.0, 1.0))
    if sky.trees > -2.0:
        level = wp.sqrt(wp.max(1.0 - direction[2] * direction[2], 1.0e-6))
        around = wp.vec2(direction[0] / level, direction[1] / level)
        line = sky.trees * (1.0 + 0.35 * wp.noise(STATE, 9.0 * around) + 0.25 * wp.noise(STATE, 70.0 * around))
        line += 0.2 * sky.trees * wp.noise(STATE, 260.0 * around)
        if elevation < line:
            place = wp.vec3(150.0 * around[0], 150.0 * around[1], 130.0 * elevation)
            return sky.trees_radiance * (1.0 + 0.7 * wp.noise(STATE, place))
    if direction[2] <= 0.0:
        return wp.vec3()
    out = sky_radiance(sky, direction)
    if with_sun and wp.dot(direction, sky.sun) > sky.disc:
        out += sky.sunlight / (6.283185307 * (1.0 - sky.disc))
    return out


@wp.func
def through_air(sky: Sky, radiance: wp.vec3, distance: float):
    """What is left of a radiance after a way [m], with what the air adds."""
    share = wp.exp(-sky.extinction * distance)
    return radiance * share + sky.airlight * (1.0 - share)
