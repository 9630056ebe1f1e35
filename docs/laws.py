"""Tables of laws, families and measuring chains in docs/howto/laws.md: ``python docs/laws.py`` writes them anew."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from aoro_gym.machine.laws import FAMILIES, LAWS, family
from aoro_gym.sensors.chain import CHAINS, PUBLISHED

PAGE = Path(__file__).parent / "howto" / "laws.md"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])


def laws() -> str:
    """Every law: what it is of, its options, the default twin's first, and the parameters that they have of their own."""
    return table(
        ["law", "of", "options"],
        [
            [
                f"`{name}`",
                law.about.removesuffix("."),
                "<br>".join(
                    f"`{option}`" + "".join(f", `{key}`" for key in law.parameters.get(option, ()))
                    for option in law.options
                ),
            ]
            for name, law in LAWS.items()
        ],
    )


def families() -> str:
    """What every family chooses; nothing where that is the default twin's option."""
    chosen = {name: family(name).names for name in FAMILIES if name != "default"}
    return table(
        ["law", *(f"`{name}`" for name in chosen)],
        [
            [f"`{law}`", *("" if names[law] == LAWS[law].options[0] else str(names[law]) for names in chosen.values())]
            for law in LAWS
        ],
    )


def chains() -> str:
    """In what every measuring chain differs from the published one."""
    changed = {
        name: {one.name: getattr(chain, one.name) for one in fields(chain)}.items()
        - {one.name: getattr(PUBLISHED, one.name) for one in fields(chain)}.items()
        for name, chain in CHAINS.items()
    }
    return table(
        ["chain", "differs in"],
        [[f"`{name}`", ", ".join(f"`{key} = {value}`" for key, value in sorted(own))] for name, own in changed.items()],
    )


def page() -> str:
    """The page with its tables as the code has them."""
    text = PAGE.read_text(encoding="utf-8")
    for made in (laws, families, chains):
        mark, end = f"<!-- {made.__name__} -->\n\n", f"\n\n<!-- {made.__name__} end -->"
        before, rest = text.split(mark)
        text = before + mark + made() + end + rest.split(end)[1]
    return text


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
