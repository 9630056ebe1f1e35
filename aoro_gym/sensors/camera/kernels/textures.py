"""What surfaces look like up close: bark, end grain, moss, litter, snow, mud, wetness, as functions of the place on them.

A texture changes the albedo that the table of materials gives, about its mean, and turns the normal a little, as bumps do.
Patterns are fractal noise (Perlin 1985, An image synthesizer) and cells (Worley 1996, A cellular texture basis function);
their sizes are estimated by eye (E). Wood is textured in its own axes, z along the grain; the rest in the world's.
"""

import warp as wp

from aoro_gym.sensors.camera.kernels.surfaces import BROAD, NEEDLES, PLAIN, UNDERGROWTH, Look, Seen
from aoro_gym.sensors.raytrace.device import Rays

FOREST_FLOOR, ASPHALT, GRAVEL, GRASS = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
WET_SOIL, LITTER, SNOW = wp.constant(4), wp.constant(5), wp.constant(6)
PINE_BARK, PINE_BARK_UPPER, SPRUCE_BARK, BIRCH_BARK = wp.constant(7), wp.constant(8), wp.constant(9), wp.constant(10)
END_GRAIN, ROCK, MOSSY_ROCK = wp.constant(11), wp.constant(15), wp.constant(16)
DEAD_WOOD, DWARF_SHRUBS = wp.constant(17), wp.constant(18)
MOSS = wp.constant(wp.vec3(0.065, 0.085, 0.03))  # albedo, as the forest floor's; (E)
NEEDLE_LITTER = wp.constant(wp.vec3(0.13, 0.085, 0.05))  # (E)
SNOW_ALBEDO = wp.constant(wp.vec3(0.91, 0.91, 0.90))  # of the table of materials
YELLOW = wp.constant(wp.vec3(0.30, 0.19, 0.035))  # birch leaves in autumn; (E)
RUST = wp.constant(wp.vec3(0.16, 0.06, 0.025))  # bilberry in autumn; (E)


@wp.struct
class Patch:
    """A small piece of a surface."""

    albedo: wp.vec3
    transmittance: wp.vec3  # of leaves
    normal: wp.vec3  # unit, with bumps
    gloss: float  # share of the surface below a film of water, [0, 1]
    roughness: float  # of that film


