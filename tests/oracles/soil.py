"""A tire in soil in float64: integrals over its contact by SciPy, and what four Gauss points an arc may be wrong by.

The laws are those of ``aoro_gym/twin/physics/soil.py``, written again from their equations; soil ahead of the axle and
behind it remembers a depth each.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.polynomial.legendre import leggauss
from scipy.integrate import quad
from scipy.special import roots_jacobi

FIRM = 1e8
"""Stiffness [N/m³] of what lies below a soft layer."""
POINTS = 4
"""Gauss points on an arc."""
NAMES = ("load", "resistance", "grip")


def gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Places and weights of Gauss and Legendre's rule on [0, 1]."""
    places, weights = leggauss(points)
    return 0.5 * (places + 1.0), 0.5 * weights


def kernel_bound(points: int = POINTS) -> float:
    """max |K(t)| of the rule's Peano kernel of second order, K(t) = (1 − t)²/2 − Σ wᵢ (sᵢ − t)₊: with it
    |error| ≤ max |K| · (total variation of the integrand's slope on [0, 1])."""
    places, weights = gauss(points)
    t = np.linspace(0.0, 1.0, 4001)
    kernel = 0.5 * (1.0 - t) ** 2 - np.maximum(places[:, None] - t, 0.0).T @ weights
    return float(np.abs(kernel).max())


def series_bound(function: Callable[[np.ndarray], np.ndarray], exponent: float, points: int = POINTS) -> float:
    """Bound of the rule's error for a ``function`` of s that goes to 0 as (1 − s)ᵅ at the end of an arc.

    Soil begins to bear there with its pressure ∝ zⁿ, which no polynomial follows. With u = 1 − s the function is
    uᵅ Σ hₖ Tₖ(2 u − 1), and the rule's error Σ hₖ eₖ, in which eₖ, that for uᵅ Tₖ, is known: at most Σ |hₖ eₖ|.
    """
    u = 0.5 * (1.0 + np.cos(np.pi * (np.arange(64) + 0.5) / 64))
    smooth = chebyshev.Chebyshev.fit(u, function(1.0 - u) / u**exponent, 15, domain=(0.0, 1.0))
    left = float(np.abs(smooth(u) - function(1.0 - u) / u**exponent).max())
    places, weights = gauss(points)
    exact_places, exact_weights = roots_jacobi(32, 0.0, exponent)  # ∫ uᵅ q(u) du, exact for polynomials q
    at, measure = 0.5 * (exact_places + 1.0), exact_weights * 0.5 ** (exponent + 1.0)
    known = 0.0
    for k, term in enumerate(smooth.coef):
        one = chebyshev.Chebyshev.basis(k, domain=(0.0, 1.0))
        known += abs(term * float(weights @ (places**exponent * one(places)) - measure @ one(at)))
    return known + 2.0 * left


def slope_bound(function: Callable[[np.ndarray], np.ndarray], points: int = POINTS) -> float:
    """Bound of the rule's error for a ``function`` of s with bends, such as soil that reloads and goes on as virgin."""
    values = function(np.linspace(0.0, 1.0, 4001))
    return kernel_bound(points) * float(np.abs(np.diff(values, 2)).sum() * 4000.0)


