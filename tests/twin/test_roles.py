"""Four warps for 32 twins, as one thread a twin: the roles one after the other on the CPU, and the block itself on a GPU."""

import numpy as np
import pytest
import warp as wp

from aoro_gym.benchmark.scene import signals, starts, terrain
from aoro_gym.benchmark.twins import randomised
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from aoro_gym.twin import Twin
from aoro_gym.twin.forms import choose_roles, faster_by_roles, measured
from aoro_gym.twin.kernels.roles.board import ROWS
from aoro_gym.twin.records import NON_FINITE, State
from tests.twin.roles_in_turn import in_turn
from tests.twin.test_simd import TOLERANCE, largest_difference, states

COUNT = 8
ARMS = {"arm_fl": 0.4, "arm_fr": 0.6, "arm_rl": -0.7, "arm_rr": 0.5}
"""All arms at work, so that each tells the steering what it takes."""
needs_gpu = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")


def rare(count: int) -> Machine:
    """Machines of their own: a third has gas in its oil, a third its cylinders on a mount."""
    third = np.arange(count) % 3
    gas, mount = np.where(third == 1, 0.01, 0.0), np.where(third == 2, 5e-7, 0.0)
    machine = randomised(Machine.load(), count, 3)
    return machine.set({"oil.gas_fraction": gas, "joint.compliance": mount}, check_ranges=False)


def pair(count: int, machine: Machine, **options) -> tuple[Twin, Twin]:
    """Twins at the same places under the same commands."""
    twins = Twin(count, machine=machine, **options), Twin(count, machine=machine, **options)
    for twin in twins:
        begin(twin)
    return twins


def begin(twin: Twin) -> None:
    position, heading = starts(twin.num_twins, 3)
    twin.reset(position=position, heading=heading)
    steering, driven = signals(twin.num_twins, 3)[0]
    twin.set_commands({"steering_signal": steering, "drive_signal": driven, **ARMS})


class InTurn:
    """Advances twins by the roles, one after the other."""

    def __init__(self, twin: Twin):
        self._twin = twin
        self._board = wp.zeros((ROWS, twin.num_twins), dtype=float, device="cpu")
        self._kernel = in_turn(type(twin.ground)._cls, type(twin._laws)._cls)

    def advance(self, frames: int, every: int) -> None:
        twin = self._twin
        twin._frames(1e-3 * frames * every, 1e-3 * every)
        inputs = [
            twin._machines, twin._laws, twin._felt, twin._held, twin.state, twin._history, twin._clock, twin._status,
            twin._outputs, 0, frames, every, twin.substeps, twin.main_step, self._board,
        ]  # fmt: skip
        wp.launch(self._kernel, dim=twin.num_twins, inputs=inputs, device="cpu")


def test_roles_in_turn_are_the_twin():
    """With gas, mounts and neither; the only rounding is that of what the arms take, added in pairs."""
    alone, together = pair(COUNT, rare(COUNT), threads=1)
    roles = InTurn(together)
    for frames, every in ((1, 1), (2, 10), (3, 60)):
        alone.advance(1e-3 * frames * every, sample_every=1e-3 * every)
        roles.advance(frames, every)
        assert largest_difference(alone, together) < 2.0 * TOLERANCE  # with stiff mounts
        outputs, expected = together._outputs.numpy(), alone._outputs.numpy()
        scale = np.maximum(np.abs(expected).max(axis=(0, 2)), 1e-3)[:, None]
        assert np.all(np.abs(outputs - expected) < 1e-4 * scale)
    assert np.array_equal(alone.time, together.time)
    assert np.abs(alone.state.numpy()[State.ARM_BORE_FL]).max() > 1e6


def test_a_twin_that_diverges_stays_as_it_was():
    alone, together = pair(COUNT, Machine.load(), threads=1)
    for twin in (alone, together):
        state = twin.state.numpy()
        state[State.ARM_BORE_RR, 5] = np.inf
    before = together.state.numpy().copy()
    alone.advance(0.02)
    InTurn(together).advance(1, 20)
    for twin in (alone, together):
        assert [index for index, _ in twin.diverged] == [5]
        assert np.array_equal(twin.state.numpy()[:, 5], before[:, 5])
        assert twin.time[5] == 0.0
        state = twin.state.numpy()
        state[State.ARM_BORE_RR, 5] = 0.0
    assert largest_difference(alone, together) < TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize("ground", ["raster", "mesh"])
