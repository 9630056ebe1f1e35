"""Twins whose tires ask the triangles disc by disc: planes, steps, work, and what they do not know yet."""

import numpy as np
import pytest

from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import WHEELS
from aoro_gym.twin.twin import Twin
from aoro_gym.units import GRAVITY
from aoro_gym.view.forces import TireForces
from studies.ground_contact import OBSTACLES, Obstacle
from studies.ground_contact import drive as drive_over
from tests.twin.landscapes import MIDDLE, inclined, landscape, rough
from tests.twin.rig import all_wheels, drive

pytestmark = pytest.mark.slow


def test_a_triangulated_plane_is_a_plane(machine):
    """A drive up 4 degrees with a turn: what is felt differs by 1e-5 of the tires' depth and 20 µm of positions in float32,
    30 N of 25 kN a wheel; which a turn on friction makes 5 mm of its way."""
    plane = Twin(1, machine=machine, terrain=Plane(slope_deg=4.0))
    cut = Twin(1, machine=machine, terrain=inclined(np.radians(4.0)), ground="discs")
    cut.reset(position=(10.0, MIDDLE))
    phases = ((3.0, {"drive_signal": 0.6}), (3.0, {"steering_signal": 0.5}))
    logs = [drive(twin, *phases, sample_every=0.01) for twin in (plane, cut)]
    for name, atol in {"joint_angle": 2e-3, "speed": 2e-3, **all_wheels("wheel_load", 200.0)}.items():
        np.testing.assert_allclose(logs[1][name], logs[0][name], atol=atol, err_msg=name)
    np.testing.assert_allclose(logs[1]["position_x"] - 10.0, logs[0]["position_x"], atol=5e-3)


def test_a_step_is_climbed_and_a_wall_stops(machine):
    """As on an averaged plane (``test_terrain_driving``), of vertical faces a cell wide."""
    walls = [landscape(lambda x, y, h=h: h * (x > 0.0) + 0.0 * y) for h in (0.1, 3.0)]
    twin = Twin(2, machine=machine, terrain=walls, ground="discs")
    twin.reset(position=(8.0, MIDDLE), terrain=(0, 1))
    log = drive(twin, (9.0, {"drive_signal": 1.0, "gear": 3}), sample_every=0.005)
    assert not twin.diverged
    assert log["position_x"][-1, 0] > MIDDLE + 3.0
    assert log["position_z"][-1, 0] == pytest.approx(0.1, abs=0.02)
    assert log["position_x"][:, 1].max() < MIDDLE


@pytest.mark.parametrize("name", OBSTACLES)
def test_loads_are_smoother_than_on_an_averaged_plane(name):
    """A kerb, a rut and a ditch: the load of a wheel that has been on the ground for 10 ms changes by less than 10 % of its
    mean in 5 ms, where averages over four rays jump by more; and the machine comes as far as on level ground, but for the
    way up and down, a hundredth."""
    discs = drive_over(OBSTACLES[name], "discs", 10.0)
    mesh = drive_over(OBSTACLES[name], "mesh", 10.0)
    assert largest_change(discs) < 2.5e3 < largest_change(mesh)
    level = drive_over(Obstacle("level ground", [(0.0, 0.0), (0.1, 0.0)]), "discs", 10.0)
    way = [np.hypot(np.ptp(one["position_x"]), np.ptp(one["position_y"])) for one in (discs, level)]
    assert way[0] == pytest.approx(way[1], rel=0.01)


def largest_change(trace):
    """Of a wheel's load [N] from a sample to the next, where it bore some in the two before."""
    loads = np.stack([trace[f"wheel_load_{wheel}"][:, 0] for wheel in WHEELS])
    borne = (loads[:, :-2] > 0.0) & (loads[:, 1:-1] > 0.0)
    return np.abs(np.diff(loads[:, 1:], axis=1))[borne].max()


def test_wild_driving_stays_finite(machine):
    """Sixteen twins drive and steer at random over rough ground for 20 s, off its edges, too."""
    rng = np.random.default_rng(3)
    twin = Twin(16, machine=machine, terrain=rough(5, bumps=0.1, hills=0.15), ground="discs")
    twin.reset(position=rng.uniform(6.0, 34.0, (16, 2)), heading=rng.uniform(-np.pi, np.pi, 16))
    for _ in range(20):
        twin.step(
            {"drive_signal": rng.uniform(-1.0, 1.0, 16), "steering_signal": rng.uniform(-1.0, 1.0, 16), "gear": 3}, 1.0
        )
    assert not twin.diverged
    assert np.all(np.isfinite(twin.state.numpy()))


def test_the_kernel_of_all_laws_and_that_of_pictures_know_discs(machine):
    """Machines of two families, parked on kerbs: the ground bears what they weigh, as pictures draw it, too."""
    families = machine.with_laws(swivel=["five_discs", "bore_torque"], slip=["relaxation", "lugre"])
    twin = Twin(2, machine=families, terrain=OBSTACLES["kerb"].terrain, ground="discs")
    twin.reset(position=(0.8, 0.0))
    log = drive(twin, (6.0, {"parking_brake": 1.0}), sample_every=0.1)
    weight = machine.mass * GRAVITY
    np.testing.assert_allclose(log.wheels("wheel_load")[-1].sum(axis=0), weight, rtol=0.02)
    _, forces = TireForces(twin).evaluate()
    np.testing.assert_allclose(forces[..., 2].sum(axis=1), weight, rtol=0.02)


@pytest.mark.parametrize(
    "options", [{"soil": "peat"}, {"terrain": world(5, size=(60.0, 60.0), stumps=2000.0)}], ids=["soil", "objects"]
)
def test_what_discs_do_not_know_is_refused(options):
    with pytest.raises(ValueError, match=r"ground is 'discs', but there is .* take 'mesh'"):
        Twin(**({"terrain": rough(1, bumps=0.05, hills=0.1)} | options), ground="discs")
