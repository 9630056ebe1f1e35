"""Operations and bytes of the twin's main step, counted by running its very code on numbers that count.

:class:`Tally` runs a kernel's Python function with all laws that it calls, as they are written, on :class:`Number`\\ s:
every operation is computed and noted with its part of the machine and its class. Two counts are kept:

- as written;
- without repeats: an operation on operands that it already had is not counted again (value numbering), which is what a
  compiler with enough registers leaves – nothing that stays constant over the substeps is computed thirty times.

Each number also knows when it could be ready at the earliest, were there no end of units (the dataflow limit): the
longest chain of dependent operations says what one twin costs where few run side by side. Branches are counted, but
taken to be foreseen. Conventions: sign changes and magnitudes are modifiers of operands and cost nothing, nor do literals
with literals; a clamp is two comparisons; an array access is one integer operation for its address; an addition of a
product that is not yet used is ``fused`` (one instruction with its multiplication). Numbers are Python floats: a run also
reproduces the twin's float32 to its rounding, which the tests hold.
"""

from __future__ import annotations

import copy
import inspect
import math
import types
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.twin.kernels.advance import advance as advance_kernel
from aoro_gym.twin.physics.ground import Ground, Planes, Site
from aoro_gym.twin.records import MachineRecord
from aoro_gym.twin.twin import Twin

CLASSES = ("add", "multiply", "compare", "division", "root", "transcendental", "integer", "branch")
"""Of operations. ``compare``: comparisons, minima, maxima, selections, signs; ``integer``: also conversions, addresses."""
FLOATING = CLASSES[:6]
"""Classes that are floating-point operations."""

PARTS = {
    # by law file
    "arms": "arms",
    "steering": "steering",
    "driveline": "driveline",
    "tires": "tires",
    "ground": "ground query",
    "bodies": "bodies",
    # by function, where the file does not say
    "corner_contact": "tires",
    "hull_loads": "hull",
    "hull_corner": "hull",
    "hull_contact": "hull",
}
"""Part of the machine to which a function's operations count; a function that is not listed counts to its caller's."""
REST = "rest"

STRUCT: Any = type(MachineRecord)
"""Warp's type of structs."""


class Number:
    """A float or integer that counts what is done to it."""

    __slots__ = ("before", "key", "product", "ready", "tally", "value")

    def __init__(self, tally: Tally, value: float | int, ready: float = 0.0):
        self.tally = tally
        self.value = value
        self.key = tally.new_key()
        self.ready = ready
        """Earliest time at which it is known."""
        self.product = False
        """A product that no addition has taken up yet; its factors were ready at ``before``."""
        self.before = ready

    @property
    def _sum(self) -> str:
        return "integer" if isinstance(self.value, int) else "add"

    def __add__(self, other):
        return self.tally.add(self, other, 1)

    def __radd__(self, other):
        return self.tally.add(other, self, 1)

    def __sub__(self, other):
        return self.tally.add(self, other, -1)

    def __rsub__(self, other):
        return self.tally.add(other, self, -1)

    def __mul__(self, other):
        if isinstance(other, Vector | Matrix):
            return NotImplemented
        return self.tally.multiply(self, other)

    __rmul__ = __mul__

    def __truediv__(self, other):
        if isinstance(self.value, int) and isinstance(plain(other), int):  # Warp's integer division
            return self.tally.apply("integer", "/", self.value // plain(other), self, other)
        return self.tally.apply("division", "/", plain(self) / plain(other), self, other)

    def __rtruediv__(self, other):
        return self.tally.apply("division", "/", other / self.value, other, self)

    def __mod__(self, other):
        return self.tally.apply("integer", "%", self.value % plain(other), self, other)

    def __neg__(self):
        return self.tally.modify("-", -self.value, self)

    def __abs__(self):
        return self.tally.modify("abs", abs(self.value), self)

    def __lt__(self, other):
        return self.tally.compare("<", self.value < plain(other), self, other)

    def __le__(self, other):
        return self.tally.compare("<=", self.value <= plain(other), self, other)

    def __gt__(self, other):
        return self.tally.compare(">", self.value > plain(other), self, other)

    def __ge__(self, other):
        return self.tally.compare(">=", self.value >= plain(other), self, other)

    def __eq__(self, other):
        return self.tally.compare("==", self.value == plain(other), self, other)

    def __ne__(self, other):
        return self.tally.compare("!=", self.value != plain(other), self, other)

    __hash__ = None  # type: ignore[assignment]

    def __bool__(self):
        """A decision: Python asks for it in ``if``, ``and``, ``or`` and ``not``."""
        self.tally.note("branch", repeated=False)
        return bool(self.value)


class Builtins(types.SimpleNamespace):
    """What stands for the module ``wp`` in a counted function."""

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"wp.{name} is not counted yet; say in Tally._builtins what it computes and costs")


