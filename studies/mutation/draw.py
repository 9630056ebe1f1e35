"""Draw mutants of laws, sensors, terrains and environments by a seed: ``python studies/mutation/draw.py``, mutants.json.

A place is drawn first, as many in each package, then one of cosmic-ray's operators that apply there; a place with many
operators (11 for each sign) counts no more than one with few. What changes annotations or docstrings alone, or is no
Python, is not drawn.
"""

import ast
import json
import random
import re
import tomllib
from collections import defaultdict
from pathlib import Path

import cosmic_ray.plugins as plugins  # pyright: ignore[reportMissingImports]
from cosmic_ray.ast import ast_nodes, get_ast  # pyright: ignore[reportMissingImports]
from cosmic_ray.mutating import mutate_code  # pyright: ignore[reportMissingImports]

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


def code(source: str) -> str:
    """The syntax tree of ``source`` without annotations and docstrings; nothing if it is no Python."""
    try:
        tree = ast.parse(source)
    except SyntaxError:
        return ""
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign | ast.arg):
            node.annotation = ast.Constant(None)
        elif isinstance(node, ast.FunctionDef):
            node.returns = None
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            node.value = ast.Constant(None)
    return ast.dump(tree)


def places(path: Path, without: str) -> dict[tuple, list[tuple[str, int]]]:
    """Operators and their occurrences by the place in ``path`` that they change."""
    found = defaultdict(list)
    tree = get_ast(path.read_text(encoding="utf-8"))
    for name in plugins.operator_names():
        kind = plugins.get_operator(name)
        if kind.arguments() or re.search(without, name):
            continue
        spots = (spot for node in ast_nodes(tree) for spot in kind().mutation_positions(node))
        for occurrence, spot in enumerate(spots):
            found[spot].append((name, occurrence))
    return found


def changed(old: list[str], new: list[str]) -> dict:
    """The lines that differ, and the number of the first."""
    first = next(i for i, pair in enumerate(zip(old, new, strict=False)) if pair[0] != pair[1])
    last = next(i for i, pair in enumerate(zip(old[::-1], new[::-1], strict=False)) if pair[0] != pair[1])
    end = {"old": max(len(old) - last, first), "new": max(len(new) - last, first)}
    return {"line": first + 1, "old": old[first : end["old"]], "new": new[first : end["new"]]}


def draw(package: str, config: dict, rng: random.Random) -> list[dict]:
    """Mutants of a package: each with its file, line, operator and lines before and after."""
    left_out = {path for pattern in config["no_files"] for path in (ROOT / package).glob(pattern)}
    files = sorted(set((ROOT / package).rglob("*.py")) - left_out)
    every = [(path, spot[1]) for path in files for spot in sorted(places(path, config["without"]).items())]
    mutants = []
    for path, operators in rng.sample(every, len(every)):
        source = path.read_text(encoding="utf-8")
        name, occurrence = rng.choice(operators)
        mutated = mutate_code(source, plugins.get_operator(name)(), occurrence)
        if mutated is None or code(mutated) in ("", code(source)):
            continue
        file = str(path.relative_to(ROOT))
        mutants.append({"file": file, "operator": name, **changed(source.splitlines(), mutated.splitlines())})
        if len(mutants) == config["mutants_a_package"]:
            break
    return mutants


def main() -> None:
    config = tomllib.loads((HERE / "config.toml").read_text(encoding="utf-8"))
    rng = random.Random(config["seed"])
    mutants = [one for package in config["wider"] for one in draw(package, config, rng)]
    (HERE / "mutants.json").write_text(json.dumps(mutants, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
