"""Machines that a policy was not made for: every parameter within its range, effects of the catalogue switched on, and
other laws.

>>> from aoro_gym.agents.evaluation.perturbations import PERTURBATIONS
>>> from aoro_gym.machine import Machine
>>> PERTURBATIONS["perturbed"](Machine.load("aoro"), [1, 2, 3]).num_variants
3

What a seed draws does not depend on its neighbours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_choice
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import MachineEffect, Magnitude
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import DRAWN_LAST, Laws, drawn_laws, draws

Perturbation = Callable[[Machine, Sequence[int]], Machine]
"""Gives a machine with one variant a seed."""

SWITCHABLE: Mapping[str, MachineEffect] = {
    name: effect for name, effect in EFFECTS.items() if isinstance(effect, MachineEffect)
}
"""Effects that act on the machine. Those of the measuring chain act on logs, and ground slopes by itself in the tasks."""
TRIES = 100
"""Draws of a machine before it counts as impossible to vary."""

_PARAMETERS, _EFFECT, _LAWS, _FURTHER = 1, 2, 3, 4  # streams of a seed


def unperturbed(machine: Machine, seeds: Sequence[int]) -> Machine:
    """The machine as it is, for every seed."""
    return machine


def perturbed(machine: Machine, seeds: Sequence[int]) -> Machine:
    """All uncertain parameters at once, drawn normally around the machine's own values, 95 % within half of their range to
    either side, and never outside of it.

    Raises ValueError if the machine's file leaves no room to vary it.
    """
    spread = Nuisances(machine, "range")
    generators = [np.random.default_rng([seed, _PARAMETERS]) for seed in seeds]

    def draw(index: int) -> NDArray[np.float64]:
        return generators[index].standard_normal(len(spread.keys))

    rows = np.array([draw(index) for index in range(len(seeds))])
    for index in range(len(seeds)):
        for _ in range(TRIES):
            if _can_be(lambda row=rows[index]: spread.machines(row[None])):
                break
            rows[index] = draw(index)
        else:
            raise ValueError(
                f"seed {seeds[index]}: none of {TRIES} draws is a valid machine; narrow ranges of {machine.name}"
            )
    return spread.machines(rows)


def with_effect(machine: Machine, seeds: Sequence[int]) -> Machine:
    """As :func:`perturbed`, and one effect of :data:`SWITCHABLE` in each, of a size from nothing to the end of its range.

    Raises ValueError likewise.
    """
    found = perturbed(machine, seeds)
    names = list(SWITCHABLE)
    sizes = {name: np.tile([[one] for one in SWITCHABLE[name].none], (1, len(seeds))) for name in names}
    for index, seed in enumerate(seeds):
        alone = perturbed(machine, [seed])
        rng = np.random.default_rng([seed, _EFFECT])
        for _ in range(TRIES):
            name = names[rng.integers(len(names))]
            size = [magnitude_at(one, rng.uniform(-1.0, 1.0)) for one in SWITCHABLE[name].magnitudes]
            if _can_be(lambda effect=SWITCHABLE[name], size=size, alone=alone: effect.apply(alone, *size)):
                sizes[name][:, index] = size
                break
        else:
            raise ValueError(
                f"seed {seed}: none of {TRIES} draws of effects is valid on a machine near {machine.name}; narrow its ranges"
            )
    for name, size in sizes.items():
        if np.any(size != np.array(SWITCHABLE[name].none)[:, None]):
            found = SWITCHABLE[name].apply(found, *size)
    return found


def fitting(
    machine: Machine, seeds: Sequence[int], *, perturb: Perturbation, fits: Callable[[Machine], object]
) -> Machine:
    """As ``perturb`` draws them, but machines that do not fit are drawn by further seeds, which follow from their own.

    Args:
        machine: One machine.
        seeds: One a machine.
        perturb: What differs.
        fits: Raises ValueError for a machine that cannot be.

    Raises ValueError as ``perturb`` does, or as ``fits`` does if no draw fits.
    """
    found = perturb(machine, seeds)
    if _can_be(lambda: fits(found)):
        return found
    chosen = list(seeds)
    for index, seed in enumerate(seeds):
        further = np.random.SeedSequence([seed, _FURTHER]).generate_state(TRIES).tolist()
        for other in further:
            if _can_be(lambda one=chosen[index]: fits(perturb(machine, [one]))):
                break
            chosen[index] = other
    found = perturb(machine, chosen)
    fits(found)
    return found


def with_drawn_laws(
    machine: Machine, seeds: Sequence[int], *, laws: str, perturb: Perturbation = unperturbed
) -> Machine:
    """Machines of other laws, drawn for every seed on its own.

    Args:
        machine: One machine.
        seeds: One a machine.
        laws: What is drawn from, see :func:`~aoro_gym.machine.laws.drawn_laws`.
        perturb: What else differs. Parameters that only laws have are drawn evenly within half of their range to either
            side, unless it is :func:`unperturbed`.

    Raises ValueError that lists the families, or as ``perturb`` does.
    """
    generators = [np.random.default_rng([seed, _LAWS]) for seed in seeds]
    drawn = Laws.stacked([drawn_laws(laws, 1, rng).variant(0) for rng in generators], [1] * len(seeds))
    found = perturb(machine, seeds).with_laws(**drawn.names)
    if perturb is unperturbed:
        return found
    own = [entry for entry in machine.entries.values() if entry.role == "law"]
    own.sort(key=lambda entry: entry.key in DRAWN_LAST)
    values, (low, high) = np.array([entry.value for entry in own]), np.array([entry.range for entry in own]).T
    rows = np.array([rng.uniform(values + 0.5 * (low - values), values + 0.5 * (high - values)) for rng in generators])
    return found.set({entry.key: rows[:, i] for i, entry in enumerate(own)}, check_ranges=False)


PERTURBATIONS: Mapping[str, Perturbation] = {
    "as calibrated": unperturbed,
    "perturbed": perturbed,
    "with an effect": with_effect,
}
"""By name, each harder than the one before."""


def drawn_machines(laws: str | None = None, perturbation: str | None = None) -> Perturbation:
    """What gives machines, by the names that commands take: of :data:`PERTURBATIONS`, and what laws are drawn from.

    Raises ValueError that lists what there is.
    """
    if perturbation is not None:
        check_choice("perturbation", perturbation, PERTURBATIONS)
    perturb = unperturbed if perturbation is None else PERTURBATIONS[perturbation]
    if laws is None or not draws(laws):
        return perturb
    return partial(with_drawn_laws, laws=laws, perturb=perturb)


def magnitude_at(magnitude: Magnitude, severity: float) -> float:
    """The magnitude at a severity from -1 to 1: 0 is none, the sign says to which end of the range; where there is but one
    end, the sign does not count."""
    ends = {-1.0: magnitude.low, 1.0: magnitude.high}
    side = 1.0 if severity >= 0.0 else -1.0
    end = ends[side] if ends[side] != magnitude.none else ends[-side]
    share = abs(severity)
    if magnitude.scale == "log":
        return float(magnitude.none * (end / magnitude.none) ** share)
    return float(magnitude.none + share * (end - magnitude.none))


def _can_be(make: Callable[[], object]) -> bool:
    try:
        make()
    except ValueError:
        return False
    return True
