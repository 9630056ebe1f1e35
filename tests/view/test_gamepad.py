"""A gamepad by its events, written to a pipe as the kernel writes them."""

import os
import struct

import pytest

from aoro_gym.view.gamepad import AXIS, BUTTON, INITIAL, LEFT_TRIGGER, RIGHT_TRIGGER, STICK, Gamepad


@pytest.fixture
def pad(tmp_path):
    """A gamepad, what writes its events, and the buttons that were pressed."""
    file, pressed = tmp_path / "js0", []
    os.mkfifo(file)
    found = Gamepad(file, pressed.append)
    device = os.open(file, os.O_WRONLY)

    def tell(kind, number, value):
        os.write(device, struct.pack("<IhBB", 1234, value, kind, number))

    def unplug():
        nonlocal device
        os.close(device)
        device = -1

    yield found, tell, pressed, unplug
    found.close()
    if device >= 0:
        os.close(device)


def test_what_it_tells_when_it_is_opened_moves_nothing(pad):
    gamepad, tell, pressed, _ = pad
    for axis, value in ((STICK, 300), (LEFT_TRIGGER, -32767), (RIGHT_TRIGGER, -32767)):
        tell(AXIS | INITIAL, axis, value)
    tell(BUTTON | INITIAL, 0, 1)
    assert gamepad.changes() == {} and pressed == []
    assert gamepad.changes() == {}  # nothing new, and no wait


def test_sticks_and_triggers_are_signals_beyond_their_rest(pad):
    gamepad, tell, _, _ = pad
    tell(AXIS, STICK, 32767)  # to the right
    assert gamepad.changes() == {"steering_signal": -1.0}
    tell(AXIS, STICK, -round(32767 * (0.08 + 0.92 * 0.5)))  # half of what lies beyond the dead band
    tell(AXIS, RIGHT_TRIGGER, 32767)
    assert gamepad.changes() == {"steering_signal": 0.5, "drive_signal": 1.0}
    tell(AXIS, RIGHT_TRIGGER, -32767)
    tell(AXIS, LEFT_TRIGGER, 32767)
    assert gamepad.changes() == {"drive_signal": -1.0}
    tell(AXIS, 7, 32767)  # the cross
    assert gamepad.changes() == {}
    tell(AXIS, STICK, 0)
    assert gamepad.changes() == {"steering_signal": 0.0}


def test_buttons_count_when_they_go_down(pad):
    gamepad, tell, pressed, _ = pad
    for number, value in ((0, 1), (0, 0), (5, 1)):
        tell(BUTTON, number, value)
    assert gamepad.changes() == {} and pressed == [0, 5]


def test_an_unplugged_gamepad_lets_the_machine_go(pad):
    gamepad, tell, _, unplug = pad
    tell(AXIS, RIGHT_TRIGGER, 32767)
    assert gamepad.changes() == {"drive_signal": 1.0}
    unplug()
    assert gamepad.changes() == {"drive_signal": 0.0} and not gamepad.connected
    assert gamepad.changes() == {}


def test_it_drives_a_view(pad):
    pytest.importorskip("viser", reason="[view] is not installed")
    from aoro_gym.twin import Twin
    from aoro_gym.view.live import LiveTwins
    from aoro_gym.view.live_view import LiveView
    from aoro_gym.view.server import start, stop

    gamepad, tell, _, _ = pad
    server, twin = start(0), Twin(threads=1)
    try:
        view = LiveView(server, LiveTwins(twin, [twin.machine]), ["aoro"], gamepad=gamepad.file)
        gamepad.close()  # two readers would share the events
        tell(AXIS, STICK, -32767)
        tell(AXIS, RIGHT_TRIGGER, 32767)
        tell(BUTTON, 5, 1)
        tell(BUTTON, 1, 1)
        view.frame()
        assert view.twins.commands["steering_signal"] == 1.0 and view.twins.commands["drive_signal"] == 1.0
        assert view.twins.commands["gear"] == 2.0 and view.twins.commands["parking_brake"] == 1.0
        tell(BUTTON, 0, 1)
        tell(BUTTON, 7, 1)
        view.frame()
        assert view.clock.paused
        view.frame()
        assert view.twins.commands["drive_signal"] == 0.0
    finally:
        stop(server)
