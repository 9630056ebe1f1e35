"""Cranes with what else a twin may have: soil, solid objects, triangles, other laws, own machines, a load, devices."""

import numpy as np
import pytest
import warp as wp

from aoro_gym import Machine, Twin
from aoro_gym.machine.vehicle_crane import VehicleCrane
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.terrains.world.objects import Tree, upright
from aoro_gym.terrains.world.world import World
from aoro_gym.twin.hub_driven import HubDrivenTwin
from aoro_gym.twin.kernels import crane_on_frame
from aoro_gym.twin.records import CRANE_OUTPUT_UNITS, SOIL_OUTPUT_UNITS, WHEELS
from aoro_gym.twin.sharded import ShardedTwins

MOVE = {"crane_slew": 0.5, "crane_lift": 0.4, "crane_fold": -0.4, "drive_signal": 0.4, "steering_signal": 0.3}
FLAT = Terrain.from_heights(np.zeros((61, 61)), cell=1.0, corner=(-30.0, -30.0))
LADEN = {"payload.count": 10.0}


SIZES = {"rad": 1.0, "m": 1.0, "rad/s": 1.0, "m/s": 1.0, "Pa": 2e7, "m^3/s": 1e-3, "N": 3e3}
"""Of outputs, by their units."""


def crane_rows(twin: Twin) -> np.ndarray:
    """The twin's last outputs of its crane, as shares of :data:`SIZES`."""
    return np.stack([twin.output(name) / SIZES[unit] for name, unit in CRANE_OUTPUT_UNITS.items()])


def test_twins_of_one_launch_move_as_each_alone():
    """Machines and loads of their own, one after the other on two threads: to the bit."""
    machine = Machine.load("aoro").sample(3, seed=5).set({"payload.count": np.array([0.0, 12.0, 4.0])})
    together = Twin(3, machine=machine, crane=True)
    together.step(MOVE, 0.3)
    for k in range(3):
        alone = Twin(machine=machine.variants(np.array([k])), crane=True)
        alone.step(MOVE, 0.3)
        assert alone.state.numpy()[:, 0].tobytes() == together.state.numpy()[:, k].tobytes()


def test_shards_move_as_one_launch_does():
    """To the bit, as :class:`ShardedTwins` says of all twins."""
    whole, parted = Twin(3, crane=True), ShardedTwins(3, device="cpu,cpu", crane=True)
    for twins in (whole, parted):
        twins.step({**MOVE, "crane_slew": [0.1, 0.5, 0.9]}, 0.2)
    states = np.concatenate([shard.state.numpy() for shard in parted.shards], axis=1)
    assert states.tobytes() == whole.state.numpy().tobytes()


def test_machines_are_exchanged_under_their_cranes():
    """As :meth:`Twin.set_machines` says; one too light to have carried the crane is refused by name."""
    twin = Twin(2, crane=True, own_machines=True)
    heavy = Machine.load("aoro").set({"frame.front.mass": 4300.0}, check_ranges=False)
    twin.set_machines([1], heavy)
    twin.reset()
    twin.step({}, 1.0)
    load = np.sum([twin.output(f"wheel_load_{wheel}") for wheel in WHEELS], axis=0)
    added = 9.81 * (4300.0 - float(Machine.load("aoro").frame.front.mass))
    assert load[1] - load[0] == pytest.approx(added, rel=0.01)
    light = heavy.set({"frame.front.mass": 1000.0}, check_ranges=False)
    with pytest.raises(ValueError, match=r"frame.front.mass is 1000 kg, but must be above the crane's 1\d{3} kg"):
        twin.set_machines([0], light)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Twin(crane=True, device="cpu:simd"), "crane is given, but device is 'cpu:simd'.*leave crane out"),
        (lambda: HubDrivenTwin(crane=True), "crane is given, but its wheels are turned from outside.*leave crane out"),
        (lambda: Twin(crane=True, soil="peat", terrain=World(FLAT, (_tree(5.0),))), "soil"),
    ],
)
def test_what_does_not_go_together_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def _tree(x: float) -> Tree:
    return Tree((x, 0.0, 0.0), upright(), "pine", 0.3, 15.0, 8.0, 1.5, 1)


def test_roles_are_refused_and_not_chosen():
    with pytest.raises(ValueError, match="roles is True, but these twins"):
        Twin(crane=True, roles=True)
    assert not Twin(crane=True).by_roles


def test_a_step_and_a_marked_reset_stay_on_the_device(monkeypatch):
    """As graphs of CUDA that are recorded need: nothing is read back or written from the host."""
    twin = Twin(2, crane=True)
    twin.crane.grasp(180.0, 4.0, 0.26)
    twin.step(MOVE, 0.1)
    marked = twin.start_memory[0]
    marked.assign([True, False])

    def refuse(*_, **__):
        raise AssertionError("the host was asked")

    with monkeypatch.context() as patched:
        for name in ("numpy", "assign", "list"):
            patched.setattr(wp.array, name, refuse)
        twin.advance(0.1)
        twin.reset_marked()
    assert twin.crane.held_mass.tolist() == [0.0, 180.0]
    np.testing.assert_allclose(twin.crane.joints[:, 0], VehicleCrane().start_joints, atol=1e-6)
    np.testing.assert_allclose(twin.time, [0.0, 0.2])


