"""Which law each component obeys: a choice by name, one for all twins or one a twin.

Nobody knows a machine's laws exactly. A spool may follow its pilot in first or in second order, oil may take free air back
into solution, a tire may turn on one point or on its patch. Each such choice is a *law* here, the first option of each being
the default twin's; a *family* is a choice over all of them that one modeller would make, and every family describes the same
data sheets. The options' equations stand in :mod:`aoro_gym.twin.physics`, their parameters in the machine file (role
``law``).
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Choice = int | NDArray[np.int64]
"""Number of an option for every twin, or an array of shape (N,) with one number a twin."""


@dataclass(frozen=True)
class Law:
    """What a component may obey."""

    about: str
    options: tuple[str, ...]
    """Names; the default twin's is the first."""
    parameters: Mapping[str, tuple[str, ...]]
    """Keys of the machine's parameters that an option alone has, by option."""


def _law(about: str, options: str, **parameters: str) -> Mapping[str, Law]:
    """What a field of :class:`Laws` chooses; options and keys of parameters have spaces between them."""
    keys = {option: tuple(text.split()) for option, text in parameters.items()}
    return {"law": Law(about, tuple(options.split()), keys)}


@dataclass(frozen=True, eq=False)
class Laws:
    """Number of the chosen option of every law; 0 is the default twin's."""

    # steering valve
    spool: Choice = field(
        default=0,
        metadata=_law(
            "How the main spool follows its pilot.",
            "first_order second_order",
            second_order="steering.valve.spool_frequency steering.valve.spool_damping",
        ),
    )
    opening: Choice = field(default=0, metadata=_law("The measured opening curve between its points.", "linear smooth"))
    orifice: Choice = field(
        default=0, metadata=_law("From laminar to turbulent flow through the valve's edges.", "switched smooth")
    )
    flow_force: Choice = field(
        default=0,
        metadata=_law("What the flow does to the main spool.", "none steady", steady="steering.valve.flow_force_share"),
    )
    compensator: Choice = field(
        default=0,
        metadata=_law(
            "How the pressure compensator moves.",
            "lag static spring_mass",
            spring_mass="steering.valve.compensator_frequency steering.valve.compensator_damping",
        ),
    )
    compensator_sensing: Choice = field(
        default=0, metadata=_law("Where the compensator feels the load.", "port load_sensing_line")
    )
    shock_valve: Choice = field(
        default=0,
        metadata=_law("How the ports' relief valves open.", "static lag", lag="steering.valve.shock_time_constant"),
    )
    # pump 2 and its lines
    pump: Choice = field(
        default=0,
        metadata=_law(
            "From the margin's error to the swash.",
            "first_order second_order",
            second_order="steering.pump.valve_time_constant steering.pump.valve_lead_time",
        ),
    )
    load_sensing_line: Choice = field(
        default=0,
        metadata=_law(
            "How the load's pressure reaches the pump.",
            "lag volume",
            volume="steering.pump.ls_volume steering.pump.ls_flow steering.pump.ls_drop",
        ),
    )
    return_line: Choice = field(
        default=0, metadata=_law("What the return line's pressure does with the flow.", "check orifice")
    )
    # oil and hoses
    gas: Choice = field(
        default=0,
        metadata=_law(
            "What the free air in the oil does under pressure.",
            "polytropic isothermal adiabatic dissolving",
            dissolving="oil.solution_pressure",
        ),
    )
    liquid: Choice = field(default=0, metadata=_law("How stiff the oil without air is.", "stiffening constant"))
    hose: Choice = field(
        default=0,
        metadata=_law(
            "How the joint's hoses widen.",
            "linear stiffening viscoelastic two_segments",
            stiffening="steering.hose_stiffening_pressure",
            viscoelastic="steering.hose_delayed_share steering.hose_delay_time",
            two_segments="steering.hose_inertance steering.hose_drop",
        ),
    )
    # joint
    friction: Choice = field(
        default=0,
        metadata=_law(
            "Dry friction of the joint and the steering cylinders' seals.",
            "presliding lugre stribeck_tanh coulomb_viscous",
            stribeck_tanh="joint.friction_velocity",
            coulomb_viscous="joint.friction_velocity",
        ),
    )
    mount: Choice = field(
        default=0,
        metadata=_law(
            "The spring between cylinders and frames, where there is one.",
            "linear hardening",
            hardening="joint.hardening_angle",
        ),
    )
    # tires and ground
    swivel: Choice = field(
        default=0,
        metadata=_law(
            "What resists a tire that turns on the spot.",
            "contact_point five_discs bore_torque",
            bore_torque="tire.bore_radius tire.bore_stiffness",
        ),
    )
    slip: Choice = field(
        default=0,
        metadata=_law(
            "How a tire's force follows its slip.",
            "lugre relaxation",
            relaxation="tire.relaxation_longitudinal tire.relaxation_lateral",
        ),
    )
    soft_ground: Choice = field(
        default=0,
        metadata=_law(
            "What yielding ground does to a tire: resist its rolling, or its moving sideways, too.",
            "rolling bulldozing",
            bulldozing="tire.bulldozing_resistance",
        ),
    )
    # arms
    arm_valve: Choice = field(
        default=0,
        metadata=_law(
            "How an arm's valve section keeps its flow.",
            "ideal section",
            section="arm.valve.compensator_time_constant arm.valve.compensator_open_drop",
        ),
    )
    # driveline
    second_gear: Choice = field(
        default=0, metadata=_law("Which axle's motors second gear halves; third gear halves all.", "rear front")
    )

    @property
    def num_variants(self) -> int:
        """N if any choice is an array of shape (N,), else 1."""
        lengths = {len(choice) for choice in self.choices.values() if isinstance(choice, np.ndarray)}
        if len(lengths) > 1:
            raise ValueError(f"laws differ in their number of variants: {sorted(lengths)}; give all the same length")
        return lengths.pop() if lengths else 1

    def obeys(self, law: str, option: str) -> bool | NDArray[np.bool_]:
        """Whether the choice of ``law`` is ``option``; one truth a twin where twins choose."""
        return np.equal(self.choices[law], OPTIONS[law].index(option))

    @property
    def choices(self) -> dict[str, Choice]:
        """Number of the option by law."""
        return {law.name: getattr(self, law.name) for law in fields(self)}

    @property
    def default(self) -> bool:
        """Whether every law is the default twin's, for all twins."""
        return not any(np.any(choice) for choice in self.choices.values())

    @property
    def names(self) -> dict[str, str | list[str]]:
        """Name of the option by law, or a list of N names."""
        return {
            name: [OPTIONS[name][number] for number in choice]
            if isinstance(choice, np.ndarray)
            else OPTIONS[name][choice]
            for name, choice in self.choices.items()
        }

    def with_options(self, options: Mapping[str, str | Sequence[str]]) -> Laws:
        """Laws with other options, each a name or a sequence of N names.

        Raises ValueError naming the law, the option and those that there are.
        """
        return replace(self, **{law: _numbers(law, option) for law, option in options.items()})

    def variants(self, indices: NDArray[np.integer]) -> Laws:
        """Laws of some of the variants, integers (K,): K of them."""
        return replace(self, **{name: choice[indices] for name, choice in self._arrays()})

    def variant(self, index: int) -> Laws:
        """Laws of one variant."""
        return replace(self, **{name: int(choice[index]) for name, choice in self._arrays()})

    def _arrays(self) -> list[tuple[str, NDArray[np.int64]]]:
        return [(name, choice) for name, choice in self.choices.items() if isinstance(choice, np.ndarray)]

    @classmethod
    def stacked(cls, laws: Sequence[Laws], counts: Sequence[int]) -> Laws:
        """Laws of several machines one after the other, ``counts[i]`` variants of the i-th."""
        if all(one.default for one in laws):
            return cls()
        columns = {
            name: np.concatenate(
                [np.broadcast_to(one.choices[name], count) for one, count in zip(laws, counts, strict=True)]
            )
            for name in OPTIONS
        }
        return cls(
            **{name: int(column[0]) if np.all(column == column[0]) else column for name, column in columns.items()}
        )


