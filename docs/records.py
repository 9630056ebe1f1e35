"""Writes the tables of records of the how-to "Software in the loop" as the code has them: ``python docs/records.py``."""

from pathlib import Path

from aoro_gym.cosimulation.protocol import REASONS, field_table
from aoro_gym.cosimulation.server.records import COMMAND, GRANT, HELLO, STATE, TELEMETRY

PAGE = Path(__file__).parent / "howto" / "software_in_the_loop.md"
BEGIN, END = "<!-- written by docs/records.py -->", "<!-- until here -->"


def section() -> str:
    """Tables of all records and of the reasons for which datagrams are dropped."""
    parts = [BEGIN]
    for record in (HELLO, STATE, COMMAND, TELEMETRY, GRANT):
        parts += [f"### Kind {record.kind}: `{record.name}`", record.text]
        parts += [field_table(record)] if record.fields else ["No fields."]
    reasons = "\n".join(f"| {reason} | {text} |" for reason, text in REASONS.items())
    parts += ["### Why a datagram is dropped", f"| reason | what it means |\n|---|---|\n{reasons}", END]
    return "\n\n".join(parts)


def page() -> str:
    """The how-to with the tables of now."""
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    return before + section() + rest.partition(END)[2]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
