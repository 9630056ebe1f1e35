"""Tensors on the twins' device say what NumPy's arrays say, and nothing of a step comes to the host but flags."""

import builtins
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest

from aoro_gym.envs import register_envs
from aoro_gym.envs.path_tracking.config import MILD, PathTrackingConfig
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.envs.path_tracking.task import END_OF_PATH
from aoro_gym.envs.turning import config as turning
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.sensors import FixLoss, GpsNoise
from aoro_gym.sensors.noise import channels, draw_seeds, white
from aoro_gym.twin.records import Output, State
from tests.envs.path_tracking.paths import LEVEL

torch = pytest.importorskip("torch")
pytest.importorskip("array_api_compat")
register_envs()

CASES = {
    "path tracking": ("AORO/PathTracking-v0", {}),
    "path tracking, all that is measured": (
        "AORO/PathTracking-v0",
        {
            "randomisation": MILD,
            "gear": "automatic",
            "arms": "level",
            "observe_inertial": True,
            "scan_x": (2.0, 4.0),
            "config": PathTrackingConfig(gps_noise=GpsNoise.typical(FixLoss(interval=1.0))),
        },
    ),
    "path tracking, all that acts": (
        "AORO/PathTracking-v0",
        {"act_arms": True, "act_traction": True, "act_gear": True},
    ),
    "turning": ("AORO/Turning-v0", {}),
    "turning, all that is measured": ("AORO/Turning-v0", {"randomisation": turning.MILD, "observe_pressures": True}),
}

PARTS = ("observations", "rewards", "terminations", "truncations", "infos")
# A unit in the last place of float32. What is rounded to it differs by some 1e-16, so the results by one unit at most; a
# reward sums a few of them.
ROUNDING = 2.0**-23


def agree(name, numpys, tensors):
    """Both say the same, up to rounding, of the same kind."""
    assert isinstance(tensors, torch.Tensor), name
    shown = tensors.numpy()
    assert shown.dtype == numpys.dtype and shown.shape == numpys.shape, name
    if numpys.dtype.kind in "bi":
        np.testing.assert_array_equal(shown, numpys, err_msg=name)
    else:
        scale = max(1.0, float(np.abs(numpys).max(initial=0.0)))
        np.testing.assert_allclose(shown, numpys, rtol=0.0, atol=4.0 * ROUNDING * scale, err_msg=name)


def infos_agree(env, numpys, tensors):
    assert numpys.keys() == tensors.keys()
    for name, value in numpys.items():
        if name == "final_info":
            infos_agree(env, value, tensors[name])
        elif name == "final_obs":
            for i in np.flatnonzero(numpys["_final_obs"]):
                agree(name, value[i], tensors[name][i])
        elif name == "termination":
            words = [env.termination_reasons[code] or None for code in tensors[name]]
            assert words == value.tolist()
        else:
            agree(name, value, tensors[name])


@pytest.mark.parametrize("case", CASES)
def test_tensors_say_what_arrays_say(case):
    """Over three episodes each, with their resets."""
    name, arguments = CASES[case]
    host, device = (
        gymnasium.make_vec(name, num_envs=3, max_episode_steps=16, output=output, **arguments)
        for output in ("numpy", "torch")
    )
    device: Any = device.unwrapped
    observations, infos = host.reset(seed=7)
    tensors, tensor_infos = device.reset(seed=7)
    agree("observations", observations, tensors)
    infos_agree(device, infos, tensor_infos)
    rng, ended = np.random.default_rng(3), 0
    for _ in range(40):
        actions = rng.uniform(-1.1, 1.1, device.action_space.shape).astype(np.float32)
        of_numpy, of_torch = host.step(actions), device.step(torch.as_tensor(actions))
        for what, array, tensor in zip(PARTS, of_numpy, of_torch, strict=True):
            if what != "infos":
                agree(what, array, tensor)
        infos_agree(device, of_numpy[4], of_torch[4])
        ended += int(of_torch[3].sum())
    assert ended == 6


@pytest.mark.parametrize("mode", ["NextStep", "Disabled"])
def test_other_autoresets_agree_too(mode):
    host, device = (TurningVectorEnv(2, max_episode_steps=3, autoreset_mode=mode, output=o) for o in ("numpy", "torch"))
    for env in (host, device):
        env.reset(seed=1)
    for step in range(8):
        actions = np.full((2, 1), 0.5, dtype=np.float32)
        of_numpy, of_torch = host.step(actions), device.step(actions)
        for array, tensor in zip(of_numpy[:4], of_torch[:4], strict=True):
            agree(f"step {step}", array, tensor)
        infos_agree(device, of_numpy[4], of_torch[4])
        if mode == "Disabled" and of_numpy[3].any():
            options = {"reset_mask": of_numpy[3]}
            agree("reset", host.reset(options=options)[0], device.reset(options=options)[0])