LAWS: Mapping[str, Law] = {law.name: law.metadata["law"] for law in fields(Laws)}
"""Every law by name."""

OPTIONS: Mapping[str, tuple[str, ...]] = {name: law.options for name, law in LAWS.items()}
"""Names of the options by law; their place is their number."""

FAMILIES: Mapping[str, Mapping[str, str]] = {
    "default": {},
    # what a block library offers: static valves, smooth curves, air that obeys one exponent, regularised friction
    "library": {
        "opening": "smooth",
        "orifice": "smooth",
        "compensator": "static",
        "return_line": "orifice",
        "gas": "isothermal",
        "friction": "stribeck_tanh",
        "slip": "relaxation",
    },
    # what a valve maker would model: masses and springs, flow forces, volumes behind every line
    "valve_maker": {
        "spool": "second_order",
        "flow_force": "steady",
        "compensator": "spring_mass",
        "shock_valve": "lag",
        "arm_valve": "section",
        "pump": "second_order",
        "load_sensing_line": "volume",
        "gas": "adiabatic",
        "hose": "two_segments",
        "friction": "lugre",
    },
    # what a vehicle dynamicist would model: tires and structure in detail, hydraulics in short
    "vehicle": {
        "opening": "smooth",
        "compensator": "static",
        "liquid": "constant",
        "hose": "stiffening",
        "friction": "coulomb_viscous",
        "mount": "hardening",
        "swivel": "five_discs",
        "slip": "relaxation",
        "soft_ground": "bulldozing",
        "second_gear": "front",
    },
    # what a materials laboratory would measure: air that dissolves, walls that creep, patches that wind up
    "materials": {
        "spool": "second_order",
        "orifice": "smooth",
        "compensator_sensing": "load_sensing_line",
        "pump": "second_order",
        "return_line": "orifice",
        "gas": "dissolving",
        "hose": "viscoelastic",
        "friction": "lugre",
        "swivel": "bore_torque",
    },
}
"""Consistent choices over all domains, by name; a law that is not named is the default one."""


