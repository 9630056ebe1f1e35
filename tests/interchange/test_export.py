"""Files of a machine, and the JSON beside them."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from rich.console import Console

from aoro_gym.interchange import FORMATS, description, export_machine, limitations, mjcf, urdf
from aoro_gym.interchange.export import SUFFIXES, beside_of
from aoro_gym.interchange.report import limitation_table
from aoro_gym.interchange.xml_text import Element, comment, numbers, text_of


@pytest.mark.parametrize("format_", FORMATS)
def test_files_are_whole_and_the_same_each_time(calibrated, tmp_path, format_):
    path = tmp_path / f"aoro{SUFFIXES[format_]}"
    written, unsaid = export_machine(calibrated, format_, path)
    assert written == [path, beside_of(path)] == sorted(tmp_path.iterdir())
    first = [file.read_bytes() for file in written]
    export_machine(calibrated, format_, path)
    assert [file.read_bytes() for file in written] == first
    assert path.read_text(encoding="utf-8") == {"mjcf": mjcf, "urdf": urdf}[format_](calibrated, unsaid)


@pytest.mark.parametrize("format_", FORMATS)
def test_what_is_not_said_stands_in_both(calibrated, tmp_path, format_):
    path = tmp_path / f"aoro{SUFFIXES[format_]}"
    _, unsaid = export_machine(calibrated, format_, path, {"machine": "mine"})
    text = path.read_text(encoding="utf-8")
    figures = json.loads(beside_of(path).read_text(encoding="utf-8"))
    assert len(unsaid) > 5 and unsaid == limitations(calibrated, format_)
    assert [one.sentence in text for one in unsaid] == [True] * len(unsaid)
    assert [one["part"] for one in figures["not_said"]] == [one.part for one in unsaid]
    assert (figures["format"], figures["made_by"]["machine"]) == (format_, "mine")
    ElementTree.fromstring(text)


def test_figures_are_the_machines(calibrated):
    figures = description(calibrated)
    rest = calibrated.rest
    assert figures["total_at_rest"]["mass"] == pytest.approx(calibrated.mass)
    # moments about the contacts: where the centre of mass lies follows from the wheels' loads
    axle = {name: half * (section.axle_distance - calibrated.arm.length + calibrated.arm.length * np.cos(angle))
            for name, half, section, angle in (("fl", 1.0, calibrated.frame.front, rest.arm_angle_front),
                                               ("rr", -1.0, calibrated.frame.rear, rest.arm_angle_rear))}  # fmt: skip
    load = figures["rest"]["wheel_load"]
    moment = 2.0 * (load["fl"] * axle["fl"] + load["rr"] * axle["rr"])
    assert figures["total_at_rest"]["centre_of_mass"][0] == pytest.approx(moment / (calibrated.mass * 9.81), abs=1e-9)
    over = figures["torque_over_range"]["articulated_joint"]
    held = figures["servos"]["articulated_joint"]["held_torque"]
    assert over["angle"][4] == 0.0 and (over["negative"][4], over["positive"][4]) == pytest.approx(held)


def test_only_some_machines_lack_more(calibrated):
    def parts(machine):
        return {one.part for one in limitations(machine, "mjcf")}

    assert parts(calibrated.set({"payload.count": 9.0})) - parts(calibrated) == {"load"}
    assert parts(calibrated.set({"joint.backlash": 0.004})) - parts(calibrated) == {"joint"}
    assert parts(calibrated.with_laws(hose="viscoelastic")) - parts(calibrated) == {"laws"}


def test_wrong_targets_are_refused(calibrated, tmp_path):
    with pytest.raises(ValueError, match=r"ends in '\.urdf'; name a file that ends in \.xml for mjcf"):
        export_machine(calibrated, "mjcf", tmp_path / "aoro.urdf")
    with pytest.raises(ValueError, match="format is 'usd'; choose one of: mjcf, urdf"):
        export_machine(calibrated, "usd", tmp_path / "aoro.usd")
    with pytest.raises(ValueError, match="root is 'base'; choose one of: world, frame"):
        export_machine(calibrated, "urdf", tmp_path / "aoro.urdf", root_link="base")
    with pytest.raises(ValueError, match="the machine has 2 variants"):
        export_machine(calibrated.scale({"wheel.mass": np.array([1.0, 1.1])}), "urdf", tmp_path / "aoro.urdf")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("width", [80, 160])
def test_tables_hold_every_limitation(calibrated, width):
    unsaid = limitations(calibrated, "urdf")
    console = Console(width=width)
    with console.capture() as shown:
        console.print(*limitation_table(unsaid, "urdf", width), highlight=False)
    assert [one.part in shown.get() for one in unsaid] == [True] * len(unsaid)


def test_numbers_read_back_and_comments_end_nothing():
    values = [0.1, 1.0 / 3.0, -0.0, 1e-17, 4136620.2566688163]
    assert [float(text) for text in numbers(values).split()] == values
    assert numbers(-0.0, 2.0, [3]) == "0 2 3"
    root = Element("a")
    comment(root, "one ---- two")
    assert "one - two" in text_of(root)
    ElementTree.fromstring(text_of(root))
