"""The commands ``export ...``."""

import re
import tomllib
import zipfile

import pytest

from tests.cli.calling import call, check_refused


@pytest.mark.parametrize("arguments", [("none.json",), ("--out", "x.onnx", "none.json"), ("--quiet", "none.zip")])
def test_a_policy_without_its_word_is_exported_and_warned_of(arguments):
    shown = call("export", *arguments)
    warning, error = shown.stderr.strip().splitlines()
    assert "warning: 'aoro-gym export POLICY' is deprecated" in warning
    assert (shown.exit_code, arguments[-1] in error) == (2, True)


def test_the_word_policy_is_no_longer_missed():
    shown = call("export", "policy", "none.json")
    assert (shown.exit_code, "deprecated" in shown.stderr, "none.json" in shown.stderr) == (2, False, True)


def test_an_unknown_export_is_refused():
    shown = call("export", "polcy")
    assert (shown.exit_code, "No such command 'polcy'" in shown.stderr) == (2, True)


def test_a_twin_is_written(tmp_path):
    file = tmp_path / "worn.fmu"
    options = ("--set", "tire.radius=0.6", "--effects", "seal_friction=2000")
    shown = call("export", "twin", "--format", "fmi3", *options, "--out", file)
    assert (shown.exit_code, shown.stdout) == (0, f"wrote {file}\n"), shown.stderr
    with zipfile.ZipFile(file) as archive:
        description = archive.read("modelDescription.xml").decode()
        machine = tomllib.loads(archive.read("resources/machine.toml").decode())
    starts = dict(re.findall(r'name="([\w.]+)"[^>]* start="([^"]*)"', description))
    assert float(starts["tire.radius"]) == machine["tire"]["radius"]["value"] == 0.6
    preload = machine["steering"]["cylinder"]["seal_preload"]["value"]
    assert float(starts["steering.cylinder.seal_preload"]) == preload > 2000.0


@pytest.mark.slow
@pytest.mark.parametrize(("format", "name"), [("c", "folder"), ("fmi2", "x.fmu")])
def test_a_twin_is_written_in_every_format(format, name, tmp_path):
    shown = call("export", "twin", "--format", format, "--machine", "aoro_datasheet", "--out", tmp_path / name)
    written = {"c": ("folder/libaoro.so", "folder/aoro.h"), "fmi2": ("x.fmu",)}[format]
    assert shown.stdout == "".join(f"wrote {tmp_path / one}\n" for one in written)
    assert all((tmp_path / one).stat().st_size > 10_000 for one in written)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--format fmi1 --out x.fmu", "format is 'fmi1'; choose one of: fmi2, fmi3, c"),
        ("--format fmi2 --out x.zip", "x.zip must end in .fmu"),
        ("--format c --out good.csv", "good.csv is a file; of the format c name a folder"),
        ("--format fmi2 --out x.fmu --machine none.toml", "no machine file none.toml"),
        ("--format fmi2 --out x.fmu --terrain none.ply", "none.ply: No such file or directory"),
        ("--format fmi2 --out x.fmu --laws any", "--laws any draws laws, but a unit has its laws for good"),
        ("--format fmi2 --out x.fmu --effects rust=1", "'rust' is no effect here; choose from: sensor_delay, "),
        ("--format fmi2 --out x.fmu --effects sensor_gain=0.1", "sensor_gain is in the measuring chain, which is not"),
        ("--format fmi2 --out x.fmu --effects seal_friction", "seal_friction is not seal_friction="),
        ("--format fmi2 --out x.fmu --effects seal_friction=-1", "--effects seal_friction: "),
        ("--format fmi2 --out x.fmu --terrain good.csv --effects ground_slope=0.1,0", "leave one out"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_compiled(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "good.csv").write_text("x,y\n1,2\n")
    check_refused(f"export twin {arguments}", message)


def test_without_a_compiler_the_fix_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CC", "no-such-compiler -O2")
    check_refused(
        "export twin --format fmi2 --out x.fmu", "CC is 'no-such-compiler', but there is no such program; let CC"
    )
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    check_refused("export twin --format fmi2 --out x.fmu", "no C compiler was found (cc, gcc, clang): install one")
    monkeypatch.setenv("CC", "/bin/false")
    check_refused("export twin --format fmi2 --out x.fmu", "/bin/false failed: ")