def test_reasons_are_numbered():
    host, device = (
        PathTrackingVectorEnv(2, courses=(LEVEL,), autoreset_mode="Disabled", output=o) for o in ("numpy", "torch")
    )
    for env in (host, device):
        env.reset(seed=0, options={"path": 0, "start": np.array([37.9, 10.0])})
    actions = np.tile(np.array([0.0, 1.0], dtype=np.float32), (2, 1))
    for _ in range(80):
        *_, terminated, _, infos = device.step(actions)
        arrays = host.step(actions)
        infos_agree(device, arrays[4], infos)
        if terminated.any():
            break
    assert terminated.tolist() == [True, False]
    assert device.termination_reasons[infos["termination"][0]] == END_OF_PATH
    assert infos["_termination"].tolist() == [True, False]


def test_a_lost_twin_is_said_so_and_recovers():
    env = PathTrackingVectorEnv(2, courses=(LEVEL,), output="torch", autoreset_mode="SameStep")
    before, _ = env.reset(seed=0)
    env.twin.state.numpy()[State.JOINT_RATE, 1] = np.nan
    observations, rewards, terminated, _, infos = env.step(torch.zeros((2, 2)))
    assert terminated.tolist() == [False, True]
    reason = env.termination_reasons[infos["final_info"]["termination"][1]]
    assert reason == "simulation diverged: non-finite state"
    assert rewards[1] == 0.0 and not infos["final_info"]["is_success"][1]
    assert torch.equal(infos["final_obs"][1], before[1])
    assert torch.isfinite(observations).all()
    assert not env.step(torch.zeros((2, 2)))[2].any()


# ---- memory ----------------------------------------------------------------------------------------------------------


def test_outputs_alias_the_twins_memory_and_observations_last():
    env = TurningVectorEnv(3, output="torch")
    first, infos = env.reset(seed=0)
    kept = first.clone(), infos["joint_angle"].clone()
    outputs = env.twin.outputs
    frames, channels_, count = outputs.shape
    pressure = env.output("pressure_a")
    row = ((frames - 1) * channels_ + int(Output.PRESSURE_A)) * count
    assert pressure.data_ptr() == outputs.ptr + 4 * row
    env.step(torch.ones((3, 1)))  # the command is on its way to the spool, and the spool in its dead band
    before = pressure.clone()
    second, rewards, _, _, infos = env.step(torch.ones((3, 1)))
    assert not torch.equal(pressure, before)  # it holds until the next step
    assert env.output("pressure_a").data_ptr() == pressure.data_ptr()
    later = second.clone(), rewards.clone(), infos["joint_angle"].clone()
    env.step(torch.ones((3, 1)))
    for tensor, value in zip((first, second, rewards, infos["joint_angle"]), (kept[0], *later), strict=True):
        assert torch.equal(tensor, value)


def test_actions_come_from_either_side_and_are_not_kept():
    actions = torch.full((2, 1), 0.7)
    envs = [TurningVectorEnv(2, output="torch") for _ in range(2)]
    for env, given in zip(envs, (actions, actions.numpy().copy()), strict=True):
        env.reset(seed=0)
        env.step(given)
        given[:] = 0.0
    shown = [env.step(torch.zeros((2, 1)))[0] for env in envs]
    assert torch.equal(*shown)
    layout = envs[0].observation_layout["signals"]
    assert shown[0][0, layout].tolist()[:2] == [0.0, np.float32(0.7)]


class Watched(torch.utils._python_dispatch.TorchDispatchMode):
    """Notes what would wait for a GPU: a value that is looked at, rows that booleans select."""

    waits = ("_local_scalar_dense", "nonzero", "masked_select", "unique", "item")

    def __init__(self):
        super().__init__()
        self.found: list[str] = []
        self.calls = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        name = func.overloadpacket.__name__
        self.calls += 1
        if any(name.startswith(wait) for wait in self.waits):
            self.found.append(name)
        if name in ("index", "index_put", "index_put_"):
            masks = [one for one in args[1] if one is not None and one.dtype == torch.bool]
            fills = name != "index" and args[2].numel() == 1  # is a masked fill
            if masks and not fills:
                self.found.append(f"{name} by booleans")
        return func(*args, **(kwargs or {}))