def plain(x: Any) -> Any:
    """The value of a number or literal."""
    return x.value if isinstance(x, Number) else x


class Vector:
    """A vector or quaternion (x, y, z, w) of numbers."""

    def __init__(self, *items: Any):
        self.items = list(items)

    def __getitem__(self, i: int):
        return self.items[i]

    def __setitem__(self, i: int, value: Any):
        self.items[i] = value

    def __iter__(self):
        return iter(self.items)

    def __copy__(self):
        return type(self)(*self.items)

    def __add__(self, other):
        return Vector(*(a + b for a, b in zip(self, other, strict=True)))

    def __sub__(self, other):
        return Vector(*(a - b for a, b in zip(self, other, strict=True)))

    def __neg__(self):
        return Vector(*(-a for a in self))

    def __mul__(self, other):
        if isinstance(other, Quaternion):
            return NotImplemented
        return Vector(*(other * a for a in self))

    __rmul__ = __mul__

    def __truediv__(self, other):
        return Vector(*(a / other for a in self))


class Quaternion(Vector):
    def __mul__(self, other):
        ax, ay, az, aw = self
        bx, by, bz, bw = other
        return Quaternion(
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )


class Matrix:
    """A 3 x 3 matrix of numbers."""

    def __init__(self, *items: Any):
        self.rows = [Vector(*items[i : i + 3]) for i in (0, 3, 6)]

    def __getitem__(self, place: tuple[int, int]):
        return self.rows[place[0]][place[1]]

    def __add__(self, other):
        return Matrix(*(x for a, b in zip(self.rows, other.rows, strict=True) for x in a + b))

    def __sub__(self, other):
        return Matrix(*(x for a, b in zip(self.rows, other.rows, strict=True) for x in a - b))

    def __neg__(self):
        return Matrix(*(-x for row in self.rows for x in row))

    def __mul__(self, other) -> Any:
        if isinstance(other, Vector):
            return Vector(*(dot(row, other) for row in self.rows))
        if isinstance(other, Matrix):
            columns = transpose(other).rows
            return Matrix(*(dot(row, column) for row in self.rows for column in columns))
        return Matrix(*(other * x for row in self.rows for x in row))

    def __rmul__(self, other):
        return self * other

    def __truediv__(self, other):
        return Matrix(*(x / other for row in self.rows for x in row))


def dot(a: Vector, b: Vector):
    terms = [x * y for x, y in zip(a, b, strict=True)]
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def transpose(m: Matrix) -> Matrix:
    return Matrix(*(m[i, j] for j in range(3) for i in range(3)))


