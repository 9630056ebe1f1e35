"""The machine: its independent parameters with their sources, their validation, and what follows from them.

A machine file (TOML) gives each parameter as a table ``[section.key]``; the dotted key is also the attribute path, so
``steering.valve.spool_time_constant`` is ``machine.steering.valve.spool_time_constant``. Inside all values are SI
(displacements in m³/rad, pressures gauge), as floats or as arrays of shape (N,) with one value a twin. Signs: x
forward, y left, z up; joint angle and steering positive to the left.
"""

import difflib
import fnmatch
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from os import PathLike
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_integer, check_range, shortened
from aoro_gym.machine.laws import DRAWN_LAST, Laws, drawn_laws, family
from aoro_gym.machine.machine_file import PAYLOAD, Parameter, naming, read_machine, write_machine
from aoro_gym.machine.pile import MOST_LOGS
from aoro_gym.machine.quantities import UNITS, Declaration, Quantity, as_quantity, with_unit
from aoro_gym.machine.rest import Corner, RestPose, composite_corner, rest_pose
from aoro_gym.machine.sections import (
    Arm,
    Driveline,
    Engine,
    Frame,
    HalfFrame,
    Hull,
    Joint,
    Oil,
    Payload,
    Steering,
    Tire,
    Wheel,
)

DRAWS = 200
"""Times that what cannot be a machine is drawn anew."""

RANGE_SLACK = 1e-9
"""Of a range's larger end [-]: values that are rounded at its ends lie within it."""


def matching(names: Iterable[str], pattern: str | None) -> list[str]:
    """The ``names`` that have a ``pattern`` as a part, or match it as a glob; all of them for None."""
    glob = "*" if pattern is None else pattern if any(c in pattern for c in "*?[") else f"*{pattern}*"
    return [name for name in names if fnmatch.fnmatchcase(name.lower(), glob.lower())]


class OutsideRangeWarning(UserWarning):
    """A parameter is outside of its machine's plausible range, though within physical bounds."""


class InvalidMachine(ValueError):
    """Parameters that no machine can have."""

    shown: tuple[tuple[Parameter, NDArray[np.bool_]], ...] = ()
    """What the message is about, and at which variant."""
    sentence = ""

    @classmethod
    def of(cls, shown: Sequence[tuple[Parameter, NDArray[np.bool_]]], sentence: str) -> "InvalidMachine":
        """The values that are ``shown``, and what is wrong with them."""
        error = cls(_message(shown, sentence))
        error.shown, error.sentence = tuple(shown), sentence
        return error

    def told(self, called: Callable[[int], str]) -> str:
        """The message; ``called`` gives what follows a key for the variant of a number, by default ``[number]``."""
        return _message(self.shown, self.sentence, called) if self.shown else str(self)


def _message(
    shown: Iterable[tuple[Parameter, NDArray[np.bool_]]], sentence: str, called: Callable[[int], str] | None = None
) -> str:
    return ", ".join(_shown(entry, where, called) for entry, where in shown) + f": {sentence}"


DEFAULT_PRIORS: Mapping[str, tuple[float, tuple[float, float]]] = {
    "oil.gas_fraction": (0.005, (0.0, 0.02)),  # S18: 0.5 %
    "tire.scrub_radius": (0.05, (0.0, 0.1)),  # E: 2/3 of the radius of a patch
    "tire.scrub_angle": (0.125, (0.05, 0.2)),  # E
}
"""What data sheets leave out though every real machine has it, in the file's units: a usual value, and the range."""


