"""C that follows from a machine: its variables, its record and how that follows from parameters."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from aoro_gym.cosimulation.export.expressions import Expression, c_name, c_text, symbolic
from aoro_gym.cosimulation.export.kernels import CompiledKernels, structure_of
from aoro_gym.cosimulation.export.variables import INPUT, OUTPUT, PARAMETER, Variable, bounds_text, of_kind
from aoro_gym.machine.machine_file import PAYLOAD
from aoro_gym.machine.parameters import DECLARATIONS, Machine, rules
from aoro_gym.machine.rest import Corner, composite_corner
from aoro_gym.terrains.raster import Raster
from aoro_gym.twin.hydraulic_step import TANK, Circuit, actuator_steps, circuits, swing_frequency
from aoro_gym.twin.physics.ground import Ground, Site
from aoro_gym.twin.records import MachineRecord, Output, State, fill
from aoro_gym.twin.twin import LONGEST_COMMAND_DELAY
from aoro_gym.units import GRAVITY

MAIN_STEP = 1e-3
"""Time step of the bodies [s] of an exported twin, as a twin has by default."""
SUBSTEPS = 30
"""Hydraulic substeps a main step, as a twin has by default."""
_VARIABLES = "/* variables */"
"""Where the header of C has them."""


def header(template: str, listed: Sequence[Variable], machine: Machine) -> str:
    """``aoro.h`` with the constants that number the variables."""
    width = max(len(one.identifier) for one in listed)
    lines = [f"    {one.identifier + ',':{width + 1}} /* {_unit(one)} {_comment(one.description)} */" for one in listed]
    return template.replace(_VARIABLES, "\n".join(lines)).replace("@machine@", _comment(machine.name))


def model(machine: Machine, listed: Sequence[Variable], kernels: CompiledKernels, raster: Raster | None) -> str:
    """``aoro_model.h``: all that the C layer does not know by itself.

    Args:
        machine: Gives the laws, and the formulas of the record.
        listed: The variables by number.
        kernels: What is called.
        raster: The terrain; None for a plane.
    """
    parts = [
        "/* Written by aoro-gym from the machine and its record; the formulas are those of its Python. */",
        _counts(listed),
        _table(listed),
        _records(kernels, Site if raster is not None else Ground),
        _ground(raster),
        _derivation(machine, listed),
    ]
    return "\n\n".join(parts) + "\n"


def _counts(listed: Sequence[Variable]) -> str:
    values = {
        "AORO_FIRST_INPUT": 1,
        "AORO_INPUTS": len(of_kind([*listed], INPUT)),
        "AORO_FIRST_OUTPUT": 1 + len(of_kind([*listed], INPUT)),
        "AORO_OUTPUTS": len(of_kind([*listed], OUTPUT)),
        "AORO_FIRST_PARAMETER": len(listed) - len(of_kind([*listed], PARAMETER)),
        "AORO_PARAMETERS": len(of_kind([*listed], PARAMETER)),
        "STATE_ROWS": len(State),
        "OUTPUT_ROWS": len(Output),
        "HISTORY_ROWS": int(np.ceil(LONGEST_COMMAND_DELAY / MAIN_STEP)) + 2,
        "SUBSTEPS": SUBSTEPS,
    }
    rows = ", ".join(str(int(Output[one.name.upper()])) for one in of_kind([*listed], OUTPUT))
    return "\n".join(
        [
            "enum {",
            *(f"    {name} = {value}," for name, value in values.items()),
            "};",
            f"static const double MAIN_STEP = {MAIN_STEP!r}; /* [s] */",
            f"static const int output_rows[AORO_OUTPUTS] = {{{rows}}};",
        ]
    )


def _table(listed: Sequence[Variable]) -> str:
    """The variables with their bounds in SI, and those in words."""
    kinds = {INPUT: "AORO_INPUT", OUTPUT: "AORO_OUTPUT", PARAMETER: "AORO_PARAMETER"}
    lines = []
    for one in listed:
        bounds = one.bounds
        low, high = (c_text(limit) for limit in (bounds.low, bounds.high))
        opened = f"{int(bounds.low_open)}, {int(bounds.high_open)}"
        lines.append(
            f'    {{"{one.name}", "{one.unit}", {kinds[one.kind]}, {int(one.whole)}, {one.start!r}, {one.factor!r}, '
            f'{low}, {high}, {opened}, "{bounds_text(one)}"}},'
        )
    return "\n".join(["static const struct variable variables[] = {", *lines, "};"])


def _records(kernels: CompiledKernels, ground: Any) -> str:
    """Structures that the kernels take, held against the sizes that Warp has them in."""
    layouts: Any = [kind.numpy_dtype() for kind in (MachineRecord, ground)]
    record, site = (np.dtype(layout) for layout in layouts)
    lines = [
        f"struct machine_record {structure_of(record).removeprefix('struct ')};",
        f'_Static_assert(sizeof(struct machine_record) == {record.itemsize}, "layout of the machine record");',
        f"struct ground_record {structure_of(site).removeprefix('struct ')};",
        f'_Static_assert(sizeof(struct ground_record) == {site.itemsize}, "layout of the ground");',
    ]
    for kernel, structure in kernels.arguments.items():
        symbol = kernels.symbols[kernel]
        lines += [
            f"struct {kernel}_arguments {structure.removeprefix('struct ')};",
            f"extern void {symbol}(struct launch_bounds *, struct {kernel}_arguments *);",
            f"#define {kernel}_kernel {symbol}",
        ]
    return "\n".join(lines)


def _ground(raster: Raster | None) -> str:
    """What a twin stands on, from its parameters."""
    common = [
        "    ground->friction = (float)ground_friction;",
        "    ground->rolling_resistance = (float)ground_rolling_resistance;",
        f"    ground->gravity = (float){GRAVITY!r};",
    ]
    if raster is None:
        own = [
            "    const double level = -sin(ground_slope);",
            "    ground->normal[0] = (float)(level * cos(ground_direction));",
            "    ground->normal[1] = (float)(level * sin(ground_direction));",
            "    ground->normal[2] = (float)cos(ground_slope);",
        ]
    else:
        rows, columns = raster.ceilings.shape
        x, y, inverse = (float(np.float32(value)) for value in (*raster.corner, 1.0 / raster.cell))
        own = [
            f"    ground->x = (float){x!r};",
            f"    ground->y = (float){y!r};",
            f"    ground->inverse_cell = (float){inverse!r};",
            f"    ground->columns = {columns};",
            f"    ground->rows = {rows};",
        ]
    names = ("friction", "rolling_resistance", *(("slope", "direction") if raster is None else ()))
    lines = [
        "static void lay_ground(const double *parameters, struct ground_record *ground)",
        "{",
        *(f"    const double ground_{name} = si(parameters, AORO_GROUND_{name.upper()});" for name in names),
        *common,
        *own,
        "}",
    ]
    return "\n".join([f"#define ON_TERRAIN {int(raster is not None)}", *lines])


class _Row:
    """A record of the device that notes the formula of each of its fields."""

    def __init__(self, dtype: Any, path: str, formulas: dict[str, Any]):
        self.dtype, self._path, self._formulas = dtype, path, formulas

    def __getitem__(self, name: str) -> _Row:
        return _Row(self.dtype[name], f"{self._path}{name}.", self._formulas)

    def __setitem__(self, name: str, value: Any) -> None:
        self._formulas[f"{self._path}{name}"] = value


def _derivation(machine: Machine, listed: Sequence[Variable]) -> str:
    """The function that fills a machine's record from its parameters, or says why it can be no machine."""
    named = symbolic(machine)
    formulas: dict[str, Any] = {}
    fields_of: Any = MachineRecord.numpy_dtype()
    layout = np.dtype(fields_of)
    fill(_Row(layout, "", formulas), named)
    body = [
        *_corner(named),
        *_linkages(),
        *_rest(),
        *_rules(named),
        *_stability(named),
        *(f"    record->{path} = ({_scalar(layout, path)}){c_text(value)};" for path, value in formulas.items()),
        "    return NULL;",
    ]
    used = set(re.findall(r"[A-Za-z_]\w*", "\n".join(body)))
    numbers = {one.name: one.identifier for one in listed}
    values = [
        f"    const double {c_name(key)} = si(parameters, {numbers[key]});"
        for key in DECLARATIONS
        if c_name(key) in used and key in numbers
    ]
    start = "static const char *derive(const double *parameters, struct machine_record *record)\n{"
    return "\n".join([start, *values, *body, "}"])


