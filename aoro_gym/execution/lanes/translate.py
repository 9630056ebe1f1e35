"""From the C++ that Warp has generated for a kernel on the CPU to the same on several lanes at once.

Warp writes a kernel as a sequence of single assignments, with ``where`` after each branch. So its text is kept as it is, but

- numbers are as wide as the lanes (``lanes.h``): a branch is taken if any lane takes it, and what it assigns is selected by
  the ``where`` that Warp wrote;
- what a branch changes in place (a field, an array, a loop's variable) is changed in the lanes that take it only;
- a function that returns in a branch goes on for the others, and selects its results in the end;
- structs go by reference, of which Warp writes copies for its compiler to remove.

Loops have to run alike in all lanes, and an index into a vector has to be the same. What is known to be otherwise raises
:class:`Untranslatable`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

STRUCT = re.compile(r"^struct (\w+)\n\{\n(.*?)\n\};\n", re.M | re.S)
FUNCTION = re.compile(r"^static (?:CUDA_CALLABLE )?([\w:<>, ]+?) (\w+)\(\n(.*?)\)\n\{\n(.*?)^\}\n", re.M | re.S)
FIELD = re.compile(r"^    ([\w:<>, ]+) (\w+);$", re.M)
ASSIGNED = re.compile(r"^(\w+) = (.*);$")
CHANGED = re.compile(r"^(var_\w+)((?:\.\w+)+) = (.*);$")
BRANCH = re.compile(r"^if \((!?)(var_\w+)\) \{$")
IN_PLACE = ("wp::assign(", "wp::assign_inplace(", "wp::store(")


class Untranslatable(ValueError):
    """A kernel that lanes cannot run alike."""


@dataclass(frozen=True)
class Struct:
    """A struct of the generated code: types by name of its fields, in their order."""

    name: str
    fields: Mapping[str, str]

    def as_lanes(self) -> str:
        """Its definition, how it lies in memory, and how lanes take theirs from there or select from two."""
        name, fields = self.name, self.fields
        declared = "".join(f"    {kind} {one};\n" for one, kind in fields.items())
        arguments = ", ".join(
            f"const {kind}& {one}" + ("" if i == 0 else " = {}") for i, (one, kind) in enumerate(fields.items())
        )
        begun = ", ".join(f"{one}{{{one}}}" for one in fields)
        stored = "".join(f"    typename wp::memory<{kind}>::type {one};\n" for one, kind in fields.items())
        taken = "".join(
            f"        out.{one} = memory<{kind}>::taken(at + offsetof(type, {one}), away);\n"
            for one, kind in fields.items()
        )
        chosen = "".join(
            f"    out.{one} = a.{one};\n" if "array_t" in kind else f"    out.{one} = where(m, a.{one}, b.{one});\n"
            for one, kind in fields.items()
        )
        return (
            f"struct {name} {{\n{declared}    {name}() = default;\n    INLINE {name}({arguments}) : {begun} {{}}\n}};\n"
            f"struct {name}_stored {{\n{stored}}};\n"
            f"namespace wp {{\ntemplate <> struct memory<{name}> {{\n    typedef {name}_stored type;\n"
            f"    INLINE static {name} taken(const char* at, int32 away)\n    {{\n        {name} out;\n{taken}"
            f"        return out;\n    }}\n}};\n"
            f"INLINE {name} where(mask m, const {name}& a, const {name}& b)\n{{\n    {name} out;\n"
            f"{chosen}    return out;\n}}\n}}\n"
        )


@dataclass
class Function:
    """A function of the generated code, as text."""

    kind: str
    name: str
    arguments: str
    body: str

    @property
    def calls(self) -> set[str]:
        """Names of what it may call."""
        return set(re.findall(r"(\w+_\d+)\(", self.body))


@dataclass
class Body:
    """Lines of a function's body while they are translated.

    Attributes:
        kernel: Whether it is the kernel's, whose lanes end where they return.
        early: Whether it returns in a branch.
        lines: So far.
        masks: Names of the masks of the branches that a line lies in; empty for other braces.
        count: Masks so far.
    """

    kernel: bool
    early: bool
    lines: list[str] = field(default_factory=list)
    masks: list[str] = field(default_factory=list)
    count: int = 0

    @property
    def mask(self) -> str:
        """Lanes that a line is for; empty for all."""
        return next((one for one in reversed(self.masks) if one), "")

    def add(self, line: str) -> None:
        """Translate a line."""
        branch = BRANCH.match(line)
        if branch:
            self._open(branch.group(1) + branch.group(2))
        elif line.startswith("if (") and "iter_cmp" not in line:
            raise Untranslatable(f"a loop may run unlike in each ({line})")
        elif line.endswith("{"):
            self.masks.append("")
            self.lines.append(line)
        elif line == "}":
            if not self.masks:
                raise Untranslatable("a brace too many")
            self.lines.append("}}" if self.masks.pop() else "}")
        elif line.startswith("return"):
            self._return(line[len("return") : -1].strip())
        else:
            self._state(line)

    def _open(self, condition: str) -> None:
        self.count += 1
        name = f"m_{self.count}"
        within = f"{self.mask} && {condition}" if self.mask else condition
        self.lines.append(f"{{ const wp::mask {name} = {within}; if (wp::any({name})) {{")
        self.masks.append(name)

    def _state(self, line: str) -> None:
        changed = CHANGED.match(line)
        if line.startswith("wp::array_store("):
            line = line.replace("(", f"({self.mask or 'wp::mask(true)'}, ", 1)
        elif changed and self.mask:
            line = f"wp::assign({self.mask}, {changed.group(1)}{changed.group(2)}, {changed.group(3)});"
        elif self.mask and line.startswith(IN_PLACE):
            line = line.replace("(", f"({self.mask}, ", 1)
        elif line.startswith("ret_") and self.early:
            name, value = re.match(r"(ret_\d+) = (.*);", line).groups()  # pyright: ignore[reportOptionalMemberAccess]
            line = f"{name} = wp::where(returned, {name}, {value});"
        elif re.match(r"wp::\w+\(", line) and not line.startswith(IN_PLACE):
            raise Untranslatable(f"lanes know no {line.split('(')[0]}")
        self.lines.append(line)

    def _return(self, value: str) -> None:
        mask = self.mask
        if self.kernel:
            gone = f"wp::active = wp::active && !{mask}; if (!wp::any(wp::active)) return;" if mask else "return;"
            self.lines.append(gone)
        elif mask:
            if value:
                self.lines.append(f"result = wp::where(returned, result, {value});")
            self.lines.append(f"returned = returned || {mask};")
            self.lines.append("if (wp::all(returned)) return result;" if value else "if (wp::all(returned)) return;")
        elif value and self.early:
            self.lines.append(f"return wp::where(returned, result, {value});")
        else:
            self.lines.append(f"return {value};".replace(" ;", ";"))


def translated(source: str, kernel: str) -> str:
    """C++ that has ``kernel`` on lanes as ``extern "C" void advance(launch_bounds_t<1>*, arguments*)``, as Warp calls it.

    Args:
        source: What Warp has generated for the CPU.
        kernel: Name of the kernel there.

    Raises Untranslatable where lanes cannot do as threads do.
    """
    source = re.sub(r"^\s*//.*\n", "", source, flags=re.M)
    structs = [
        Struct(name, {field: kind for kind, field in FIELD.findall(body.split("\n\n")[0])})
        for name, body in STRUCT.findall(source)
    ]
    functions = [Function(kind, name, arguments, body) for kind, name, arguments, body in FUNCTION.findall(source)]
    arguments = re.search(rf"^struct wp_args_{kernel} \{{\n(.*?)^\}};", source, re.M | re.S)
    whole = re.search(rf"^static void {kernel}_cpu_kernel_forward\(\n.*?\)\n\{{\n(.*?)^\}}\n", source, re.M | re.S)
    if arguments is None or whole is None:
        raise Untranslatable(f"the generated code has no kernel {kernel}")
    main = Function("void", kernel, "", whole.group(1))
    needed = _needed(main, functions)
    used = main.body + "".join(one.kind + one.arguments + one.body for one in needed)
    kept = _used(structs, used + arguments.group(1))
    names = {one.name for one in kept}
    out = ['#include "lanes.h"\n', *(one.as_lanes() for one in kept)]
    out += [_function(one, names) for one in needed]
    out.append(_entry(main, FIELD.findall(arguments.group(1)), names))
    return _widened("\n".join(out))


def _needed(main: Function, functions: Sequence[Function]) -> list[Function]:
    """Functions that a kernel may call, in the order of their definitions; several may have one name."""
    found: set[str] = set()
    waiting = main.calls
    while waiting:
        name = waiting.pop()
        found.add(name)
        for one in functions:
            if one.name == name:
                waiting |= one.calls - found
    return [one for one in functions if one.name in found]


def _used(structs: Iterable[Struct], text: str) -> list[Struct]:
    found: list[Struct] = []
    for one in reversed(list(structs)):
        if re.search(rf"\b{one.name}\b", text):
            found.append(one)
            text += " ".join(one.fields.values()) + " "
    return found[::-1]


def _function(one: Function, structs: set[str]) -> str:
    lines = [line.strip() for line in one.body.splitlines() if line.strip()]
    if any(line.startswith("#if") for line in lines):  # written by hand
        return f"static INLINE {one.kind} {one.name}({' '.join(one.arguments.split())})\n{{\n{one.body}}}\n"
    returns = [line for line in lines if line.startswith("return")]
    body = Body(False, len(returns) > 1)
    if body.early:
        body.lines.append("wp::mask returned(false);")
        if one.kind != "void":
            body.lines.append(f"{one.kind} result;")
    for line in _referring(lines, structs):
        body.add(line)
    changed = "\n".join(body.lines)
    arguments = ",\n    ".join(_argument(part.strip(), changed, structs) for part in one.arguments.split(",\n"))
    return f"static {one.kind} {one.name}(\n    {arguments})\n{{\n{changed}\n}}\n"


def _argument(text: str, body: str, structs: set[str]) -> str:
    """An argument, by reference where it is large and the body does not change it."""
    if "&" in text or not text:
        return text
    kind, name = text.rsplit(" ", 1)
    large = kind in structs or "vec_t" in kind or "mat_t" in kind or "quat_t" in kind or "array_t" in kind
    written = re.search(rf"\b{name}(?:\.\w+)+ = |assign(?:_inplace)?\((?:\w+, )?{name}\b|store\(.*&?{name}\b", body)
    return f"const {kind}& {name}" if large and not written else text


def _referring(lines: list[str], structs: set[str]) -> list[str]:
    """Lines whose pointers are to constants, but for those that are written through, and whose copies of structs are
    references as long as nothing is changed between the copy and its last use."""
    text = "\n".join(lines)
    stored = set(re.findall(r"wp::store\((var_\w+),", text))
    addressed = dict(re.findall(r"^(var_\w+) = wp::(address|view)\(", text, re.M))
    referred = _referred(lines, structs)
    out = []
    for line in lines:
        declared = re.match(r"^([\w:<>, ]+)\* (var_\w+);$", line)
        if declared and addressed.get(declared.group(2)) == "address":
            line = f"wp::ref<{declared.group(1)}> {declared.group(2)};"
        elif declared and declared.group(2) not in stored:
            line = f"const {line}"
        one = re.match(r"^([\w:<>, ]+) (var_\w+);$", line)
        if one and one.group(2) in referred:
            line = f"const {one.group(1)}* {one.group(2)};"
        loaded = re.match(r"^(var_\w+) = wp::load\((var_\w+)\);$", line)
        if loaded and loaded.group(1) in referred:
            line = f"{loaded.group(1)} = {loaded.group(2)};"
        elif not one:
            line = re.sub(r"\bvar_\w+\b", lambda m: f"(*{m.group()})" if m.group() in referred else m.group(), line)
        out.append(line)
    return out


def _referred(lines: list[str], structs: set[str]) -> set[str]:
    """Variables that are copies of structs which nothing changes before their last use."""
    kinds = {m.group(2): m.group(1) for line in lines if (m := re.match(r"^([\w:<>, ]+) (var_\w+);$", line))}
    addressed = {m.group(1) for line in lines if (m := re.match(r"^(var_\w+) = wp::address\(", line))}
    changes = [i for i, line in enumerate(lines) if CHANGED.match(line) or line.startswith(IN_PLACE) or "goto" in line]
    found = set()
    for i, line in enumerate(lines):
        loaded = re.match(r"^(var_\w+) = wp::load\((var_\w+)\);$", line)
        if not loaded or kinds.get(loaded.group(1)) not in structs or loaded.group(2) in addressed:
            continue
        name = loaded.group(1)
        uses = [
            k
            for k, other in enumerate(lines)
            if k != i and re.search(rf"\b{name}\b", other) and not re.match(rf"^[\w:<>, ]+ {name};$", other)
        ]
        if (
            uses
            and min(uses) > i
            and not any(i < k <= max(uses) for k in changes)
            and not any(CHANGED.match(lines[k]) for k in uses)
        ):
            found.add(name)
    return found


def _entry(main: Function, fields: list[tuple[str, str]], structs: set[str]) -> str:
    stored = "".join(f"    typename wp::memory<{kind}>::type {name};\n" for kind, name in fields)
    lines = [line.strip() for line in main.body.splitlines() if line.strip()]
    lines = [line for line in lines if not line.startswith("static constexpr")]
    body = Body(True, True)
    for line in _referring(lines, structs):
        given = re.match(r"^([\w:<>, ]+) (var_\w+) = _wp_args->(\w+);$", line)
        if given:
            kind, name, of = given.groups()
            line = f"const {kind} {name} = wp::memory<{kind}>::taken((const char*)&arguments->{of}, wp::int32(0));"
        body.add(line.replace("builtin_tid1d()", "wp::lanes_from(task, size)"))
    text = "\n".join(body.lines)
    return (
        f"struct arguments_t {{\n{stored}}};\n\n"
        f"static void lanes_at(size_t task, size_t size, const arguments_t* arguments)\n{{\n{text}\n}}\n\n"
        'extern "C" void advance(wp::launch_bounds_t<1>* bounds, arguments_t* arguments)\n{\n'
        "    for (size_t task = 0; task < bounds->size; task += LANES)\n"
        "        lanes_at(task, bounds->size, arguments);\n}\n"
    )


def _widened(text: str) -> str:
    """The text with its words for truths, casts and constants as ``lanes.h`` has them."""
    text = re.sub(r"\bconst wp::int32 (var_\w+) = (-?\d+);", r"const int \1 = \2;", text)
    text = re.sub(r"\bwp::int\(", "wp::to_int(", text)
    text = re.sub(r"\bwp::float\(", "wp::to_float(", text)
    text = re.sub(r"\bbool\b", "wp::mask", text)
    return text.replace("CUDA_CALLABLE ", "")