@dataclass(frozen=True, eq=False)
class Machine:
    """A complete, valid parameter set; make one with :meth:`load`, vary it with :meth:`set` and :meth:`scale`."""

    name: str
    entries: Mapping[str, Parameter]  # by dotted key, in the file's units
    frame: Frame
    hull: Hull
    arm: Arm
    wheel: Wheel
    tire: Tire
    joint: Joint
    oil: Oil
    steering: Steering
    driveline: Driveline
    engine: Engine
    payload: Payload
    laws: Laws = field(default_factory=Laws)
    """Which law each component obeys."""

    def __repr__(self) -> str:
        variants = "" if self.num_variants == 1 else f", {self.num_variants} variants"
        return f"Machine({self.name!r}, {len(self.entries)} parameters{variants})"

    @classmethod
    def load(cls, name_or_path: str | PathLike[str] = "aoro") -> "Machine":
        """Machine from a bundled set (``"aoro"``) or from a TOML file (a path that ends in ``.toml``).

        Raises FileNotFoundError, or ValueError naming key, value, unit, bound and fix.
        """
        name, entries, laws = read_machine(name_or_path)
        with naming(name_or_path):
            return cls._build(name, entries, laws)

    def save(self, path: str | PathLike[str], base: str | None = None) -> None:
        """Write a machine file with units, ranges, sources and roles.

        Args:
            path: The file.
            base: A bundled machine, or a file beside ``path``, that the file stands on: it then has only what differs.

        Raises ValueError for a batched machine.
        """
        batched = [key for key, entry in self.entries.items() if isinstance(entry.value, np.ndarray)]
        batched += ["laws"] if self.laws.num_variants > 1 else []
        if batched:
            raise ValueError(
                f"a machine file holds one machine, but {', '.join(batched)} have {self.num_variants} values each: "
                "save machine.variant(i)"
            )
        write_machine(path, self.entries, self.laws, base)

    def set(
        self,
        values: Mapping[str, ArrayLike],
        *,
        si: bool = False,
        source: str | None = None,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        check_ranges: bool = True,
    ) -> "Machine":
        """Machine with other values of some parameters.

        Args:
            values: By dotted key, each a number or shape (N,).
            si: Whether they are in SI; by default in the file's unit.
            source: Where they come from, say "calibrated on ..."; by default what it was.
            ranges: Plausible ranges in the file's unit, say after a measurement; by default what they were.
            check_ranges: Warn (:class:`OutsideRangeWarning`), once a parameter, of values outside of their plausible range.

        Raises ValueError naming the key, its value and its bound.
        """
        entries = dict(self.entries)
        for key, value in values.items():
            entry = self._entry(key)
            number = _number(key, value)
            entries[key] = replace(
                entry,
                value=as_quantity(number / UNITS[entry.unit][1]) if si else number,
                source=entry.source if source is None else source,
                range=(ranges or {}).get(key, entry.range),
            )
        machine = self._build(self.name, entries, self.laws, self.entries)
        if check_ranges:
            for message in machine.outside_ranges(values).values():
                warnings.warn(message, OutsideRangeWarning, stacklevel=2)
        return machine

    def scale(self, factors: Mapping[str, ArrayLike], *, check_ranges: bool = True) -> "Machine":
        """Machine with the given parameters multiplied by ``factors``, each a number or shape (N,); see :meth:`set`."""
        scaled = {}
        for key, factor in factors.items():
            value, number = self._entry(key).value, _number(key, factor)
            if np.ndim(value) and np.ndim(number) and np.size(value) != np.size(number):
                raise ValueError(f"{key} has {np.size(value)} variants, its factor {np.size(number)}; give as many")
            scaled[key] = value * number
        machine = self.set(scaled, check_ranges=False)
        if check_ranges:
            for message in machine.outside_ranges(scaled).values():
                warnings.warn(message, OutsideRangeWarning, stacklevel=2)
        return machine

    def outside_ranges(self, keys: Iterable[str], called: Callable[[int], str] | None = None) -> dict[str, str]:
        """A sentence by key for each of the parameters ``keys`` that is outside of its plausible range.

        ``called`` gives what follows a key for the variant of a number, by default ``[number]``.
        """
        messages = {}
        for key in keys:
            entry = self.entries[key]
            low, high = entry.range
            slack = RANGE_SLACK * max(abs(low), abs(high))
            out = np.less(entry.value, low - slack) | np.greater(entry.value, high + slack)
            if np.any(out):
                others = f" (and {np.sum(out) - 1} more)" if np.sum(out) > 1 else ""
                messages[key] = (
                    f"{_shown(entry, out, called)}{others}: outside of its plausible range {low:g} to "
                    f"{with_unit(high, entry.unit)}; physically possible, so it is taken"
                )
        return messages

    def levelled(self) -> "Machine":
        """Machine whose pivots are as high on its frames as lets the design ground plane lie on the ground at rest.

        For a calibration, which looks for the tires and masses of a machine whose stance is known; afterwards the pivots
        stay, and other tires let the machine sink.
        """
        height = self.arm.pivot_height + self.rest.height
        return self.set(
            {"arm.pivot_height": height},
            si=True,
            source="C: the calibrated machine stands level on its tires, arms at rest",
            check_ranges=False,
        )

    def with_default_priors(self) -> "Machine":
        """Machine that may have more or less of what its file leaves out, :data:`DEFAULT_PRIORS`: for a fit to its logs.

        A fit that cannot put air into the oil makes oil and hoses softer at all pressures instead; one whose tires stand on
        a point has joint and seals rub for them.
        """
        entries = dict(self.entries)
        for key, (usual, reach) in DEFAULT_PRIORS.items():
            entry = self._entry(key)
            if entry.role in ("effect", "fixed"):
                value = usual if entry.role == "fixed" or not np.any(entry.value) else entry.value
                entries[key] = replace(
                    entry, value=value, range=reach, source="E: usual; data sheets do not say", role="both"
                )
        return self._build(self.name, entries, self.laws, self.entries)

    def with_laws(self, family_name: str | None = None, /, **options: str | Sequence[str]) -> "Machine":
        """Machine whose components obey other laws.

        Args:
            family_name: One of :data:`aoro_gym.machine.laws.FAMILIES`; by default the machine's own laws.
            options: Name of the option by law, or a sequence of N names: over those of the family.

        Raises ValueError naming the law, the option and those that there are.
        """
        laws = self.laws if family_name is None else family(family_name)
        return self._build(self.name, self.entries, laws.with_options(options), self.entries)

    def sample(
        self, count: int, *, laws: str | Sequence[str] | None = None, parameters: float = 0.0, seed: int = 0
    ) -> "Machine":
        """Machines as this one may really be: other values of what is uncertain, and other laws.

        Args:
            count: Machines to draw, at least 1; one variant each.
            laws: Families to draw from with equal chance (:data:`aoro_gym.machine.laws.FAMILIES`); ``"families"`` for all
                of them, ``"any"`` for an option of every law on its own; by default the machine's own laws.
            parameters: Share of the way from its value to either end of its range, in [0, 1], within which every uncertain
                parameter (roles ``nuisance``, ``both`` and ``law``) is drawn evenly.
            seed: Of the draws.

        Raises ValueError naming the value and its bound; InvalidMachine where hardly any draw can be a machine.
        """
        check_integer("count", count)
        check_range("parameters", parameters, ge=0.0, le=1.0)
        if self.num_variants > 1:
            raise ValueError(f"the machine has {self.num_variants} variants; sample one of them: machine.variant(i)")
        rng = np.random.default_rng(seed)
        machine = self if laws is None else self.with_laws(**drawn_laws(laws, count, rng).names)
        uncertain = [entry for entry in self.entries.values() if entry.role in ("nuisance", "both", "law")]
        uncertain.sort(key=lambda entry: entry.key in DRAWN_LAST)
        values = np.array([entry.value for entry in uncertain], dtype=np.float64)[:, None]
        ends = np.array([entry.range for entry in uncertain])
        low = values + parameters * np.minimum(ends[:, :1] - values, 0.0)
        high = values + parameters * np.maximum(ends[:, 1:] - values, 0.0)
        drawn = rng.uniform(low, high, (len(uncertain), count))
        failed = None
        for _ in range(DRAWS):
            try:
                return machine.set(
                    {entry.key: drawn[i] if count > 1 else drawn[i, 0] for i, entry in enumerate(uncertain)},
                    check_ranges=False,
                )
            except InvalidMachine as error:
                again = np.broadcast_to(error.shown[0][1], count)
                failed = error
            drawn[:, again] = rng.uniform(low, high, (len(uncertain), int(again.sum())))
        assert failed is not None
        raise failed

    @classmethod
    def stacked(cls, machines: Sequence["Machine"], counts: Sequence[int]) -> "Machine":
        """One machine whose variants are those of all ``machines``, each with its count of them, one after the other; what
        is the same for all stays one value. Names and ranges are the first one's."""
        first = machines[0]
        entries = dict(first.entries)
        for key, entry in first.entries.items():
            column = [machine.entries[key].value for machine in machines]
            if any(isinstance(value, np.ndarray) or value != entry.value for value in column):
                whole = np.concatenate([np.broadcast_to(v, count) for v, count in zip(column, counts, strict=True)])
                entries[key] = replace(entry, value=as_quantity(whole))
        return cls._build(first.name, entries, Laws.stacked([machine.laws for machine in machines], counts))

    def variants(self, indices: ArrayLike) -> "Machine":
        """Some of the variants, integers (K,), as a machine of K; a machine without variants is itself."""
        if self.num_variants == 1:
            return self
        chosen = np.asarray(indices)
        entries = {
            key: replace(entry, value=as_quantity(entry.value[chosen]))
            if isinstance(entry.value, np.ndarray)
            else entry
            for key, entry in self.entries.items()
        }
        return self._build(self.name, entries, self.laws.variants(chosen))

    def variant(self, index: int) -> "Machine":
        """One machine out of a batched one."""
        count = self.num_variants
        if not -count <= index < count:
            raise ValueError(f"variant is {index}, but must be in [{-count}, {count - 1}]")
        entries = {
            key: replace(entry, value=float(entry.value[index])) if isinstance(entry.value, np.ndarray) else entry
            for key, entry in self.entries.items()
        }
        return self._build(self.name, entries, self.laws.variant(index))

    def value(self, key: str) -> Quantity:
        """SI value of a parameter."""
        return self._entry(key).si

    def parameters(self, pattern: str | None = None) -> list[Parameter]:
        """Parameters in the order of the file; ``pattern`` is part of a key, or a glob (``steering.*.leakage``)."""
        return [self.entries[key] for key in matching(self.entries, pattern)]

    @property
    def identity(self) -> dict[str, dict[str, Any]]:
        """All that results follow from, by key: values and ranges in SI, and roles; neither name nor notes, nor the bunk of
        a machine without a load."""
        entries = {key: one for key, one in self.entries.items() if self.loaded or not key.startswith(PAYLOAD)}
        size = {key: UNITS[entry.unit][1] for key, entry in entries.items()}
        known = {} if self.laws.default else {"laws": self.laws.names}
        return known | {
            "value": {key: entry.si for key, entry in entries.items()},
            "range": {key: [limit * size[key] for limit in entry.range] for key, entry in entries.items()},
            "role": {key: entry.role for key, entry in entries.items()},
        }

    @cached_property
    def num_variants(self) -> int:
        """N if any parameter is an array of shape (N,), else 1."""
        return _num_variants(self.entries, self.laws)

    @property
    def mass(self) -> Quantity:
        """Whole machine with its load [kg]."""
        return self.frame.front.mass + self.frame.rear.mass + 4.0 * self.corner.mass + self.payload.mass

    @property
    def loaded(self) -> bool:
        """Whether there are logs in the bunk of any variant."""
        return bool(np.any(np.greater(self.payload.count, 0.0)))

    @cached_property
    def corner(self) -> Corner:
        """Arm, motor and wheel as one body."""
        return composite_corner(self.arm, self.wheel, self.frame.track)

    @cached_property
    def rest(self) -> RestPose:
        """Static pose on level ground."""
        return rest_pose(self.frame, self.arm, self.tire, self.corner, self.payload)

    def _entry(self, key: str) -> Parameter:
        try:
            return self.entries[key]
        except KeyError:
            raise ValueError(_unknown(key)) from None

    @classmethod
    def _build(
        cls,
        name: str,
        entries: Mapping[str, Parameter],
        laws: Laws,
        known: Mapping[str, Parameter] = MappingProxyType({}),
    ) -> "Machine":
        ordered = _validated(entries, known)
        _num_variants(ordered, laws)
        components = {name: _component(kind, f"{name}.", ordered) for name, kind in _COMPONENTS.items()}
        machine = cls(name=name, entries=ordered, laws=laws, **components)
        for holds, keys, sentence in rules(machine):
            _require(machine, holds, keys, sentence)
        return machine


