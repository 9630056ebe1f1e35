"""Newton steps the vehicle that MuJoCo steps; without it a benchmark says how to get it and times the rest."""

from collections import defaultdict

import numpy as np
import pytest
import warp as wp

from aoro_gym.benchmark import newton as of_newton
from aoro_gym.benchmark import peers
from aoro_gym.benchmark.scene import CELL, heights
from aoro_gym.benchmark.vehicle import load

WORLDS = 2


def test_heights_and_quaternions_are_told_in_newtons_order():
    positions = np.arange(9.0)[None]
    assert of_newton.joints(positions).tolist() == [[0, 1, 2, 4, 5, 6, 3, 7, 8]]
    text = of_newton._ground(
        "<mujoco><asset><hfield/></asset><worldbody><geom/><body/></worldbody><actuator/><keyframe/></mujoco>",
        np.array([[0.0, 1.0], [2.0, 3.0]]),
    )
    assert 'elevation="2 3 0 1"' in text and "<body" not in text and "<actuator" not in text and "<geom" in text


def test_another_vehicle_is_refused(machine):
    level = heights("plane")
    host = load(machine, level, CELL)
    of_newton._hold_same(host, load(machine, level, CELL))
    heavier = load(machine.scale({"wheel.mass": 1.001}), level, CELL)
    with pytest.raises(RuntimeError, match="another vehicle than MuJoCo: masses differ"):
        of_newton._hold_same(host, heavier)


@pytest.fixture(scope="module")
def standing(machine):
    """Vehicles on level ground once they have come to rest, with the solver and the subject."""
    newton = pytest.importorskip("newton")
    pytest.importorskip("mujoco_warp")
    solvers, step = [], newton.solvers.SolverMuJoCo.step

    def spy(solver, *arguments, **options):
        solvers[:] = [solver]
        return step(solver, *arguments, **options)

    device = "cuda:0" if wp.is_cuda_available() else "cpu"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(newton.solvers.SolverMuJoCo, "step", spy)
        subject = of_newton.newton(WORLDS, machine=machine, ground="plane", device=device)
    return subject, solvers[0]


def wheel_loads(solver):
    """Loads [N] of all worlds by wheel: the normal force of a contact is the sum of its pyramid's edges."""
    data, contact = solver.mjw_data, solver.mjw_data.contact
    count, force = int(data.nacon.numpy()[0]), data.efc.force.numpy()
    loads = defaultdict(lambda: np.zeros(WORLDS))
    rows = zip(contact.worldid.numpy(), contact.geom.numpy(), contact.efc_address.numpy(), strict=True)
    for world, geoms, edges in list(rows)[:count]:
        name = next(name for geom in geoms if "wheel_" in (name := solver.mj_model.geom(geom).name))
        loads[name[name.index("wheel_") + 6 :][:2]][world] += force[world, edges[edges >= 0]].sum()
    return loads


@pytest.mark.slow
def test_newton_stands_on_its_wheels_as_the_machine_does(standing, machine):
    """Both halves are one body in pitch, so moments give the loads of the axles. Wheels sink by 4 mm at most, see
    test_vehicle.py: with a wheel base of 3 m and a centre of gravity 1 m up that moves 0.1 % of the load; arms of 1 m and
    more that give way by as much, at 0.2 rad, shift the wheels by as little. Left and right share alike."""
    subject, solver = standing
    assert subject.check() == {"finite": WORLDS, "dropped": []}
    loads = wheel_loads(solver)
    assert sum(loads.values()) == pytest.approx(machine.mass * 9.81, rel=1e-3)
    for name, expected in (("f", machine.rest.wheel_load_front), ("r", machine.rest.wheel_load_rear)):
        for side in "lr":
            assert loads[name + side] == pytest.approx(float(expected), rel=5e-3)


@pytest.mark.slow
def test_newton_drives_as_mujoco_does(standing, machine, rolled):
    """Single precision, and another choice among the contacts of a wheel: centimetres would be another vehicle."""
    subject, solver = standing
    subject.restart()
    subject.advance(10)
    assert subject.check() == {"finite": WORLDS, "dropped": []}
    other = peers.mujoco(WORLDS, machine=machine, ground="plane")
    other.restart()
    other.advance(10)
    # time, then positions
    assert solver.mjw_data.qpos.numpy()[:, :3] == pytest.approx(rolled[-1][-1][:, -1, 1:4], abs=0.02)