def family(name: str) -> Laws:
    """The laws of a family; raises ValueError that lists the families if there is none of that name."""
    if name not in FAMILIES:
        raise ValueError(f"there is no family of laws {name!r}{_hint(name, FAMILIES)}")
    return Laws().with_options(FAMILIES[name])


DRAWS = ("families", "any")
"""What may be drawn from beside named families: all of them, or an option of every law on its own."""


DRAWN_APART: tuple[str, ...] = ("second_gear", "arm_valve")
"""Laws that generators of their own draw, as they came later: what else a seed draws stays as it was."""


DRAWN_LAST = frozenset(key for law in DRAWN_APART for keys in LAWS[law].parameters.values() for key in keys)
"""Their parameters, for the same reason drawn after all others."""


def draws(which: str | None) -> bool:
    """Whether ``which``, a name or several with commas between them, leaves a machine's laws to be drawn; raises ValueError
    that lists families if it names another one."""
    return which is not None and (which in DRAWS or len(_families(which)) > 1)


def drawn_laws(which: str | Sequence[str], count: int, rng: np.random.Generator) -> Laws:
    """Laws of ``count`` machines: of families drawn with equal chance, given as a sequence or with commas between them,
    ``"families"`` for all of them; or, if ``"any"``, an option of every law drawn on its own."""
    if which == "any":
        apart = dict(zip(DRAWN_APART, rng.spawn(len(DRAWN_APART)), strict=True))
        return Laws(
            **{name: apart.get(name, rng).integers(len(options), size=count) for name, options in OPTIONS.items()}
        )
    names = _families(which)
    return Laws.stacked([family(names[i]) for i in rng.integers(len(names), size=count)], [1] * count)


def _families(which: str | Sequence[str]) -> list[str]:
    if which == "families":
        return list(FAMILIES)
    names = [name.strip() for name in which.split(",")] if isinstance(which, str) else list(which)
    for name in names:
        if name not in FAMILIES:
            raise ValueError(f"there is no family of laws {name!r}{_hint(name, (*FAMILIES, *DRAWS))}")
    return names


def laws_from(table: Mapping[str, Any]) -> Laws:
    """The laws of a machine file's table ``[laws]``: a ``family``, and options of single laws over it."""
    options = dict(table)
    name = options.pop("family", "default")
    for law, option in [("family", name), *options.items()]:
        if not isinstance(option, str):
            raise ValueError(f"laws.{law} = {option!r}: must be a name, as text")
    return family(name).with_options(options)


def to_table(laws: Laws) -> dict[str, str]:
    """Inverse of :func:`laws_from` for laws of one machine: what differs from the default ones."""
    return {law: OPTIONS[law][int(choice)] for law, choice in laws.choices.items() if choice}


def _numbers(law: str, option: str | Sequence[str]) -> Choice:
    if law not in OPTIONS:
        raise ValueError(f"there is no law {law!r}{_hint(law, OPTIONS)}")
    names = [option] if isinstance(option, str) else list(option)
    for name in names:
        if name not in OPTIONS[law]:
            raise ValueError(f"laws.{law} = {name!r}{_hint(name, OPTIONS[law])}")
    numbers = np.array([OPTIONS[law].index(name) for name in names])
    if isinstance(option, str):
        return int(numbers[0])
    numbers.flags.writeable = False
    return numbers


def _hint(name: Any, known: Any) -> str:
    near = difflib.get_close_matches(str(name), list(known), n=1)
    return (f": did you mean {near[0]!r}? Choose" if near else ": choose") + f" one of {', '.join(known)}"