_COMPONENTS = {f.name: f.type for f in fields(Machine) if is_dataclass(f.type) and f.type is not Laws}
"""Section classes by name."""


def _declarations(component: Any, prefix: str = "") -> Iterator[tuple[str, Declaration]]:
    """Dotted key and declaration of every parameter, in the order of the file."""
    for f in fields(component):
        if f.type is Laws:
            continue
        if "declaration" in f.metadata:
            yield prefix + f.name, f.metadata["declaration"]
        elif is_dataclass(f.type):
            yield from _declarations(f.type, f"{prefix}{f.name}.")


DECLARATIONS: Mapping[str, Declaration] = dict(_declarations(Machine))
"""SI unit and bounds of every parameter by dotted key."""


def _component(kind: Any, prefix: str, entries: Mapping[str, Parameter]) -> Any:
    """Instance of the section class ``kind`` from the entries whose keys begin with ``prefix``."""
    members = {}
    for f in fields(kind):
        if is_dataclass(f.type):
            members[f.name] = _component(f.type, f"{prefix}{f.name}.", entries)
        else:
            members[f.name] = entries[f.metadata.get("same_as", prefix + f.name)].si
    return kind(**members)


def _number(key: str, value: ArrayLike) -> Quantity:
    """``value`` as a float, or as an array of shape (N,) with N ≥ 2."""
    try:
        array = np.array(value)
    except (TypeError, ValueError, RuntimeError):  # ragged lists, tensors of a device
        raise ValueError(
            f"{key} = {shortened(value)}: must be a number, or an array of numbers in shape (N,)"
        ) from None
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{key} = {shortened(value)}: must be a number or an array of numbers")
    if array.ndim > 1 or array.size == 0:
        raise ValueError(f"{key} has shape {array.shape}: give one number, or one a twin in shape (N,)")
    return as_quantity(array if array.size > 1 else array.item())