class Uploads(torch.overrides.TorchFunctionMode):
    """Notes what would be copied to a GPU."""

    def __init__(self):
        super().__init__()
        self.found: list[str] = []

    def __torch_function__(self, func, types, args=(), kwargs=None):
        name = getattr(func, "__name__", str(func))
        if name in ("asarray", "as_tensor", "tensor", "from_numpy") and not isinstance(args[0], torch.Tensor):
            self.found.append(name)
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("kernels", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_a_step_without_an_end_waits_for_its_flags_only(case, kernels, monkeypatch):
    name, arguments = CASES[case]
    env: Any = gymnasium.make_vec(name, num_envs=3, output="torch", kernels=kernels, **arguments).unwrapped
    env.reset(seed=0)
    actions = torch.zeros(env.action_space.shape)
    env.step(actions)
    read = []
    monkeypatch.setattr(env.arrays, "host", lambda tensor: read.append(tuple(tensor.shape)) or tensor.numpy())
    monkeypatch.setattr(env.arrays, "alias", aliases := remembered(env.arrays.alias))
    for array in (env.twin.outputs, env.twin.state, env.twin.status_codes):
        aliases(array)  # not an upload
    with Watched() as watched, Uploads() as uploads:
        env.step(actions)
    assert read == [(5,)]
    # it did watch; with kernels there is little left to be seen: actions in, copies of results out
    assert 5 < watched.calls < 30 if kernels else watched.calls > 200
    assert watched.found == []
    assert uploads.found == []


@pytest.mark.parametrize("name", ["AORO/PathTracking-v0", "AORO/Turning-v0"])
def test_a_reset_within_a_step_is_a_few_launches_too(name):
    """What begins goes up at once: with array operations it was 1,273 of them for a path."""
    env: Any = gymnasium.make_vec(
        name, num_envs=3, output="torch", autoreset_mode="SameStep", max_episode_steps=2
    ).unwrapped
    env.reset(seed=0)
    actions = torch.zeros(env.action_space.shape)
    env.step(actions)
    with Watched() as watched:
        assert env.step(actions)[3].all()
    assert 20 < watched.calls < 150


def remembered(alias):
    known: dict[int, Any] = {}
    return lambda array: known.get(array.ptr) if array.ptr in known else known.setdefault(array.ptr, alias(array))


def test_the_watch_sees_what_waits():
    """What the test above holds against a step can be seen."""
    values = torch.arange(3.0)
    with Watched() as watched, Uploads() as uploads:
        assert not bool(values[0] > 0.0)
        assert len(values[values > 1.0]) == 1
        assert len(torch.asarray([1.0])) == 1
    assert watched.found == ["_local_scalar_dense", "index by booleans"]
    assert uploads.found == ["asarray"]


# ---- parts -----------------------------------------------------------------------------------------------------------


def test_noise_is_the_hosts():
    """Equal integers; logarithm, root and cosine differ by some units in the last place of values below 9."""
    seeds = channels(draw_seeds(np.random.default_rng(0).spawn(50)), range(4))
    number = np.arange(50)
    there = white(torch.as_tensor(seeds), torch.as_tensor(number))
    np.testing.assert_allclose(there.numpy(), white(seeds, number), rtol=0.0, atol=9 * 4 * 2.0**-53)


def test_own_terms_work_on_tensors():
    arguments: dict[str, Any] = {
        "reward_terms": {"pump": (-0.5, lambda view: view.xp.minimum(view.output("pump_pressure") / 1e7, 1.0))},
        "observation_terms": {"both": lambda view: view.xp.stack([view.error, view.target_age], axis=-1)},
    }
    host, device = (TurningVectorEnv(2, output=o, **arguments) for o in ("numpy", "torch"))
    for env in (host, device):
        env.reset(seed=0)
    for _ in range(3):
        of_numpy, of_torch = (env.step(np.ones((2, 1), dtype=np.float32)) for env in (host, device))
    agree("observations", of_numpy[0], of_torch[0])
    agree("pump", of_numpy[4]["reward/pump"], of_torch[4]["reward/pump"])


# ---- errors ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"output": "jax"}, "output is 'jax'; choose one of: numpy, torch"),
        ({"output": "torch", "render_mode": "rgb_array"}, "drawn on the host: take output='numpy'"),
    ],
)
def test_wrong_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        TurningVectorEnv(1, **arguments)


@pytest.mark.parametrize("missing", ["torch", "array_api_compat"])
def test_a_missing_torch_names_the_extra(missing, monkeypatch):
    real = builtins.__import__

    def without(name, *arguments):
        if name.split(".")[0] == missing:
            raise ImportError(f"No module named {missing!r}", name=missing)
        return real(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ValueError, match=rf"{missing} is missing: pip install 'aoro-gym\[torch\]'"):
        TurningVectorEnv(1, output="torch")


def test_wrong_actions_and_terms_are_named():
    env = TurningVectorEnv(2, output="torch", reward_terms={"mine": (1.0, lambda view: view.error / view.error * 0.0)})
    env.reset(seed=0)
    with pytest.raises(ValueError, match="actions have shape \\(2,\\), but must have \\(2, 1\\)"):
        env.step(torch.zeros(2))
    with pytest.raises(ValueError, match="action of sub-environment 1 is not finite"):
        env.step(torch.tensor([[0.0], [torch.nan]]))
    assert np.isfinite(env.twin.commands.numpy()).all()
    with pytest.raises(ValueError, match="action of sub-environment 0 is not finite"):
        env.step(np.array([[np.inf], [0.0]]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = TurningVectorEnv(2, output="torch", reward_terms={"mine": (1.0, lambda view: view.error * np.nan)})
        env.reset(seed=0)
        with pytest.raises(ValueError, match=r"reward_terms\['mine'\] is nan in sub-environment 0"):
            env.step(torch.zeros((2, 1)))
        env = TurningVectorEnv(2, output="torch", observation_terms={"mine": lambda view: view.error * np.nan})
        with pytest.raises(ValueError, match=r"observation_terms\['mine'\] is nan in sub-environment 0"):
            env.reset(seed=0)


def test_a_single_environment_has_no_tensors():
    with pytest.raises(ValueError, match=r"output belongs to gymnasium\.make_vec"):
        gymnasium.make("AORO/Turning-v0", output="torch")
