"""The command ``parameters``."""

import json

import pytest

from tests.cli.calling import call, check_refused


def test_parameters_table():
    shown = call("parameters", "steering.valve.nominal_flow*", "--machine", "aoro_datasheet")
    assert shown.exit_code == 0
    assert "steering.valve.nominal_flow_left" in shown.stdout
    assert " 62 " in shown.stdout
    assert "L/min" in shown.stdout


def test_effects_are_listed_with_what_they_measure():
    shown = call("parameters", "--effects", "joint")
    assert "joint_backlash" in shown.stdout
    assert "pump_response" not in shown.stdout
    options = ("--json", "--scale", "driveline.brake.disc_torque=2")
    doubled, plain = (
        json.loads(call("parameters", "driveline", "--effects", *more).stdout)[0] for more in (options, options[:1])
    )
    assert doubled["id"] == plain["id"] == "driveline_resistance"
    assert doubled["operational"][0]["none"] == pytest.approx(2.0 * plain["operational"][0]["none"])
    assert doubled["operational"][0]["high"] - doubled["operational"][0]["none"] == pytest.approx(1000.0)


def test_parameters_json_follows_set_and_scale():
    shown = call("parameters", "oil.*", "--json", "--set", "oil.gas_fraction=0.01", "--scale", "oil.bulk_modulus=0.5")
    rows = {row["key"]: row for row in json.loads(shown.stdout)}
    assert rows["oil.gas_fraction"]["value"] == 0.01
    plain = {row["key"]: row for row in json.loads(call("parameters", "oil.*", "--json").stdout)}
    assert rows["oil.bulk_modulus"]["value"] == pytest.approx(0.5 * plain["oil.bulk_modulus"]["value"])
    assert set(plain["oil.bulk_modulus"]) >= {"key", "value", "unit", "range", "role", "source"}


def test_published_values_stand_beside_fitted_ones():
    key = "steering.valve.nominal_flow_left"
    (row,) = json.loads(call("parameters", key, "--json", "--set", f"{key}=69.894").stdout)
    assert (row["value"], row["published"]) == (69.894, 70.6)
    assert row["deviation"] == pytest.approx(-0.01)
    assert "70.6 (-1.0 %)" in call("parameters", key, "--set", f"{key}=69.894").stdout
    assert "published" not in json.loads(call("parameters", "oil.gas_fraction", "--json").stdout)[0]
    assert "published" not in call("parameters", "oil.gas_fraction").stdout


def test_implausible_values_are_named_once_on_the_terminal():
    result = call("parameters", "spool_time_constant", "--set", "steering.valve.spool_time_constant=5", "--json")
    assert result.exit_code == 0
    assert " ".join(result.stderr.split()) == (
        "warning: steering.valve.spool_time_constant = 5 s: outside of its plausible range 0.008 to 0.06 s; "
        "physically possible, so it is taken"
    )
    assert json.loads(result.stdout)[0]["value"] == 5.0
    assert "warning" not in call("parameters", "spool_time", "--set", "steering.valve.spool_time_constant=0.02").output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("parameters nothing.like.it", "no parameter matches 'nothing.like.it'"),
        ("parameters --effects nothing", "no effect matches 'nothing'; choose from: sensor_delay"),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)
