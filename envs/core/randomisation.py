"""What differs from episode to episode, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.terms import Frozen
from aoro_gym.execution.streams import Generators, uniforms
from aoro_gym.machine import Machine
from aoro_gym.machine.machine_file import PAYLOAD
from aoro_gym.machine.parameters import DECLARATIONS

Range = tuple[float, float]
"""Lowest and highest value of a uniform draw; equal ones draw nothing but that value."""

FRICTION_KEYS = ("tire.friction_coulomb", "tire.friction_static")
"""Keys that stand for the ground's friction: ground and tire enter as a product."""

COMMISSIONED: Mapping[str, Range] = Frozen(
    {
        "steering.valve.nominal_flow_left": (0.95, 1.05),
        "steering.valve.nominal_flow_right": (0.95, 1.05),
        "steering.valve.dead_band_left": (0.85, 1.15),
        "steering.valve.dead_band_right": (0.85, 1.15),
        "steering.valve.command_delay": (0.7, 1.4),
        "frame.front.mass": (0.9, 1.1),
        "frame.rear.mass": (0.9, 1.1),
    }
)
"""Factors by which a commissioned machine may differ from its file, whatever its task: steering and payload."""


@dataclass(frozen=True)
class Randomisation:
    """Uniform ranges, drawn anew for every sub-environment at every reset from its own generator.

    A task with ranges of its own derives a class from this one: each a field, with its bounds in ``BOUNDS``.

    Raises ValueError naming the key, its value and the bound.
    """

    BOUNDS: ClassVar[Mapping[str, Range]] = {
        "ground_friction": (0.01, 2.0),
        "sensor_noise": (0.0, 100.0),
        "joint_angle": (-1.0, 1.0),
    }
    """Lowest and highest value that a range may have, by field, in the order in which they are drawn."""

    machine: Mapping[str, Range] = field(default_factory=dict)
    """Dotted parameter key → range of values, in the unit of the machine file."""
    machine_scale: Mapping[str, Range] = field(default_factory=dict)
    """Dotted parameter key → range of factors on the machine's own value."""
    ground_friction: Range = (1.0, 1.0)
    """Multiplier [-] of the friction between tires and ground; 1 is dry asphalt."""
    sensor_noise: Range = (1.0, 1.0)
    """Multiplier [-] of the sensors' errors; 1 is as published, 0 is exact."""
    joint_angle: Range = (-1.0, 1.0)
    """Joint angle at the start as a share [-] of the largest angle that the task uses."""

    def __post_init__(self) -> None:
        for name in ("machine", "machine_scale"):
            ranges = getattr(self, name)
            for key, span in ranges.items():
                if key not in DECLARATIONS:
                    raise ValueError(
                        f"randomisation.{name} has the unknown parameter {key!r}; `aoro-gym parameters` lists them"
                    )
                _checked(f"randomisation.{name}[{key!r}]", span, 0.0 if name == "machine_scale" else -np.inf, np.inf)
            object.__setattr__(
                self, name, Frozen({key: (float(low), float(high)) for key, (low, high) in ranges.items()})
            )
        both = sorted(set(self.machine) & set(self.machine_scale))
        if both:
            raise ValueError(f"randomisation.machine and .machine_scale both have {', '.join(both)}; keep one of them")
        for name, (lowest, highest) in self.BOUNDS.items():
            _checked(f"randomisation.{name}", getattr(self, name), lowest, highest)

    @property
    def varies_machine(self) -> bool:
        """Whether any episode's machine differs from the given one."""
        return bool(self.machine) or bool(self.machine_scale) or self.ground_friction != (1.0, 1.0)

    @property
    def varies_load(self) -> bool:
        """Whether any episode may have another load than the given machine."""
        return any(key.startswith(PAYLOAD) for key in (*self.machine, *self.machine_scale))

    @property
    def num_draws(self) -> int:
        """Uniform numbers that one reset of one sub-environment takes."""
        return len(self.BOUNDS) + len(self.machine) + len(self.machine_scale)

    def draw(self, generators: Generators) -> Draws:
        """One draw for each generator."""
        uniform = uniforms(generators, self.num_draws)
        spans = [getattr(self, name) for name in self.BOUNDS]
        spans += [*self.machine.values(), *self.machine_scale.values()]
        low, high = np.array(spans, dtype=np.float64).T
        values = low + (high - low) * uniform
        own = dict(zip(self.BOUNDS, values.T, strict=False))
        first = len(own) + len(self.machine)
        return Draws(
            ground_friction=own.pop("ground_friction"),
            sensor_noise=own.pop("sensor_noise"),
            joint_angle=own.pop("joint_angle"),
            machine=dict(zip(self.machine, values[:, len(self.BOUNDS) : first].T, strict=True)),
            machine_scale=dict(zip(self.machine_scale, values[:, first:].T, strict=True)),
            task=own,
        )


@dataclass(frozen=True)
class Draws:
    """What K resets drew: arrays of shape (K,), named as in :class:`Randomisation`."""

    ground_friction: NDArray[np.float64]
    sensor_noise: NDArray[np.float64]
    joint_angle: NDArray[np.float64]
    machine: Mapping[str, NDArray[np.float64]]
    machine_scale: Mapping[str, NDArray[np.float64]]
    task: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """The ranges that a task adds."""

    def apply(self, machine: Machine) -> Machine:
        """``machine``, of one or K variants, with what was drawn."""
        scale = dict(self.machine_scale)
        if np.any(self.ground_friction != 1.0):
            for key in FRICTION_KEYS:
                scale[key] = scale.get(key, 1.0) * self.ground_friction
        try:
            if self.machine:
                machine = machine.set(self.machine, check_ranges=False)
            return machine.scale(scale, check_ranges=False) if scale else machine
        except ValueError as error:
            raise ValueError(f"randomisation drew an invalid machine: {error}; narrow that key's range") from error


def _checked(name: str, span: Any, lowest: float, highest: float) -> None:
    try:
        low, high = (float(end) for end in span)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {span!r}, but must be a pair (low, high) of numbers") from None
    if not (lowest <= low <= high <= highest) or not np.isfinite([low, high]).all():
        raise ValueError(
            f"{name} is ({low:g}, {high:g}), but must be finite with {lowest:g} ≤ low ≤ high ≤ {highest:g}"
        )
