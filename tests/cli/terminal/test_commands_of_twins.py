"""Commands of twins, terrains and machines in a terminal, through a pipe, and with --quiet."""

import pytest

from tests.cli.terminal.running import check_everywhere

COMMANDS: list[tuple[str, tuple[object, ...]]] = [
    ("parameters", ("parameters", "steering")),
    ("effects", ("parameters", "--effects")),
    ("drive", ("simulate", "-m", "drive", "--duration", 1, "--out", "[/x] $a$.csv")),
    ("demo", ("demo",)),
    ("validate", ("validate", "--ensemble", "none")),
    ("study", ("study", "--scale", "steering.hose_bulk_modulus=0.9")),
    ("calibrate", ("calibrate", "--logs", "log.csv", "--laws", "file", "--starts", 1, "--population", 2, "--force")),
    ("terrain", ("terrain", "ground.npy", "--cell", 1)),
    ("export twin", ("export", "twin", "--format", "fmi2", "--out", "twin.fmu")),
    ("serve", ("serve", "--udp-port", 0, "--tcp-port", 0, "--duration", 2)),
    ("laboratory", ("laboratory", "-m", "park")),
    ("bench", ("bench", "--twins", "1,2", "--seconds", 0.02)),
    ("doctor", ("doctor",)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "arguments"), [pytest.param(*one, id=one[0]) for one in COMMANDS])
def test_in_a_terminal_in_a_pipe_and_quiet(name, arguments, inputs):
    check_everywhere(*arguments, folder=inputs, quietly=() if name in ("parameters", "effects") else ("--quiet",))