def test_roles_in_turn_feel_a_terrain(ground):
    alone, together = pair(COUNT, randomised(Machine.load(), COUNT, 3), terrain=terrain(), ground=ground, threads=1)
    roles = InTurn(together)
    for _ in range(5):
        alone.advance(0.02)
        roles.advance(1, 20)
    assert largest_difference(alone, together) < 2.0 * TOLERANCE


@pytest.mark.slow
def test_roles_in_turn_know_all_laws():
    alone, together = pair(COUNT, Machine.load().sample(COUNT, laws="any", seed=4), threads=1)
    alone.advance(0.02)
    InTurn(together).advance(1, 20)
    assert largest_difference(alone, together) < 3.0 * TOLERANCE


@pytest.mark.slow
def test_the_kernel_compiles_for_cuda(tmp_path):
    """Compiled without a GPU, by NVRTC: four warps that wait for each other, and no register spilled to memory but a few."""
    from aoro_gym.twin.kernels.build import build

    twin = Twin()
    kernel = build(type(twin.ground)._cls, type(twin._laws)._cls, by_roles=True)[1]
    (path,) = (
        file
        for file in wp.compile_aot_module(kernel.module, arch=90, use_ptx=True, module_dir=tmp_path)
        if file.suffix == ".ptx"
    )
    text = path.read_bytes().decode(errors="ignore")
    assert text.count("bar.arrive") >= 2
    assert "ld.shared" in text
    assert ".local" not in text  # no array that registers could not hold


def test_roles_are_for_a_gpu():
    with pytest.raises(ValueError, match="roles is True, but these twins run on a CPU"):
        Twin(roles=True)
    assert not Twin(roles=False).by_roles
    with pytest.raises(ValueError, match="roles is True, but these twins are on soil"):
        choose_roles(True, 64, on_cuda=True, obstacle="are on soil")
    assert not choose_roles(None, 64, on_cuda=True, obstacle="are on soil")


def test_the_faster_form_is_taken():
    rates = {int(count): rate for count, rate in measured()["steps_per_s"].items()}
    for count, rate in rates.items():
        assert faster_by_roles(count) == (rate["roles"] > rate["one_thread"])
        assert choose_roles(None, count, on_cuda=True, obstacle=None) == faster_by_roles(count)
        assert not choose_roles(False, count, on_cuda=True, obstacle=None)
        assert not choose_roles(None, count, on_cuda=True, obstacle=None, as_measured=False)
        assert choose_roles(True, count, on_cuda=True, obstacle=None, as_measured=False)
    assert faster_by_roles(1) == faster_by_roles(min(rates))
    assert faster_by_roles(10**7) == faster_by_roles(max(rates))


# ---- on a GPU -------------------------------------------------------------------------------------------------------


def forms(count: int, machine: Machine, **options) -> tuple[Twin, Twin]:
    """Twins of one thread each, and by roles."""
    one, roles = (Twin(count, machine=machine, device="cuda:0", roles=roles, **options) for roles in (False, True))
    for twin in (one, roles):
        begin(twin)
    return one, roles


GROUNDS = {
    "plane": {},
    "raster": {"terrain": terrain, "ground": "raster"},
    "mesh": {"terrain": terrain, "ground": "mesh"},
}


def effects(count: int) -> Machine:
    """Machines that each effect of the catalogue has changed in turn, at the most that it may."""
    machines = [
        effect.apply(Machine.load(), *(magnitude.high for magnitude in effect.magnitudes))
        for effect in EFFECTS.values()
    ]
    counts = [len(range(first, count, len(machines))) for first in range(len(machines))]
    return Machine.stacked(machines, counts)


GPU_TOLERANCE = 4.0 * TOLERANCE
"""CUDA's quotients and roots are good to two units in the last place, and products are taken up otherwise in either form."""