def _unknown(key: Any) -> str:
    if not isinstance(key, str):
        return f"unknown parameter {key!r}: keys are dotted names, as in 'tire.friction_static'"
    near = difflib.get_close_matches(key[:100], DECLARATIONS, n=1, cutoff=0.5)
    same_name = [known for known in DECLARATIONS if known.rsplit(".", 1)[-1] == key.rsplit(".", 1)[-1]]
    hint = [*near, *same_name][:1]
    return f"unknown parameter {shortened(key)}" + (f": did you mean {hint[0]!r}?" if hint else "")


def _num_variants(entries: Mapping[str, Parameter], laws: Laws) -> int:
    lengths = {key: len(entry.value) for key, entry in entries.items() if isinstance(entry.value, np.ndarray)}
    if laws.num_variants > 1:
        lengths["laws"] = laws.num_variants
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{key} ({length})" for key, length in lengths.items())
        raise ValueError(f"parameters differ in their number of variants: {listed}; give all the same length")
    return next(iter(lengths.values()), 1)


def _validated(entries: Mapping[str, Parameter], known: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """``entries`` in canonical order, each key known and present, each value within its bounds. Those that are among the
    ``known`` ones have been looked at before."""
    for key in entries:
        if key not in DECLARATIONS:
            raise ValueError(_unknown(key))
    missing = [key for key in DECLARATIONS if key not in entries]
    if missing:
        more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
        raise ValueError(f"missing parameters: {', '.join(missing[:5])}{more}; add a table [KEY] for each")
    for key, declaration in DECLARATIONS.items():
        entry = entries[key]
        if known.get(key) is entry:
            continue
        if UNITS.get(entry.unit, ("", 1.0))[0] != declaration.unit:
            fitting = ", ".join(unit for unit, (si, _) in UNITS.items() if si == declaration.unit)
            problem = "does not measure it" if entry.unit in UNITS else "is unknown"
            raise ValueError(f"{key}: unit {shortened(entry.unit)} {problem}; use one of: {fitting}")
        value = entry.si
        if isinstance(value, float) and declaration.admits_number(value):
            continue
        admitted = declaration.admits(value)
        if not np.all(admitted):
            raise InvalidMachine.of([(entry, ~admitted)], f"must be finite and {declaration.bounds(entry.unit)}")
    return {key: entries[key] for key in DECLARATIONS}


def _shown(entry: Parameter, where: Any, called: Callable[[int], str] | None = None) -> str:
    """``key = value unit`` of the first variant at which ``where`` holds; see :meth:`InvalidMachine.told`."""
    if isinstance(entry.value, np.ndarray):
        index = int(np.argmax(where))
        suffix = f"[{index}]" if called is None else called(index)
        return f"{entry.key}{suffix} = {with_unit(entry.value[index], entry.unit)}"
    return f"{entry.key} = {with_unit(entry.value, entry.unit)}"


def _require(machine: Machine, holds: Any, keys: list[str], sentence: str) -> None:
    if not np.all(holds):
        where = np.logical_not(holds)
        raise InvalidMachine.of([(machine.entries[key], where) for key in keys], sentence)


Rule = tuple[Any, list[str], str]
"""What must hold of a machine, the keys that it is about, and what is wrong otherwise."""


def rules(machine: Machine) -> Iterator[Rule]:
    """What must hold between parameters; a rule may need all those before it."""
    yield from _component_rules(machine)
    yield from _payload_rules(machine)
    yield from _closure_rules(machine)


def _component_rules(machine: Machine) -> Iterator[Rule]:
    """What must hold between the parameters of one component."""
    arm, wheel, tire = machine.arm, machine.wheel, machine.tire

    for half in ("front", "rear"):
        body: HalfFrame = getattr(machine.frame, half)
        moments = (body.inertia_xx, body.inertia_yy, body.inertia_zz)
        yield (
            2.0 * np.maximum(np.maximum(moments[0], moments[1]), moments[2]) <= moments[0] + moments[1] + moments[2],
            [f"frame.{half}.inertia_{axes}" for axes in ("xx", "yy", "zz")],
            "no body has a principal moment of inertia above the sum of the others; lower the largest",
        )
    for name, axial, transverse, keys in (
        ("arm", arm.inertia_axial, arm.inertia_transverse, ["arm.inertia_axial", "arm.inertia_transverse"]),
        ("wheel", wheel.inertia_spin, wheel.inertia_transverse, ["wheel.inertia_spin", "wheel.inertia_transverse"]),
    ):
        yield (
            np.less_equal(axial, 2.0 * transverse),
            keys,
            f"a {name}'s moment of inertia about its axis is at most twice the transverse one; lower {keys[0]}",
        )
    yield (
        np.greater_equal(tire.friction_static, tire.friction_coulomb),
        ["tire.friction_static", "tire.friction_coulomb"],
        "static friction is at least Coulomb friction; raise tire.friction_static",
    )
    yield (
        np.less(tire.disc_offset_inner, tire.disc_offset_outer),
        ["tire.disc_offset_inner", "tire.disc_offset_outer"],
        "the inner discs lie inside the outer ones; lower tire.disc_offset_inner",
    )
    yield (
        np.less_equal(tire.disc_drop_inner, tire.disc_drop_outer) & np.less(tire.disc_drop_outer, tire.radius),
        ["tire.disc_drop_inner", "tire.disc_drop_outer", "tire.radius"],
        "the crown falls outward and leaves a radius; lower the inner drop, or the outer one",
    )
    valve = machine.steering.valve
    for side, first, second in (
        ("left", valve.opening_left_1V0, valve.opening_left_1V5),
        ("right", valve.opening_right_1V0, valve.opening_right_1V5),
    ):
        keys = [f"steering.valve.opening_{side}_1V0", f"steering.valve.opening_{side}_1V5"]
        yield (np.less_equal(first, second), keys, f"the opening curve rises; raise {keys[1]}")
        keys = [f"steering.valve.dead_band_{side}", "steering.valve.overlap"]
        yield (
            np.greater_equal(machine.value(keys[0]) + np.asarray(valve.overlap), 0.0),
            keys,
            f"the spool would be open in its middle; raise {keys[1]}",
        )
    for prefix, cylinder in (("arm", arm.cylinder), ("steering", machine.steering.cylinder)):
        keys = [f"{prefix}.cylinder.rod", f"{prefix}.cylinder.bore"]
        yield (np.less(cylinder.rod, cylinder.bore), keys, f"the rod fits into the bore; lower {keys[0]}")
        keys = [f"{prefix}.cylinder.stroke", f"{prefix}.cylinder.dead_length"]
        yield (
            np.less(cylinder.stroke, cylinder.dead_length),
            keys,
            f"a closed cylinder is longer than its stroke; lower {keys[0]}",
        )


def _payload_rules(machine: Machine) -> Iterator[Rule]:
    """What must hold of the logs in the bunk."""
    load = machine.payload
    yield (
        np.less_equal(load.count, MOST_LOGS),
        [f"{PAYLOAD}count"],
        f"a bunk holds at most {MOST_LOGS} logs; lower {PAYLOAD}count",
    )
    yield (
        np.greater_equal(load.bunk_width, 2.0 * np.asarray(load.diameter)),
        [f"{PAYLOAD}bunk_width", f"{PAYLOAD}diameter"],
        f"two logs lie side by side in the bunk; lower {PAYLOAD}diameter",
    )


def _closure_rules(machine: Machine) -> Iterator[Rule]:
    """What must hold between components: linkages close, wheels keep clear and stand on the ground."""
    frame, arm, tire = machine.frame, machine.arm, machine.tire
    for prefix, range_key, linkage in (
        ("arm", "arm.swing", arm.cylinder.linkage),
        ("steering", "joint.range", machine.steering.cylinder.linkage),
    ):
        yield (
            np.isfinite(linkage.g0),
            [*(f"{prefix}.cylinder.{name}" for name in ("stroke", "dead_length", "mount_ratio")), range_key],
            "no mounting lets the stroke span the range (to either side); move the mount ratio toward 1, or "
            "shorten the stroke against the dead length",
        )
    yield (
        np.less(arm.pivot_lateral, 0.5 * frame.track - tire.disc_offset_outer),
        ["arm.pivot_lateral", "frame.track", "tire.disc_offset_outer"],
        "the arms' pivots lie inside the tires; lower arm.pivot_lateral or widen frame.track",
    )
    # at full articulation either half keeps to its side of the plane that halves the joint angle
    turn = 0.5 * machine.joint.range
    for half in ("front", "rear"):
        body: HalfFrame = getattr(frame, half)
        yield (
            (body.axle_distance - tire.radius) * np.cos(turn)
            > (0.5 * frame.track + tire.disc_offset_outer) * np.sin(turn),
            [f"frame.{half}.axle_distance", "tire.radius", "frame.track", "tire.disc_offset_outer", "joint.range"],
            f"the wheels would meet at full articulation; lengthen frame.{half}.axle_distance",
        )
    rest = machine.rest
    or_lighten = f", or lighten the load ({PAYLOAD}count)" if machine.loaded else ""
    yield (
        np.isfinite(rest.arm_angle_rear),
        ["arm.rest_angle", "arm.length", "tire.radius", "tire.stiffness"],
        "the rear wheels cannot reach the ground at rest; move arm.rest_angle toward level or raise tire.stiffness"
        + or_lighten,
    )
    yield (
        np.greater(rest.wheel_load_front, 0.0) & np.greater(rest.wheel_load_rear, 0.0),
        [f"frame.{half}.{name}" for half in ("front", "rear") for name in ("cog_offset", "axle_distance")],
        "the centre of gravity lies between the axles; move it with a cog_offset" + or_lighten,
    )
    yield (
        np.less(rest.deflection_front, tire.radius) & np.less(rest.deflection_rear, tire.radius),
        ["tire.stiffness", "tire.radius"],
        "the load would crush the tires; raise tire.stiffness" + or_lighten,
    )
    yield (
        np.less(np.abs(rest.arm_angle_front), arm.swing) & np.less(np.abs(rest.arm_angle_rear), arm.swing),
        ["arm.rest_angle", "arm.swing"],
        "the wheels stand on the ground within the arms' swing; move arm.rest_angle toward level" + or_lighten,
    )
    yield (
        np.greater_equal(rest.bore_pressure_front, 0.0) & np.greater_equal(rest.bore_pressure_rear, 0.0),
        ["arm.rod_rest_pressure", "frame.front.cog_offset", "frame.rear.cog_offset"],
        "the arms' cylinders would have to pull at rest; move a cog_offset or raise arm.rod_rest_pressure",
    )
