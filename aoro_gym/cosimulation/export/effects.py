"""Effects of the catalogue on what is exported: the machine and the plane under it."""

from __future__ import annotations

from collections.abc import Sequence

from aoro_gym.checks import check_range
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import ChainEffect, GroundEffect
from aoro_gym.machine.parameters import Machine
from aoro_gym.recording.cells import parse_number
from aoro_gym.terrains.plane import Plane


def with_effects(machine: Machine, plane: Plane | None, asked: Sequence[str]) -> tuple[Machine, Plane | None]:
    """Machine and plane with effects such as ``"seal_friction=3000"``, in SI as the catalogue has them; of two magnitudes
    ``"ID=FIRST,SECOND"``.

    Raises ValueError naming what is wrong: effects of the measuring chain are none of the twin's, and a terrain has the
    slope that it has.
    """
    for text in asked:
        name, _, values = text.partition("=")
        effect = EFFECTS.get(name)
        if effect is None:
            raise ValueError(f"--effects {text}: {name!r} is no effect; choose from: {', '.join(EFFECTS)}")
        if isinstance(effect, ChainEffect):
            raise ValueError(
                f"--effects {text}: {name} is in the measuring chain, which is not exported; let the host measure so"
            )
        if isinstance(effect, GroundEffect) and plane is None:
            raise ValueError(f"--effects {text}: {name} tilts a plane, but --terrain names a ground; leave one out")
        magnitudes = [parse_number(value.strip()) for value in values.split(",")]
        names = ",".join(one.name.upper() for one in effect.magnitudes)
        if len(magnitudes) != len(effect.magnitudes) or None in magnitudes:
            raise ValueError(f"--effects {text!r} is not {name}={names}, in SI")
        numbers = [number for number in magnitudes if number is not None]
        for value, one in zip(numbers, effect.magnitudes, strict=True):
            check_range(f"--effects {name}: {one.name}", value, one.unit, ge=one.low, le=one.high)
        machine = effect.apply(machine, *numbers)
        plane = plane if plane is None else effect.tilt(plane, *numbers)
    return machine, plane