def hold_alike(one: Twin, roles: Twin, tolerance: float = GPU_TOLERANCE) -> None:
    """Run both for 20 main steps, and then for a second."""
    for twin in (one, roles):
        twin.advance(0.02, sample_every=0.005)
    assert largest_difference(one, roles) < tolerance
    expected, found = (twin.outputs.numpy() for twin in (one, roles))
    scale = np.maximum(np.abs(expected).max(axis=(0, 2)), 1e-3)[:, None]
    assert np.all(np.abs(found - expected) < 10.0 * tolerance * scale)
    for twin in (one, roles):
        for _ in range(49):
            twin.advance(0.02)
    assert np.array_equal(one.time, roles.time)
    assert np.array_equal(one.status, roles.status)
    assert np.abs(states(one)[:6] - states(roles)[:6]).max() < 5e-3


@needs_gpu
@pytest.mark.parametrize("count", [1, 37, 4100])
@pytest.mark.parametrize("ground", GROUNDS)
def test_on_a_gpu_both_forms_move_alike(ground, count):
    """A part of a block, one and a part, and as many blocks as a card has multiprocessors; frames shorter than a launch."""
    options = {name: value() if callable(value) else value for name, value in GROUNDS[ground].items()}
    hold_alike(*forms(count, randomised(Machine.load(), count, 3), **options))


@needs_gpu
def test_on_a_gpu_results_repeat_to_the_bit():
    """Whether warps are early or late, other blocks beside them or none, nobody reads what is not yet told."""
    machine = randomised(Machine.load(), 96, 3)
    first, again = (Twin(96, machine=machine, device="cuda:0", roles=True) for _ in range(2))
    for twin in (first, again):
        begin(twin)
    for _ in range(50):
        first.advance(0.02)
        for end in (32, 64, 96):  # a block a launch
            again.advancing(0.02)(end - 32, end)
    assert np.array_equal(first.state.numpy(), again.state.numpy())


@needs_gpu
def test_on_a_gpu_some_have_gas_or_a_mount():
    hold_alike(*forms(96, rare(96)))


@needs_gpu
def test_on_a_gpu_every_effect_is_alike():
    hold_alike(*forms(2 * len(EFFECTS), effects(2 * len(EFFECTS))))


@needs_gpu
def test_on_a_gpu_all_laws_are_alike():
    hold_alike(*forms(64, Machine.load().sample(64, laws="any", seed=4)), tolerance=3.0 * GPU_TOLERANCE)


@needs_gpu
def test_on_a_gpu_who_diverges_or_is_frozen_stays_as_it_was():
    """Its neighbours in the warp drive on; a reset revives it."""
    twins = forms(70, Machine.load())
    for twin in twins:
        state, status = twin.state.numpy(), twin.status
        state[State.SUPPLY, 5] = np.nan
        status[40] = NON_FINITE
        twin.state.assign(state)
        twin.status_codes.assign(status)
        twin.advance(0.02)
        assert [index for index, _ in twin.diverged] == [5, 40]
        assert np.array_equal(twin.state.numpy()[:, [5, 40]], state[:, [5, 40]], equal_nan=True)
        assert list(twin.time[[4, 5, 40, 69]]) == [0.02, 0.0, 0.0, 0.02]
        twin.reset(twin.status > 0, position=(5.0, 1.0))
        twin.advance(0.02)
        assert twin.diverged == []
    assert largest_difference(*twins) < GPU_TOLERANCE


@needs_gpu
def test_on_a_gpu_a_part_of_the_twins_moves_alone():
    """Slices that begin and end within a block leave the others where they are."""
    twins = forms(100, randomised(Machine.load(), 100, 3))
    for twin in twins:
        still = twin.state.numpy()[:, [9, 50]]
        advance = twin.advancing(0.02)
        advance(10, 50)
        advance(51, 100)
        assert np.array_equal(twin.state.numpy()[:, [9, 50]], still)
        assert list(twin.time[[9, 10, 49, 50, 51, 99]]) == [0.0, 0.02, 0.02, 0.0, 0.02, 0.02]
    assert largest_difference(*twins) < GPU_TOLERANCE