def _scalar(layout: Any, path: str) -> str:
    for name in path.split("."):
        layout = layout[name]
    return "float" if layout.kind == "f" else "int32_t"


def _corner(machine: Machine) -> Iterator[str]:
    """Arm, motor and wheel as one body; see aoro_gym/machine/rest.py."""
    corner = composite_corner(machine.arm, machine.wheel, machine.frame.track)
    for field in fields(Corner):
        yield f"    const double corner_{field.name} = {c_text(getattr(corner, field.name))};"


def _linkages() -> Iterator[str]:
    for name, half_range in (("arm", "arm_swing"), ("steering", "joint_range")):
        sizes = ", ".join(f"{name}_cylinder_{size}" for size in ("dead_length", "stroke", "mount_ratio"))
        yield f"    const struct linkage {name}_linkage = close_linkage({sizes}, {half_range});"


def _rest() -> Iterator[str]:
    """The rest pose; its inputs by name, see closure.h."""
    inputs = (
        "frame_front_mass", "frame_front_axle_distance", "frame_front_cog_offset", "frame_rear_mass",
        "frame_rear_axle_distance", "frame_rear_cog_offset", "corner_mass", "corner_rho", "arm_length", "arm_rest_angle",
        "arm_pivot_height", "arm_rod_rest_pressure", "arm_cylinder_bore", "arm_cylinder_rod", "tire_radius",
        "tire_stiffness",
    )  # fmt: skip
    yield "    const struct rest_pose rest = find_rest(&(struct rest_inputs){"
    yield from (f"        .{name} = {name}," for name in inputs)
    yield f"        .linkage = arm_linkage, .gravity = {GRAVITY!r}}});"


