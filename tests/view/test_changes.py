"""Sliders that change a machine while it runs."""

import numpy as np
import pytest

from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from aoro_gym.twin import Twin
from aoro_gym.twin.records import pack
from aoro_gym.view.changes import NOTHING, ON_MACHINE, changed
from aoro_gym.view.live import LiveTwins
from aoro_gym.view.live_view import LiveView
from aoro_gym.view.server import start

AORO = Machine.load("aoro")


def test_a_parameter_and_an_effect():
    key = "steering.cylinder.bore"
    bore = float(AORO.entries[key].value)
    both = changed(AORO, key, 1.01 * bore, "payload", [500.0])
    assert both.entries[key].value == pytest.approx(1.01 * bore)
    assert float(both.mass) == pytest.approx(float(AORO.mass) + 500.0)
    assert changed(AORO, NOTHING, 0.0, NOTHING, []) is AORO
    with pytest.raises(ValueError, match=key):
        changed(AORO, key, -1.0, NOTHING, [])


@pytest.fixture
def view():
    pytest.importorskip("viser", reason="[view] is not installed")
    server = start(0)
    twin = Twin(2, own_machines=True, threads=1)
    yield LiveView(server, LiveTwins(twin, [AORO, AORO]), ["before", "after"])
    server.stop()


def test_the_twin_that_was_chosen_is_changed(view):
    panel, twin = view.changes, view.twins.twin
    before = twin.machines.numpy().copy()
    view.frame()
    np.testing.assert_array_equal(twin.machines.numpy(), before)
    panel._effect.value = "spool_lag"
    panel._offer_magnitudes()
    slider = panel._magnitudes[0]
    (one,) = EFFECTS["spool_lag"].magnitudes
    assert (slider.min, slider.max, slider.value) == (one.low, one.high, one.none)
    assert slider.visible and not panel._magnitudes[1].visible
    slider.value = 0.5 * one.high
    panel._ask()
    view.frame()
    expected = pack(EFFECTS["spool_lag"].apply(AORO, 0.5 * one.high))[0]
    assert twin.machines.numpy()[1] == expected and twin.machines.numpy()[0] == before[0]
    panel._effect.value = NOTHING
    panel._offer_magnitudes()
    view.frame()
    np.testing.assert_array_equal(twin.machines.numpy(), before)


def test_what_cannot_be_is_said(view):
    panel = view.changes
    panel._key.value = "oil.bulk_modulus"
    panel._offer_value()
    low, high = AORO.entries["oil.bulk_modulus"].range
    assert (panel._value.min, panel._value.max) == (low, high)
    panel._value.value = -1.0
    panel._ask()
    view.frame()
    assert "oil.bulk_modulus" in panel._note.content


def test_every_effect_and_parameter_can_be_offered(view):
    panel = view.changes
    for name in ON_MACHINE:
        panel._effect.value = name
        panel._offer_magnitudes()
        assert [slider.visible for slider in panel._magnitudes] == [True, len(ON_MACHINE[name].magnitudes) == 2]
    for key in panel._key.options[1:]:
        panel._key.value = key
        panel._offer_value()
        assert panel._value.min <= panel._value.value <= panel._value.max
