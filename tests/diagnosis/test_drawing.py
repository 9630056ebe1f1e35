"""The drawing of the machine: every component is in it, as red as it is likely."""

import re
from xml.etree import ElementTree

import pytest

from aoro_gym.diagnosis.drawing import HEIGHT, LABELS, SHAPES, WIDTH, machine_drawing
from aoro_gym.diagnosis.words import probability
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.reporting.style import RED

COMPONENTS = {effect.component for effect in EFFECTS.values()}


def test_every_component_of_the_catalogue_is_drawn():
    assert set(SHAPES) == set(LABELS) == COMPONENTS


@pytest.mark.parametrize("name", sorted(COMPONENTS))
def test_a_component_is_as_red_as_it_is_likely(name):
    drawn = machine_drawing({name: 0.5})
    red = re.findall(f'class="([a-z_]+)" (?:fill|stroke)="{RED}" (?:fill|stroke)-opacity="([0-9.]+)"', drawn)
    assert dict(red) == {one: "0.500" if one == name else "0.000" for one in SHAPES}
    assert drawn.count("<text") == 2 and probability(0.5) in drawn


def test_it_is_valid_and_stays_within_its_frame():
    root = ElementTree.fromstring(machine_drawing(dict.fromkeys(COMPONENTS, 1.0)))
    assert root.attrib["viewBox"] == f"0 0 {WIDTH} {HEIGHT}"
    texts = root.findall("text")
    assert len(texts) == len(COMPONENTS) + 1
    assert all(0.0 < float(one.attrib["x"]) < WIDTH and 10.0 < float(one.attrib["y"]) < HEIGHT for one in texts)
    assert root.attrib["aria-label"].startswith("Machine from above: ")


def test_what_is_hardly_likely_has_no_label():
    assert machine_drawing({"pump": 0.01}).count("<text") == 1
