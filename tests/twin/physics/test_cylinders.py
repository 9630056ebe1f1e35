"""A cylinder on a hinge against its pins' coordinates."""

# Device code: its types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import pytest
import warp as wp

from aoro_gym.twin.physics.cylinders import Linkage, cylinder_extension
from tests.twin.physics.launch import ROUNDOFF, columns, launch, record


@wp.kernel(enable_backward=False)
def extension_kernel(
    linkage: wp.array(dtype=Linkage),
    angle: wp.array(dtype=float),
    extension: wp.array(dtype=float),
    lever: wp.array(dtype=float),
):
    i = wp.tid()
    length, arm = cylinder_extension(linkage[i], angle[i])
    extension[i] = length
    lever[i] = arm


def pins(linkage, angle):
    """The hinge at the origin, one pin on the x axis, the other at γ: positions (n, 2)."""
    gamma = linkage.g0 + angle
    first = np.stack([linkage.a, np.zeros_like(linkage.a)], axis=-1)
    second = np.stack([linkage.b * np.cos(gamma), linkage.b * np.sin(gamma)], axis=-1)
    return first, second


def length(linkage, angle):
    first, second = pins(linkage, angle)
    return np.linalg.norm(second - first, axis=-1)


@pytest.fixture(scope="module")
def case():
    """Random linkages that do not pass a dead centre, and an angle within each one's range."""
    rng = np.random.default_rng(1)
    count = 2000
    half_range = rng.uniform(0.3, 0.8, count)
    g0 = rng.uniform(half_range + 0.15, np.pi - half_range - 0.15)
    linkage = record(
        Linkage,
        a=rng.uniform(0.3, 1.0, count),
        b=rng.uniform(0.3, 1.0, count),
        g0=g0,
        dead_length=0.0,
        stroke=0.0,
    )
    ends = [length(columns(linkage), side * half_range) for side in (-1.0, 1.0)]
    linkage["dead_length"] = ends[0]
    linkage["stroke"] = ends[1] - ends[0]
    angle = np.float32(rng.uniform(-half_range, half_range))
    return linkage, angle, half_range


def length_tolerance(linkage, angle):
    """L² is a sum of a², b² and 2ab cos γ with a rounding each (γ itself rounded to 2⁻²⁴·π, times ab sin γ)."""
    full = (linkage.a + linkage.b) ** 2 + linkage.a * linkage.b * np.pi
    return 4.0 * ROUNDOFF * full / (2.0 * length(linkage, angle)) + 4.0 * ROUNDOFF * length(linkage, angle)


def test_extension_is_the_distance_between_the_pins(case):
    record_, angle, _ = case
    linkage = columns(record_)
    extension, _ = launch(extension_kernel, record_, angle)
    error = np.abs(extension - (length(linkage, angle.astype(float)) - linkage.dead_length))
    assert np.all(error <= length_tolerance(linkage, angle.astype(float)))


def test_extension_spans_the_stroke_over_the_range(case):
    record_, _, half_range = case
    linkage = columns(record_)
    slack = length_tolerance(linkage, half_range) + length_tolerance(linkage, -half_range)
    # the range's ends are rounded to float32
    slack += ROUNDOFF * np.minimum(linkage.a, linkage.b)
    closed, _ = launch(extension_kernel, record_, -half_range)
    opened, _ = launch(extension_kernel, record_, half_range)
    assert np.all(np.abs(closed) <= slack)
    assert np.all(np.abs(opened - linkage.stroke) <= slack)


def test_lever_is_the_derivative_of_the_length(case):
    record_, angle, _ = case
    linkage, angle = columns(record_), angle.astype(float)
    _, lever = launch(extension_kernel, record_, angle)
    step = 1e-5
    slope = (length(linkage, angle + step) - length(linkage, angle - step)) / (2.0 * step)
    # float64 differences: 1e-16/1e-5 and step²; float32: γ near π keeps 2⁻²⁴·π absolute in its sine
    relative = length_tolerance(linkage, angle) / length(linkage, angle)
    tolerance = 1e-9 + relative * lever + 4 * ROUNDOFF * np.pi * linkage.a * linkage.b / length(linkage, angle)
    assert np.all(np.abs(lever - slope) <= tolerance)
    assert np.all(lever > 0.0)


def test_lever_is_the_hinges_distance_from_the_cylinders_line(case):
    record_, angle, _ = case
    linkage, angle = columns(record_), angle.astype(float)
    first, second = pins(linkage, angle)
    line = second - first
    distance = np.abs(first[:, 0] * line[:, 1] - first[:, 1] * line[:, 0]) / np.linalg.norm(line, axis=-1)
    _, lever = launch(extension_kernel, record_, angle)
    relative = length_tolerance(linkage, angle) / length(linkage, angle)
    tolerance = relative * lever + 4 * ROUNDOFF * np.pi * linkage.a * linkage.b / length(linkage, angle)
    assert np.all(np.abs(lever - distance) <= tolerance)
