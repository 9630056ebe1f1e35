"""Errors of commands name what was typed."""

import pytest
from typer.testing import CliRunner

from aoro_gym.cli import app
from aoro_gym.cli.outcome import FLAGS, naming_option


def test_an_argument_is_named_by_its_option():
    before = FLAGS.set({"udp_port": "--udp-port"})
    try:
        assert naming_option("udp_port is 99999, but must be") == "--udp-port is 99999, but must be"
        assert naming_option("udp_port[1] is 5, but must be") == "--udp-port, value 2, is 5, but must be"
        for other in ("tcp_port is 3", "udp_ports is 3", "file.toml: udp_port is 3", "--udp-port is 3"):
            assert naming_option(other) == other
    finally:
        FLAGS.reset(before)
    assert naming_option("udp_port is 99999") == "udp_port is 99999"


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("serve --udp-port 99999", "error: --udp-port is 99999, but must be in [0, 65535]"),
        ("serve --duration -3", "error: --duration is -3 s, but must be above 0 s"),
        ("simulate --manoeuvre left --duration -1", "error: --duration is -1 s"),
    ],
)
def test_commands_name_their_options(command, message):
    done = CliRunner().invoke(app, command.split())
    assert done.exit_code == 2 and message in done.output
    assert not FLAGS.get()
