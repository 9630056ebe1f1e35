"""The pile of logs against a sum over its logs, and against cylinders in closed form."""

import numpy as np
import pytest

from aoro_gym.machine.parameters import InvalidMachine, Machine
from aoro_gym.machine.pile import pile_of

LENGTH, DIAMETER, DENSITY, WIDTH = 3.0, 0.2, 850.0, 1.8


def by_the_log(count: int) -> tuple[float, float, np.ndarray]:
    """Mass, height of the CoG and principal inertia (3,) of ``count`` logs that fill whole rows, each placed by hand where
    it touches the two below it."""
    wide = 9
    places, row = [], 0
    while len(places) < count:
        here = wide - row % 2
        y = DIAMETER * (np.arange(here) - 0.5 * (here - 1))
        # the distance of two axes that touch is a diameter: from gap to log half of it aside, the rest up
        z = 0.5 * DIAMETER + row * np.sqrt(DIAMETER**2 - (0.5 * DIAMETER) ** 2)
        places += [(one, z) for one in y]
        row += 1
    assert len(places) == count, "whole rows"
    y, z = np.array(places).T
    mass = DENSITY * np.pi * (0.5 * DIAMETER) ** 2 * LENGTH
    high = z - z.mean()
    axial, across = 0.5 * mass * (0.5 * DIAMETER) ** 2, mass * (3.0 * (0.5 * DIAMETER) ** 2 + LENGTH**2) / 12.0
    xx = np.sum(axial + mass * (y**2 + high**2))
    return count * mass, z.mean(), np.array([xx, np.sum(across + mass * high**2), np.sum(across + mass * y**2)])


@pytest.mark.parametrize("count", [9, 17, 26, 34])
def test_whole_rows_are_the_sum_over_their_logs(count):
    mass, height, inertia = by_the_log(count)
    pile = pile_of(count, LENGTH, DIAMETER, DENSITY, WIDTH)
    assert (pile.mass, pile.cog_height) == pytest.approx((mass, height), rel=1e-12)
    assert (pile.inertia_xx, pile.inertia_yy, pile.inertia_zz) == pytest.approx(tuple(inertia), rel=1e-12)


def test_many_thin_logs_are_a_block():
    """Logs of 1 cm in a bunk of 1.8 m, 120 rows: a homogeneous block, whose inertia follows from its edges."""
    row = 0.01 * np.sqrt(0.75)
    pile = pile_of(60 * (180 + 179), LENGTH, 0.01, DENSITY, WIDTH)
    assert np.isnan(pile.mass)  # more logs than a bunk may hold
    pile = pile_of(5 * (180 + 179) / 2, LENGTH, 0.01, DENSITY, WIDTH)
    high = 5 * row
    assert pile.inertia_xx == pytest.approx(pile.mass * (WIDTH**2 + high**2) / 12.0, rel=0.01)
    assert pile.inertia_zz == pytest.approx(pile.mass * (WIDTH**2 + LENGTH**2) / 12.0, rel=0.01)


def test_a_pile_grows_smoothly_with_its_count():
    count = np.linspace(0.0, 40.0, 401)
    pile = pile_of(count, LENGTH, DIAMETER, DENSITY, WIDTH)
    for name in ("mass", "cog_height", "inertia_xx", "inertia_yy", "inertia_zz"):
        steps = np.diff(getattr(pile, name)[10:])  # the first logs have no height to speak of
        assert np.all(steps >= -1e-9) and steps.max() < 5.0 * steps.mean() + 1e-12, name


def test_the_load_bears_on_the_axles_as_statics_say(machine):
    """Moments of all weights about the rear wheels' contact, at the angles that the arms come to rest at."""
    count, distance = np.array([0.0, 5.0, 20.0, 40.0, 40.0]), np.array([1.9, 2.6, 1.9, 1.4, 2.2])
    laden = machine.set({"payload.count": count, "payload.distance": distance})
    frame, corner, arm, rest = laden.frame, laden.corner, laden.arm, laden.rest
    assert laden.payload.mass == pytest.approx(count * DENSITY * np.pi / 4.0 * DIAMETER**2 * LENGTH, rel=1e-12)
    cosines = np.cos(rest.arm_angle_front), np.cos(rest.arm_angle_rear)
    pivots = frame.front.axle_distance - arm.length, arm.length - frame.rear.axle_distance
    front, rear = pivots[0] + arm.length * cosines[0], pivots[1] - arm.length * cosines[1]
    masses = (
        (frame.front.mass, frame.front.axle_distance - frame.front.cog_offset),
        (frame.rear.mass, frame.rear.cog_offset - frame.rear.axle_distance),
        (2.0 * corner.mass, pivots[0] + corner.rho * cosines[0]),
        (2.0 * corner.mass, pivots[1] - corner.rho * cosines[1]),
        (laden.payload.mass, -distance),
    )
    moment = 9.81 * sum(mass * (x - rear) for mass, x in masses)
    assert 2.0 * rest.wheel_load_front * (front - rear) == pytest.approx(moment, rel=1e-12)
    assert 2.0 * (rest.wheel_load_front + rest.wheel_load_rear) == pytest.approx(9.81 * laden.mass, rel=1e-12)


def test_an_empty_bunk_leaves_the_machine_what_it_is(machine):
    other = machine.set({"payload.diameter": 0.3, "payload.friction": 0.2})
    assert other.identity == machine.identity
    assert not other.loaded and other.mass == machine.mass
    assert machine.set({"payload.count": 1.0}).identity != machine.identity


def test_a_file_without_a_payload_has_an_empty_bunk(tmp_path, machine):
    machine.save(tmp_path / "all.toml")
    text = (tmp_path / "all.toml").read_text()
    (tmp_path / "old.toml").write_text(text[: text.index("[payload.count]")])
    old = Machine.load(tmp_path / "old.toml")
    assert not old.loaded and old.identity == machine.identity
    (tmp_path / "laden.toml").write_text('base = "aoro"\n[payload.count]\nvalue = 20\n')
    assert Machine.load(tmp_path / "laden.toml").payload.mass == pytest.approx(1602.2, abs=0.1)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"payload.count": -1.0}, r"payload.count = -1: must be finite and at least 0"),
        ({"payload.count": 1001.0}, r"payload.count = 1001: a bunk holds at most 1000 logs; lower payload.count"),
        (
            {"payload.diameter": 1.0},
            r"payload.diameter = 1 m: two logs lie side by side in the bunk; lower payload.diam",
        ),
        ({"payload.count": 300.0}, r"within the arms' swing; .* or lighten the load \(payload.count\)"),
    ],
)
def test_what_no_bunk_holds_is_refused(machine, values, words):
    with pytest.raises(InvalidMachine, match=words):
        machine.set(values, check_ranges=False)