@dataclass
class Contact:
    """A tire of ``radius`` R and ``width`` b [m] in ``soil``, whose unloaded circle lies ``depth`` D [m] under the
    undisturbed ground, its base ``sinkage`` z₀.

    Soil on the arc behind bore ``behind`` [m] before, that below the base and ahead ``ahead`` [m]. It rolls forward, sheared
    by ``shear`` [m] over its whole contact.
    """

    soil: Any
    radius: float
    width: float
    depth: float
    sinkage: float
    ahead: float = 0.0
    behind: float = 0.0
    shear: float = 0.0

    def __post_init__(self) -> None:
        self.flat, self.end = self.chord(self.depth - self.sinkage), self.chord(self.depth)
        self.length = self.flat + self.end
        self.reaches = tuple(
            self.chord(self.depth - min(self.kept(d), self.sinkage)) for d in (self.ahead, self.behind)
        )

    def chord(self, rise: float) -> float:
        """Half of the circle's chord at ``rise`` over its lowest point."""
        return float(np.sqrt(rise * (2.0 * self.radius - rise)))

    def virgin(self, z: Any) -> Any:
        """p [Pa] at first sinkage."""
        soil = self.soil
        bekker = (soil.k_c / self.width + soil.k_phi) * np.maximum(z, 0.0) ** soil.exponent
        mat = 2.0 * soil.mat * (self.width + self.length) / (self.width * self.length) * z * z
        return bekker + mat + FIRM * np.maximum(z - soil.layer, 0.0)

    def unloading(self, deepest: float) -> float:
        """k_u [N/m³]."""
        return max(self.soil.k_0 + self.soil.a_u * deepest, 2.0 * float(self.virgin(deepest)) / deepest)

    def kept(self, deepest: float) -> float:
        """Depth [m] that stays in a rut."""
        if deepest <= 0.0:
            return 0.0
        return max(deepest - float(self.virgin(deepest)) / self.unloading(deepest), 0.0)

    def pressure(self, z: Any, deepest: float) -> Any:
        """p [Pa] at ``z`` of soil that was pressed to ``deepest`` before."""
        if deepest <= 0.0:
            return self.virgin(z)
        back = np.maximum(self.virgin(deepest) - self.unloading(deepest) * (deepest - z), 0.0)
        return np.where(z >= deepest, self.virgin(z), back)

    def at(self, x: Any) -> Any:
        """Depth z [m] of the tire at ``x`` [m] ahead of the axle."""
        circle = self.depth - self.radius + np.sqrt(np.maximum(self.radius**2 - np.square(x), 0.0))
        return np.clip(circle, 0.0, self.sinkage)

    def per_metre(self, x: Any) -> np.ndarray:
        """Load, resistance and grip [N/m] at ``x`` (3, ...) where soil bears: b p, b p tan of the arc's angle, and
        b (c + p tan φ) (1 − e^(−j/K))."""
        x = np.asarray(x, dtype=np.float64)
        on_arc = np.abs(x) > self.flat
        p = np.where(x < -self.flat, self.pressure(self.at(x), self.behind), self.pressure(self.at(x), self.ahead))
        tangent = np.where(on_arc, x / np.sqrt(self.radius**2 - x * x), 0.0)
        j = self.shear * (self.reaches[0] - x) / self.length
        grip = (self.soil.cohesion + p * self.soil.tan_phi) * (
            1.0 - np.exp(-np.maximum(j, 0.0) / self.soil.shear_modulus)
        )
        return self.width * np.array([p, p * tangent, grip])

    @property
    def exact(self) -> SimpleNamespace:
        """The integrals [N], in pieces between the bends of their integrands."""
        first, last = -self.reaches[1], self.reaches[0]
        bends = {-self.flat, self.flat, 0.0}
        for sign, deepest in ((1.0, self.ahead), (-1.0, self.behind)):
            if 0.0 < deepest < self.sinkage:
                bends.add(sign * self.chord(self.depth - deepest))
        inside = sorted({first, last, *(x for x in bends if first < x < last)})
        values = [
            sum(
                quad(lambda x, row=row: float(self.per_metre(x)[row]), a, b, epsrel=1e-10)[0]
                for a, b in pairwise(inside)
            )
            for row in range(len(NAMES))
        ]
        return SimpleNamespace(**dict(zip(NAMES, values, strict=True)))

    def on_arc(self, side: int) -> Callable[[np.ndarray], np.ndarray]:
        """The integrands (3, ...) of the arc ahead (0) or behind (1) as functions of s in [0, 1]: x = ± (flat + arc s²)."""
        arc = self.reaches[side] - self.flat
        sign = 1.0 - 2.0 * side
        return lambda s: self.per_metre(sign * (self.flat + arc * s * s)) * 2.0 * arc * s

    def _on_arc(self, side: int, row: int) -> Callable[[np.ndarray], np.ndarray]:
        function = self.on_arc(side)
        return lambda s: function(s)[row]

    def rule(self, points: int = POINTS) -> SimpleNamespace:
        """What Gauss points come to [N]: ``points`` on each arc and two on the base."""
        places, weights = gauss(points)
        total = sum(self.on_arc(side)(places) @ weights for side in (0, 1))
        base = self.per_metre(self.flat * np.array([-1.0, 1.0]) / np.sqrt(3.0)).sum(axis=1) * self.flat
        return SimpleNamespace(**dict(zip(NAMES, np.asarray(total) + base, strict=True)))

    def truncation(self, points: int = POINTS) -> SimpleNamespace:
        """Bounds [N] of what :meth:`rule` is wrong by.

        By :func:`series_bound` on arcs of virgin soil, by :func:`slope_bound` where it remembers a rut; two points on the
        base are wrong by what they lack of its closed integral, of the grip alone.
        """
        bounds = np.zeros(len(NAMES))
        for side, deepest in enumerate((self.ahead, self.behind)):
            if self.reaches[side] <= self.flat:
                continue
            for row in range(len(NAMES)):
                one = self._on_arc(side, row)
                bounds[row] += slope_bound(one, points) if deepest > 0.0 else self._virgin_bound(one, row, points)
        # along the base, whose pressure is uniform, e^(−j/K) has this rate
        rate = self.shear / (self.length * self.soil.shear_modulus)
        strength = self.soil.cohesion + float(self.virgin(self.sinkage)) * self.soil.tan_phi
        at_end = np.exp(-rate * (self.reaches[0] - self.flat))
        if rate > 0.0:
            exact = (1.0 - np.exp(-2.0 * rate * self.flat)) / rate
            two = self.flat * np.exp(-rate * self.flat * (1.0 + np.array([-1.0, 1.0]) / np.sqrt(3.0))).sum()
            bounds[2] += self.width * strength * at_end * abs(two - exact)
        return SimpleNamespace(**dict(zip(NAMES, bounds, strict=True)))

    def rounding(self, relative: float = 2.0**-24) -> SimpleNamespace:
        """Bounds [N] of what float32 makes of :meth:`rule`.

        z = D − R + √(R² − x²) is good to 2 ε R, which a slope dp/dz makes a pressure of; twenty operations on the way, roots
        and powers among them, of two units in the last place each, are another 40 ε of the sum.
        """
        places, weights = gauss(POINTS)
        values = 40.0 * relative * np.abs(list(vars(self.rule()).values()))
        step = 1e-6
        for side, deepest in enumerate((self.ahead, self.behind)):
            arc = self.reaches[side] - self.flat
            z = self.at(self.flat + arc * places**2)
            slope = (self.pressure(z + step, deepest) - self.pressure(np.maximum(z - step, 0.0), deepest)) / (
                2.0 * step
            )
            values += 2.0 * relative * self.radius * self.width * np.sum(weights * 2.0 * arc * places * slope)
        base = (self.virgin(self.sinkage + step) - self.virgin(self.sinkage - step)) / (2.0 * step)
        values += 2.0 * relative * self.radius * self.width * 2.0 * self.flat * float(base)
        return SimpleNamespace(**dict(zip(NAMES, values, strict=True)))

    def _virgin_bound(self, one: Callable[[np.ndarray], np.ndarray], row: int, points: int) -> float:
        # shear begins where pressure does: its part by friction goes to 0 as u^(n + 1), that by cohesion as u
        if row < 2:
            return series_bound(one, self.soil.exponent, points)
        by_cohesion = Contact(
            _without_friction(self.soil), self.radius, self.width, self.depth, self.sinkage, shear=self.shear
        ).on_arc(0)
        rest = lambda s: one(s) - by_cohesion(s)[2]  # noqa: E731
        return series_bound(rest, self.soil.exponent + 1.0, points) + series_bound(
            lambda s: by_cohesion(s)[2], 1.0, points
        )


def _without_friction(soil: Any) -> Any:
    names = ("k_c", "k_phi", "exponent", "mat", "layer", "k_0", "a_u", "cohesion", "shear_modulus")
    return SimpleNamespace(**{name: getattr(soil, name) for name in names}, tan_phi=0.0)