@wp.func
def smooth(low: float, high: float, value: float):
    """From 0 at ``low`` to 1 at ``high``, without corners."""
    t = wp.clamp((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


@wp.func
def fractal(seed: int, place: wp.vec3, octaves: int):
    """Noise of mean 0, about ± 1, each octave with half the size and six tenths of the depth of the one before."""
    state = wp.uint32(seed)
    total = float(0.0)
    depth = float(1.0)
    scale = float(1.0)
    for _ in range(octaves):
        total += depth * wp.noise(state, scale * place)
        depth *= 0.6
        scale *= 2.03
    return 1.5 * total


@wp.func
def bumps(seed: int, place: wp.vec3):
    """Three noises as a vector."""
    return wp.vec3(fractal(seed, place, 2), fractal(seed + 1, place, 2), fractal(seed + 2, place, 2))


@wp.func
def cells(seed: int, place: wp.vec3):
    """Distance to the nearest point of scattered ones, to the second nearest less that, and a number of the nearest one."""
    first = float(9.0)
    second = float(9.0)
    number = float(0.0)
    bx = int(wp.floor(place[0]))
    by = int(wp.floor(place[1]))
    bz = int(wp.floor(place[2]))
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-1, 2):
                i = bx + dx
                j = by + dy
                k = bz + dz
                mixed = wp.uint32(i) * wp.uint32(73856093) ^ wp.uint32(j) * wp.uint32(19349663)
                mixed = mixed ^ wp.uint32(k) * wp.uint32(83492791)
                state = wp.rand_init(int(mixed), seed)
                x = float(i) + wp.randf(state) - place[0]
                y = float(j) + wp.randf(state) - place[1]
                z = float(k) + wp.randf(state) - place[2]
                apart = wp.sqrt(x * x + y * y + z * z)
                if apart < first:
                    second = first
                    first = apart
                    number = wp.randf(state)
                elif apart < second:
                    second = apart
    return wp.vec3(first, second - first, number)


@wp.func
def bark(kind: int, albedo: wp.vec3, place: wp.vec3, seed: int):
    """Albedo of bark, and how deep its bumps are; place [m] in the wood's axes."""
    rough = float(0.25)
    colour = albedo
    if kind == PINE_BARK:
        warped = place + 0.012 * bumps(seed + 3, 14.0 * place)
        plates = cells(seed, wp.vec3(warped[0] / 0.045, warped[1] / 0.045, warped[2] / 0.12))
        furrow = smooth(0.02, 0.2, plates[1])
        scales = 1.0 + 0.35 * fractal(seed + 5, wp.vec3(60.0 * place[0], 60.0 * place[1], 18.0 * place[2]), 3)
        colour = albedo * (0.3 + 0.95 * furrow) * (0.75 + 0.5 * plates[2]) * scales
        rough = float(0.8)
    elif kind == PINE_BARK_UPPER:
        flakes = fractal(seed, wp.vec3(25.0 * place[0], 25.0 * place[1], 8.0 * place[2]), 4)
        colour = albedo * (1.0 + 0.4 * flakes)
        rough = float(0.35)
    elif kind == SPRUCE_BARK:
        plates = cells(seed, wp.vec3(place[0] / 0.016, place[1] / 0.016, place[2] / 0.022))
        grain = fractal(seed + 5, wp.vec3(20.0 * place[0], 20.0 * place[1], 5.0 * place[2]), 3)
        colour = albedo * (0.6 + 0.5 * smooth(0.0, 0.25, plates[1])) * (0.8 + 0.4 * plates[2]) * (1.0 + 0.4 * grain)
        rough = float(0.6)
    elif kind == BIRCH_BARK:
        dashes = fractal(seed, wp.vec3(11.0 * place[0], 11.0 * place[1], 110.0 * place[2]), 2)
        scars = fractal(seed + 5, wp.vec3(5.0 * place[0], 5.0 * place[1], 3.5 * place[2]), 4)
        dark = wp.max(
            smooth(0.55, 0.75, dashes), smooth(0.55, 0.8, scars + 0.35 * wp.exp(-1.2 * wp.max(place[2], 0.0)))
        )
        colour = albedo * (1.0 + 0.1 * scars) * (1.0 - 0.88 * dark)
        rough = float(0.2)
    else:  # grey wood without bark: cracks along the grain
        grain = fractal(seed, wp.vec3(70.0 * place[0], 70.0 * place[1], 2.5 * place[2]), 4)
        colour = albedo * (1.0 + 0.45 * grain)
        rough = float(0.4)
    return colour, rough


@wp.func
def end_grain(albedo: wp.vec3, place: wp.vec3, seed: int):
    """Albedo of a saw cut: year rings, rays, cracks, a darker heart."""
    r = wp.sqrt(place[0] * place[0] + place[1] * place[1])
    wobble = 1.0 + 0.08 * fractal(seed, wp.vec3(9.0 * place[0], 9.0 * place[1], 0.0), 2)
    ring = r * wobble / 0.0035
    late = smooth(0.45, 0.95, ring - wp.floor(ring))
    turn = wp.atan2(place[1], place[0])
    crack = smooth(0.8, 0.95, wp.noise(wp.uint32(seed + 3), wp.vec2(4.0 * turn, 3.0 * r)) + 0.3)
    heart = smooth(0.09, 0.05, r)
    stain = 1.0 + 0.2 * fractal(seed + 4, 14.0 * place, 3)
    tone = (1.1 - 0.35 * late) * (1.0 - 0.6 * crack) * stain
    return wp.cw_mul(albedo, wp.vec3(1.0, 1.0 - 0.15 * heart, 1.0 - 0.3 * heart)) * tone


@wp.func
def ground(kind: int, albedo: wp.vec3, place: wp.vec3, look: Look):
    """Albedo of the ground, how deep its bumps are, and how far water stands on it."""
    rough = float(0.5)
    water = float(0.0)
    colour = albedo
    flat = wp.vec3(place[0], place[1], 0.0)
    if kind == FOREST_FLOOR:
        patches = fractal(11, 0.55 * flat, 4)
        tufts = fractal(12, 22.0 * place, 3)
        needles = fractal(13, wp.vec3(55.0 * place[0], 160.0 * place[1], 0.0), 2)
        moss = smooth(-0.25, 0.3, patches) * (1.0 - 0.35 * look.autumn)
        colour = wp.lerp(NEEDLE_LITTER * (1.0 + 0.55 * needles), MOSS * (1.0 + 0.75 * tufts), moss)
        fallen = cells(14, place / 0.045)
        if fallen[2] < 0.08 + 0.3 * look.autumn and fallen[0] < 0.42:  # leaves on it
            colour = wp.lerp(NEEDLE_LITTER, YELLOW, look.autumn) * (0.5 + 2.0 * fallen[2])
        rough = float(0.9)
    elif kind == ASPHALT:
        stones = cells(15, place / 0.008)
        colour = albedo * (0.7 + 0.6 * stones[2]) * (1.0 + 0.25 * fractal(16, 1.5 * flat, 3))
        rough = float(0.2)
    elif kind == GRAVEL:
        stones = cells(17, place / 0.028)
        colour = albedo * (0.45 + 0.9 * stones[2]) * (0.5 + smooth(0.0, 0.3, stones[1]))
        colour = colour * (1.0 + 0.2 * fractal(18, 0.8 * flat, 3))
        rough = float(0.6)
    elif kind == GRASS:
        blades = fractal(19, wp.vec3(70.0 * place[0], 70.0 * place[1], 12.0 * place[2]), 3)
        patches = fractal(20, 0.9 * flat, 3)
        dry = smooth(0.1, 0.6, patches) * (0.35 + 0.65 * look.autumn)
        colour = wp.lerp(albedo, wp.vec3(0.2, 0.16, 0.07), dry) * (1.0 + 0.7 * blades)
        rough = float(1.0)
    elif kind == WET_SOIL:
        lumps = fractal(21, 6.0 * place, 4)
        colour = albedo * (1.0 + 0.5 * lumps)
        water = smooth(0.05, -0.15, fractal(22, 0.9 * flat, 3) + 0.4 * lumps)
        rough = 0.8 * (1.0 - water)
        water = wp.max(water, 0.3)
    elif kind == LITTER:
        leaves = cells(23, place / 0.04)
        colour = albedo * (0.5 + leaves[2]) * (0.6 + 0.6 * smooth(0.0, 0.2, leaves[1]))
        rough = float(0.8)
    elif kind == SNOW:
        colour = albedo * (1.0 + 0.03 * fractal(24, 8.0 * place, 3))
        rough = float(0.25)
    else:
        spots = fractal(25, 9.0 * place, 4)
        grains = cells(26, place / 0.006)
        colour = albedo * (0.8 + 0.4 * grains[2]) * (1.0 + 0.3 * spots)
        if kind == MOSSY_ROCK:
            colour = wp.lerp(colour, MOSS * (1.0 + 0.7 * fractal(27, 25.0 * place, 3)), smooth(-0.35, 0.0, spots))
        elif spots > 0.42:  # lichen
            colour = wp.lerp(colour, wp.vec3(0.42, 0.45, 0.38), smooth(0.42, 0.6, spots))
        rough = float(0.7)
    return colour, rough, water


@wp.func
def leaf(kind: int, albedo: wp.vec3, seed: int, place: wp.vec3, autumn: float):
    """Albedo of needles and leaves: each plant and each twig its own shade; what has turned is yellow or red."""
    tree = wp.randf(wp.rand_init(seed, 5))
    twig = fractal(seed, 2.5 * place, 2)
    colour = wp.cw_mul(albedo, wp.vec3(1.0 + 0.25 * twig, 1.0 + 0.2 * twig, 1.0)) * (0.8 + 0.4 * tree)
    if kind == BROAD:
        turned = smooth(0.0, 0.5, autumn * 1.5 - 0.6 * tree + 0.3 * twig - 0.3)
        colour = wp.lerp(colour, YELLOW * (0.8 + 0.4 * tree), turned)
    if kind == DWARF_SHRUBS:
        colour = wp.lerp(colour, RUST, autumn * smooth(-0.3, 0.5, twig))
    return colour


@wp.func
def covered(look: Look, patch: Patch, place: wp.vec3, side: wp.vec3):
    """The patch with snow where its surface, of the normal ``side``, faces up, and wet."""
    out = patch
    if look.snow > 0.0:
        lies = 1.15 - look.snow + 0.15 * fractal(31, 3.0 * place, 3)
        share = smooth(lies - 0.12, lies + 0.12, side[2])
        out.albedo = wp.lerp(patch.albedo, SNOW_ALBEDO, share)
        out.transmittance = patch.transmittance * (1.0 - share)
        out.gloss = patch.gloss * (1.0 - share)
    film = wp.max(out.gloss, look.wetness)
    if (
        film > 0.0
    ):  # water of index n = 1.33 lets less of the light out again that a surface scatters (Lekner and Dorf 1988)
        for band in range(3):
            a = out.albedo[band]
            wet = a * (1.0 - 0.44) / (1.0 - 0.44 * a)  # 44 % of diffuse light turns back at the water's surface
            out.albedo[band] = a + film * (wet - a)
    out.gloss = wp.max(out.gloss, 0.35 * look.wetness)
    return out


@wp.func
def patch_of(rays: Rays, look: Look, seen: Seen, direction: wp.vec3):
    """What a ray's surface is like where it was met."""
    out = Patch()
    kind = look.texture[seen.hit.kind]
    out.albedo = look.albedo[seen.hit.kind]
    out.normal = seen.hit.normal
    out.roughness = 0.3
    if kind == PLAIN:
        return covered(look, out, seen.place, seen.hit.normal)
    instance = wp.max(seen.hit.instance, 0)
    place = seen.place
    pose = wp.transform_identity()
    if instance < look.poses.shape[0] and instance > 0:
        pose = look.poses[instance]
        place = wp.transform_point(wp.transform_inverse(pose), seen.place)
    rough = float(0.0)
    scale = float(40.0)
    if (kind >= PINE_BARK and kind <= BIRCH_BARK) or kind == DEAD_WOOD:
        axis = wp.transform_vector(pose, wp.vec3(place[0], place[1], 0.0))
        if wp.length(axis) > 1.0e-4:
            outward = wp.normalize(axis)
            if wp.dot(outward, out.normal) > 0.8:  # the polygons stand for round wood
                out.normal = outward
        colour, rough = bark(kind, out.albedo, place, instance)
        mossy = 0.45 * out.normal[1] + 0.5 * fractal(instance + 9, 7.0 * seen.place, 3) - 1.3 * place[2] + 0.1
        if instance > 0 and kind != BIRCH_BARK:  # at the foot, most on the side away from the sun
            colour = wp.lerp(colour, MOSS, 0.85 * smooth(0.0, 0.3, mossy))
        out.albedo = colour
        scale = float(25.0)
    elif kind == END_GRAIN:
        out.albedo = end_grain(out.albedo, place, instance)
        rough = float(0.1)
    elif (kind >= NEEDLES and kind <= BROAD) or kind == DWARF_SHRUBS:
        seed = instance
        if seen.hit.instance == UNDERGROWTH:
            seed = int(wp.floor(seen.place[0] * 20.0)) + 977 * int(wp.floor(seen.place[1] * 20.0))
        shade = leaf(kind, out.albedo, seed, seen.place, look.autumn)
        out.transmittance = look.transmittance[seen.hit.kind] * (shade[1] / wp.max(out.albedo[1], 1.0e-3))
        out.albedo = shade
        rough = float(0.5)
        scale = float(60.0)
    else:
        colour, rough, water = ground(kind, out.albedo, seen.place, look)
        out.albedo = colour
        out.gloss = water
        out.roughness = 0.02 + 0.3 * (1.0 - water)
        scale = float(14.0)
    turned = wp.normalize(out.normal + 0.6 * rough * bumps(instance + 40, scale * seen.place))
    if wp.dot(turned, direction) > -0.05:
        turned = wp.normalize(turned - direction * (wp.dot(turned, direction) + 0.05))
    out.normal = turned
    for band in range(3):
        out.albedo[band] = wp.clamp(out.albedo[band], 0.0, 0.95)
    return covered(look, out, seen.place, seen.hit.normal)