# kernels of their own


def resting(**arguments) -> tuple[Twin, Twin]:
    """A twin without a crane and one with it folded, both 0.5 s at rest."""
    twins = Twin(**arguments), Twin(crane=True, **arguments)
    for twin in twins:
        twin.step({"parking_brake": 1.0}, 0.5)
    return twins


def assert_loads_agree(plain: Twin, with_crane: Twin) -> None:
    """To float32's rounding of 10 t, as in tests/twin/test_vehicle_crane.py."""
    for wheel in WHEELS:
        name = f"wheel_load_{wheel}"
        assert with_crane.output(name) == pytest.approx(plain.output(name), rel=1e-5), name


def test_a_load_in_the_bunk_rests_as_without_a_crane():
    assert_loads_agree(*resting(machine=Machine.load("aoro").set(LADEN)))


@pytest.mark.slow
def test_on_soil_it_sinks_as_without_a_crane_and_the_crane_moves_as_on_hard_ground():
    plain, soft = resting(soil="sandy_loam")
    assert_loads_agree(plain, soft)
    for name in SOIL_OUTPUT_UNITS:
        # what resists rolling at rest is rounding, mN
        assert soft.output(name) == pytest.approx(
            plain.output(name), rel=1e-4, abs=1e-3 if "resist" in name else 1e-6
        ), name
    hard = Twin(crane=True)
    hard.step({"parking_brake": 1.0}, 0.5)
    for twin in (hard, soft):
        twin.step({"crane_lift": 0.5, "crane_slew": 0.4, "drive_signal": 0.0, "steering_signal": 0.0}, 1.0)
    # the machine leans by some mrad less or more, against joints that move by 0.1 to 0.3 rad
    assert soft.crane.joints == pytest.approx(hard.crane.joints, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("ground", ["raster", "mesh"])
def test_on_terrains_the_crane_moves_as_on_a_plane(ground):
    """A flat raster or flat triangles instead of the plane: the same to rounding over half a second."""
    plane, flat = Twin(crane=True), Twin(crane=True, terrain=FLAT, ground=ground)
    for twin in (plane, flat):
        twin.step(MOVE, 0.5)
    assert flat.crane.joints == pytest.approx(plane.crane.joints, abs=2e-4)


@pytest.mark.slow
def test_among_objects_it_stops_at_a_stem_as_without_a_crane():
    """Away from objects as on the bare ground; against a stem the force agrees while the crane is folded, within the slew's
    swing on its oil, 5 % of the machine's mass.
    """
    far = World(FLAT, (_tree(25.0),))
    bare, among = (Twin(crane=True, terrain=ground) for ground in (FLAT, far))
    for twin in (bare, among):
        twin.step(MOVE, 0.5)
    assert among.crane.joints == pytest.approx(bare.crane.joints, abs=1e-5)
    near = World(FLAT, (_tree(4.5),))
    forces = []
    for twin in (Twin(terrain=near), Twin(terrain=near, crane=True)):
        trace = twin.step({"drive_signal": 0.5}, 5.0, sample_every=0.01)
        forces.append(np.abs(trace["object_force_x_front"]).max())
        assert (trace["touched_object_front"] == 1.0).any()
    assert forces[1] == pytest.approx(forces[0], rel=0.1)


@pytest.mark.slow
def test_default_laws_by_choice_move_as_by_default_and_other_laws_move_the_crane():
    default, chosen = Twin(crane=True), Twin(crane=True, choose_laws=True)
    for twin in (default, chosen):
        twin.step(MOVE, 0.3)
    assert np.abs(crane_rows(chosen) - crane_rows(default)).max() < 1e-4
    machine = Machine.load("aoro").sample(2, laws="any", seed=4)
    twin = Twin(2, machine=machine, crane=True)
    twin.step(MOVE, 0.5)
    assert twin.diverged == []
    assert np.ptp(twin.crane.joints[0]) < 0.1 and np.all(twin.crane.joints[0] > 0.01)


@pytest.mark.slow
def test_the_kernels_compile_for_cuda(tmp_path):
    """Compiled without a GPU, by NVRTC, for compute capability 9.0: that of a step, and those of starts."""
    modules = [Twin(crane=True)._advance_kernel.module, crane_on_frame.settle_cranes.module]
    for number, module in enumerate(modules):
        files = wp.compile_aot_module(module, arch=90, use_ptx=True, module_dir=tmp_path / str(number))
        (text,) = (file.read_bytes().decode(errors="ignore") for file in files if file.suffix == ".ptx")
        assert ".target sm_90" in text


def test_cranes_that_differ_need_machines_that_fit_each():
    """Of the twins whose machines are exchanged, not of others."""
    crane = VehicleCrane()
    crane.check_fits(Machine.load("aoro"), [0])