def cross(a: Vector, b: Vector) -> Vector:
    return Vector(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def inverse(m: Matrix) -> Matrix:
    """By cofactors."""
    x, y, z = m.rows
    cofactors = [cross(y, z), cross(z, x), cross(x, y)]
    scale = 1.0 / dot(x, cofactors[0])
    return transpose(Matrix(*(scale * one for row in cofactors for one in row)))


def rotation(q: Quaternion) -> Matrix:
    """Of a unit quaternion."""
    x, y, z, w = q
    x2, y2, z2 = x + x, y + y, z + z
    xx, xy, xz, yy, yz, zz = x * x2, x * y2, x * z2, y * y2, y * z2, z * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return Matrix(
        1.0 - (yy + zz), xy - wz, xz + wy, xy + wz, 1.0 - (xx + zz), yz - wx, xz - wy, yz + wx, 1.0 - (xx + yy)
    )


class Record:
    """An instance of a ``wp.struct``."""

    def __init__(self, struct: Any, *values: Any):
        self.struct = struct
        for name, field in struct.vars.items():
            setattr(self, name, _zero(field.type))
        for name, value in zip(struct.vars, values, strict=False):
            setattr(self, name, value)


def _zero(kind: Any) -> Any:
    if isinstance(kind, STRUCT):
        return Record(kind)
    if kind is wp.mat33:
        return Matrix(*[0.0] * 9)
    length = getattr(kind, "_length_", 1)
    return Vector(*[0.0] * length) if length > 1 else 0.0


class Array:
    """An array on the device, whose loads and stores are counted in bytes."""

    def __init__(self, tally: Tally, name: str, values: Any, struct: Any = None):
        self.tally = tally
        self.name = name
        self.values = values
        self.struct = struct

    @property
    def shape(self) -> tuple[int, ...]:
        return self.values.shape

    def _place(self, index: Any) -> tuple[int, ...]:
        place = tuple(int(plain(i)) for i in (index if isinstance(index, tuple) else (index,)))
        one = self.values[place]
        self.tally.note("integer", repeated=False)
        self.tally.bytes[self.name] += one.nbytes
        return place

    def __getitem__(self, index: Any):
        return self.tally.leaf(self.values[self._place(index)], self.struct)

    def __setitem__(self, index: Any, value: Any):
        self.values[self._place(index)] = plain(value)
        if isinstance(value, Number):
            self.tally.longest = max(self.tally.longest, value.ready)


class Sets:
    """Arrays that stand one behind the other in a larger one; to choose one of them loads nothing."""

    def __init__(self, *arrays: Array):
        self.arrays = arrays
        self.shape = (len(arrays), *arrays[0].shape)

    def __getitem__(self, index: Any) -> Array:
        return self.arrays[int(plain(index))]


class Tally:
    """What a run costs.

    Args:
        latency: Time of an operation of each class from operands to result; one each by default.
        gpu: As on a GPU, an addition takes up a product in one instruction, and an inverse root is one.
    """

    def __init__(self, latency: dict[str, float] | None = None, *, gpu: bool = True):
        self.gpu = gpu
        self.latency = dict.fromkeys(CLASSES, 1.0) | (latency or {})
        self.written: Counter[tuple[str, str]] = Counter()
        """Operations by (part, class), as written."""
        self.distinct: Counter[tuple[str, str]] = Counter()
        """The same without repeats."""
        self.fused = 0
        """Additions, repeats left out, that take up a product."""
        self.bytes: Counter[str] = Counter()
        """Bytes loaded and stored by array."""
        self.longest = 0.0
        """Longest chain of dependent operations up to a stored number, in the units of ``latency``."""
        self._part = REST
        self._keys = 0
        self._known: dict[Any, Number] = {}
        self._shadows: dict[int, Any] = {}

    # ---- numbers ---------------------------------------------------------------------------------------------------

    def new_key(self) -> int:
        self._keys += 1
        return self._keys

    def number(self, value: float | int) -> Number:
        """A number that comes from outside."""
        return Number(self, value)

    def leaf(self, value: Any, struct: Any = None) -> Any:
        """What a device value becomes: a number, vector or record of new numbers."""
        if struct is not None:
            names = struct.vars
            return Record(
                struct,
                *(self.leaf(value[n], names[n].type if isinstance(names[n].type, STRUCT) else None) for n in names),
            )
        if np.ndim(value):
            return Vector(*(self.number(one.item()) for one in value))
        return self.number(value.item())

    def note(self, kind: str, *, repeated: bool) -> None:
        self.written[self._part, kind] += 1
        if not repeated:
            self.distinct[self._part, kind] += 1

    def _operate(self, kind: str | None, name: str, value: Any, operands: tuple, start: float, fused: bool) -> Number:
        key = (name, *(x.key if isinstance(x, Number) else ("literal", x) for x in operands))
        known = self._known.get(key)
        if kind is not None:
            self.note(kind, repeated=known is not None)
        if known is not None:
            return known
        self.fused += fused
        out = Number(self, value, start + (self.latency[kind] if kind else 0.0))
        self._known[key] = out
        return out

    def apply(self, kind: str, name: str, value: Any, *operands: Any) -> Any:
        """Result ``value`` of an operation of class ``kind``; plain if all operands are."""
        if not any(isinstance(x, Number) for x in operands):
            return value
        return self._operate(kind, name, value, operands, _ready(operands), False)

    def modify(self, name: str, value: Any, x: Number) -> Number:
        """A free modifier."""
        return self._operate(None, name, value, (x,), x.ready, False)

    def compare(self, name: str, value: bool, *operands: Any) -> Number:
        return self.apply("compare", name, value, *operands)

    def add(self, a: Any, b: Any, sign: int) -> Any:
        value = plain(a) + sign * plain(b)
        if isinstance(value, int):
            return self.apply("integer", "+-"[sign < 0], value, a, b)
        product = next((x for x in (a, b) if isinstance(x, Number) and x.product), None)
        other = b if product is a else a
        start = _ready((a, b)) if product is None else max(product.before, _ready((other,)))
        operands = (a, b) if sign < 0 else tuple(sorted((a, b), key=_order))
        out = self._operate("add", "+-"[sign < 0], value, operands, start, product is not None)
        if product is not None:
            product.product = False
        return out

    def multiply(self, a: Any, b: Any) -> Any:
        value = plain(a) * plain(b)
        if isinstance(value, int):
            return self.apply("integer", "*", value, a, b)
        known = self._keys
        start = _ready((a, b))
        out = self._operate("multiply", "*", value, tuple(sorted((a, b), key=_order)), start, False)
        if self.gpu and out.key > known:
            out.product, out.before = True, start
        return out

    # ---- Warp's built-in functions ---------------------------------------------------------------------------------

    def _builtins(self) -> Builtins:
        def unary(kind: str, name: str, function: Callable[[Any], Any]) -> Callable[[Any], Any]:
            return lambda x: self.apply(kind, name, function(plain(x)), x)

        def binary(kind: str, name: str, function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
            return lambda x, y: self.apply(kind, name, function(plain(x), plain(y)), x, y)

        def where(condition: Any, yes: Any, no: Any) -> Any:
            if not isinstance(condition, Number):
                return yes if condition else no
            chosen = plain(yes if condition.value else no)
            return self.apply("compare", "where", chosen, condition, yes, no)

        def normalize(v: Vector) -> Vector:
            size = sqrt(dot(v, v))
            return type(v)(*(x / size for x in v))

        def skew(v: Vector) -> Matrix:
            return Matrix(0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0)

        def diag(v: Vector) -> Matrix:
            return Matrix(v[0], 0.0, 0.0, 0.0, v[1], 0.0, 0.0, 0.0, v[2])

        def vec4(*items: Any) -> Vector:
            return Vector(*(items or [0.0] * 4))

        sqrt = unary("root", "sqrt", math.sqrt)
        smaller, larger = binary("compare", "min", min), binary("compare", "max", max)
        transcendental = {
            name: unary("transcendental", name, getattr(math, name))
            for name in ("exp", "log", "sin", "cos", "tanh", "asin")
        }
        return Builtins(
            **transcendental,
            pow=binary("transcendental", "pow", math.pow),
            atan2=binary("transcendental", "atan2", math.atan2),
            sqrt=sqrt,
            abs=abs,
            min=smaller,
            max=larger,
            clamp=lambda x, low, high: smaller(larger(x, low), high),
            where=where,
            sign=unary("compare", "sign", lambda x: -1.0 if x < 0.0 else 1.0),
            floor=unary("integer", "floor", lambda x: float(math.floor(x))),
            isfinite=unary("compare", "isfinite", math.isfinite),
            tid=lambda: 0,
            vec3=Vector,
            vec4=vec4,
            quat=Quaternion,
            mat33=Matrix,
            dot=dot,
            cross=cross,
            length=lambda v: sqrt(dot(v, v)),
            normalize=normalize,
            skew=skew,
            diag=diag,
            outer=lambda a, b: Matrix(*(x * y for x in a for y in b)),
            transpose=transpose,
            inverse=inverse,
            quat_to_matrix=rotation,
        )

    def _to_float(self, x: Any) -> Any:
        return self.apply("integer", "float", float(plain(x)), x)

    def _to_int(self, x: Any) -> Any:
        return self.apply("integer", "int", int(plain(x)), x)

    def _native(self, name: str) -> Callable[..., Any]:
        """A function that the device code spells in C++."""

        def inverse_root(x: Any) -> Any:
            if self.gpu:
                return self.apply("root", "inverse root", 1.0 / math.sqrt(plain(x)), x)
            return 1.0 / self.apply("root", "sqrt", math.sqrt(plain(x)), x)

        known = {"inverse_root": inverse_root, "on_cuda": lambda: self.gpu, "seldom": lambda x: x}
        if name not in known:
            raise TypeError(f"{name} is C++ and not counted yet; say in Tally._native what it computes and costs")
        return known[name]

    # ---- the code ---------------------------------------------------------------------------------------------------

    def of(self, thing: Any) -> Any:
        """The counting counterpart of what a kernel's code names: a function, a struct, Warp itself, a constant."""
        if id(thing) not in self._shadows:
            if thing is wp:
                made = self._builtins()
            elif isinstance(thing, wp.Function) and thing.native_snippet:
                made = self._native(thing.key)
            elif isinstance(thing, wp.Function):
                made = self._overloaded(thing)
            elif isinstance(thing, types.FunctionType):
                made = self._function(thing)
            elif isinstance(thing, STRUCT):
                made = lambda *values: Record(thing, *values)  # noqa: E731
            else:
                made = thing
            self._shadows[id(thing)] = made
        return self._shadows[id(thing)]

    def _function(self, function: types.FunctionType) -> Callable[..., Any]:
        part = PARTS.get(function.__name__, PARTS.get(function.__module__.rpartition(".")[2]))
        names: dict[str, Any] = {"float": self._to_float, "int": self._to_int}
        body: Any = None

        def call(*arguments: Any) -> Any:
            nonlocal body
            if body is None:  # at the first call, as functions may name each other
                used = {n: self.of(v) for n, v in function.__globals__.items() if n in function.__code__.co_names}
                body = types.FunctionType(function.__code__, names | used)
            outer, self._part = self._part, part or self._part
            try:
                # structs and vectors go by value
                return body(*(copy.copy(x) if isinstance(x, Record | Vector) else x for x in arguments))
            finally:
                self._part = outer

        return call

    def _overloaded(self, function: Any) -> Callable[..., Any]:
        ways = [
            (
                [kind.key if isinstance(kind, STRUCT) else None for kind in one.input_types.values()],
                self._function(one.func),
            )
            for one in (*function.user_overloads.values(), *function.user_templates.values())
        ]

        def call(*arguments: Any) -> Any:
            asked = [x.struct.key if isinstance(x, Record) else None for x in arguments]
            for kinds, way in ways:
                if all(kind in (None, one) for kind, one in zip(kinds, asked, strict=True)):
                    return way(*arguments)
            raise TypeError(f"no overload of {function.key} takes {asked}; the others are {[k for k, _ in ways]}")

        return call


def _ready(operands: tuple) -> float:
    return max((x.ready for x in operands if isinstance(x, Number)), default=0.0)


def _order(x: Any) -> tuple:
    return (0, x.key) if isinstance(x, Number) else (1, x)


def advance(twin: Twin, steps: int, tally: Tally) -> np.ndarray:
    """Run the kernel ``advance`` on a one-twin ``twin`` as it stands, ``steps`` main steps with one output frame.

    Returns:
        The state after it, shape (len(State), 1); the twin itself stays as it was. Planes and rasters only.
    """
    terrain = Record(twin.ground._cls)
    for name in twin.ground._cls.vars:
        struct = {"twins": Ground if twin.ground._cls is Planes else Site, "terrains": Site}.get(name)
        setattr(terrain, name, Array(tally, f"ground.{name}", getattr(twin.ground, name).numpy(), struct))
    state = twin.state.numpy().copy()
    known = {
        "machines": Array(tally, "machines", twin._machines.numpy(), MachineRecord),
        "laws": Record(type(twin._laws)._cls),
        "terrain": terrain,
        "commands": Sets(Array(tally, "commands", twin.commands.numpy())),
        "state": Array(tally, "state", state),
        "history": Array(tally, "history", twin._history.numpy().copy()),
        "clock": Array(tally, "clock", twin._clock.numpy().copy()),
        "status": Array(tally, "status", twin._status.numpy().copy()),
        "outputs": Array(tally, "outputs", np.zeros_like(twin._outputs.numpy()[:1])),
        "first": 0,
        "num_frames": 1,
        "frame_steps": steps,
        "num_substeps": twin.substeps,
        "h": tally.number(twin.main_step),
    }
    asked = list(inspect.signature(advance_kernel).parameters)
    if unknown := [name for name in asked if name not in known]:
        raise TypeError(f"the kernel takes {unknown}, which is not counted yet; add it here")
    tally.of(advance_kernel)(*(known[name] for name in asked))
    return state


@dataclass(frozen=True)
class Cost:
    """What one more main step of a launch costs, and what the launch itself moves."""

    written: Counter[tuple[str, str]]
    """Operations by (part, class), as written."""
    distinct: Counter[tuple[str, str]]
    """The same without repeats."""
    fused: float
    """Additions that take up a product."""
    step_bytes: Counter[str]
    """By array, each main step."""
    launch_bytes: Counter[str]
    """By array, once a launch of any length with one output frame."""
    chain: float
    """Longest chain of dependent operations in the units of the latencies."""


def cost(twin: Twin, latency: dict[str, float] | None = None, *, gpu: bool = True) -> Cost:
    """Cost of a main step from where a one-twin ``twin`` stands: what two steps take more than one."""
    one, two = Tally(latency, gpu=gpu), Tally(latency, gpu=gpu)
    advance(twin, 1, one)
    advance(twin, 2, two)
    step_bytes = two.bytes - one.bytes
    return Cost(
        written=two.written - one.written,
        distinct=two.distinct - one.distinct,
        fused=two.fused - one.fused,
        step_bytes=step_bytes,
        launch_bytes=one.bytes - step_bytes,
        chain=two.longest - one.longest,
    )
