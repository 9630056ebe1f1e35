"""Effects of the catalogue on what is exported: the machine and the plane under it."""

from __future__ import annotations

from collections.abc import Sequence

from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import ChainEffect, GroundEffect
from aoro_gym.effects.parsing import parse_effect
from aoro_gym.machine.parameters import Machine
from aoro_gym.terrains.plane import Plane


def with_effects(machine: Machine, plane: Plane | None, asked: Sequence[str]) -> tuple[Machine, Plane | None]:
    """Machine and plane with effects such as ``"seal_friction=3000"``, in SI as the catalogue has them; of two magnitudes
    ``"ID=FIRST,SECOND"``.

    Raises ValueError naming what is wrong: effects of the measuring chain are none of the twin's, and a terrain has the
    slope that it has.
    """
    for text in asked:
        name = text.partition("=")[0]
        if isinstance(EFFECTS.get(name), ChainEffect):
            raise ValueError(
                f"--effects {text}: {name} is in the measuring chain, which is not exported; let the host measure so"
            )
        if isinstance(EFFECTS.get(name), GroundEffect) and plane is None:
            raise ValueError(f"--effects {text}: {name} tilts a plane, but --terrain names a ground; leave one out")
        effect, magnitudes = parse_effect("--effects", text, EFFECTS)
        machine = effect.apply(machine, *magnitudes)
        plane = plane if plane is None else effect.tilt(plane, *magnitudes)
    return machine, plane