def _rules(machine: Machine) -> Iterator[str]:
    for holds, keys, sentence in rules(machine):
        if keys[0].startswith(PAYLOAD):
            continue
        yield f'    if (!{c_text(holds)}) return "{", ".join(keys)}: {sentence}";'


def _stability(machine: Machine) -> Iterator[str]:
    """The bound of aoro_gym/twin/hydraulic_step.py: no eigenvalue of a circuit is above what the step damps."""
    step = MAIN_STEP / SUBSTEPS
    swing = swing_frequency(machine)
    most = Expression("step") * swing * 0.5
    reason = "the circuits would be unstable at the hydraulic step; take values nearer to the machine file's"
    yield f"    const double step = {step!r};"
    yield f"    const double fastest = 2.0 / step * (1.0 - {c_text(most * most)});"
    for stiffness, restrictors in circuits(machine):
        yield from _circuit((stiffness, restrictors), reason)
    for bound in actuator_steps(machine):
        if isinstance(bound, Expression) or math.isfinite(float(bound)):
            yield f'    if (step > {c_text(bound)}) return "{reason}";'


def _circuit(circuit: Circuit, reason: str) -> Iterator[str]:
    stiffness, restrictors = circuit
    roots = ", ".join(c_text(np.sqrt(one)) for one in stiffness)
    yield "    {"
    yield f"        const double root[] = {{{roots}}};"
    yield f"        double matrix[{len(stiffness)} * {len(stiffness)}] = {{0}};"
    for first, second, slope in restrictors:
        ends = (first, second) if TANK not in (first, second) else (max(first, second), -1)
        yield f"        restrict_flow(matrix, root, {len(stiffness)}, {ends[0]}, {ends[1]}, {c_text(slope)});"
    yield f'        if (!all_below(matrix, {len(stiffness)}, fastest)) return "{reason}";'
    yield "    }"


def _unit(one: Variable) -> str:
    return f"[{one.unit if one.unit != '1' else '-'}]"


def _comment(text: str) -> str:
    return text.replace("*/", "* /").replace("\n", " ")
