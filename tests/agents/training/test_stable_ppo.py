"""PPO that waits for no device learns what Stable-Baselines3's does, from the same draws, and saves what that loads."""

import json
from typing import Any

import numpy as np
import pytest

torch: Any = pytest.importorskip("torch")
for library in ("stable_baselines3", "yaml"):
    pytest.importorskip(library)
from stable_baselines3 import PPO  # noqa: E402  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.logger import Logger  # noqa: E402  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.vec_env import VecNormalize  # noqa: E402  # pyright: ignore[reportMissingImports]
from torch.distributions import Distribution  # noqa: E402  # pyright: ignore[reportMissingImports]

from aoro_gym.agents.training.stable_ppo import StablePPO  # noqa: E402
from aoro_gym.agents.training.vec_env import make_vec_env  # noqa: E402
from tests.agents.training.waits import Waits  # noqa: E402

TURNING = "AORO/Turning-v0"
ULP = 2.0**-23
# the last minibatch of an epoch is a smaller one, unless asked otherwise
SMALL = {"n_steps": 25, "batch_size": 30, "n_epochs": 3, "gamma": 0.98, "ent_coef": 0.01}

pytestmark = pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")


class Kept(Logger):
    """Keeps what was logged of each rollout."""

    def __init__(self) -> None:
        super().__init__(None, [])
        self.rows: list[dict[str, Any]] = []

    def dump(self, step: int = 0) -> None:
        self.rows.append({name: value for name, value in self.name_to_value.items() if not name.startswith("time/")})
        self.name_to_value.clear()
        self.name_to_count.clear()


def learned(
    algorithm: type[PPO], rollouts: int = 4, callback: Any = None, **changes
) -> tuple[Any, list[dict[str, Any]]]:
    """Four sub-environments whose episodes are cut after 12 steps: a rollout of 25 has two ends of each."""
    envs = make_vec_env(TURNING, 4, seed=3, env_kwargs={"max_episode_steps": 12})
    model = algorithm("MlpPolicy", VecNormalize(envs, gamma=0.98), seed=1, device="cpu", **(SMALL | changes))
    logger = Kept()
    model.set_logger(logger)
    model.learn(rollouts * 25 * 4, callback)
    model.dump_logs(rollouts)
    return model, logger.rows


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"clip_range_vf": 0.1},
        {"target_kl": 1e-4},
        {"normalize_advantage": False},
        {"use_sde": True, "policy_kwargs": {"squash_output": True}},  # whose entropy has no closed form
    ],
)
def test_learns_what_stable_baselines3_learns(changes):
    theirs, their_rows = learned(PPO, **changes)
    ours, our_rows = learned(StablePPO, **changes)
    # 48 updates of at most the learning rate each, of which each rounds in its last places; weights are below 2
    for one, other in zip(theirs.policy.parameters(), ours.policy.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=0.0, atol=48 * ULP)
    assert ours._n_updates == theirs._n_updates == (12 if "target_kl" not in changes else 11)
    assert len(our_rows) == len(their_rows) == 5
    for their_row, our_row in zip(their_rows, our_rows, strict=True):
        assert our_row.keys() == their_row.keys()
        for name, value in their_row.items():
            # means of terms of order one, of which the last place may differ
            assert our_row[name] == pytest.approx(value, rel=0.0, abs=48 * ULP * max(1.0, abs(value))), name
    one, other = (model.get_vec_normalize_env() for model in (theirs, ours))
    np.testing.assert_allclose(other.obs_rms.mean, one.obs_rms.mean, rtol=1e-4, atol=1e-6)


def test_the_same_seed_learns_the_same():
    weights = [torch.cat([one.flatten() for one in learned(StablePPO, 2)[0].policy.parameters()]) for _ in range(2)]
    assert torch.equal(*weights)


def test_the_host_waits_once_an_update():
    """However many minibatches there are: for what is logged, and for the deviation."""
    model, _ = learned(StablePPO, 1)
    found = []
    for model.n_epochs in (1, 7):
        with Waits() as counted:
            model.train()
        found.append(counted.count)
    assert found == [1, 1]
    stock, _ = learned(PPO, 1)
    with Waits() as counted:
        stock.train()
    assert counted.count > 3 * 4 * 3  # three losses of each of the minibatches: the counter counts


def test_time_limits_are_worth_what_follows_of_all_at_once():
    model, _ = learned(StablePPO, 1)
    asked = []
    predict = model.policy.predict_values
    model.policy.predict_values = lambda observations: asked.append(len(observations)) or predict(observations)
    model.learn(25 * 4, reset_num_timesteps=False)
    assert asked == [4, 4, 4]  # two time limits, and the end of the rollout
    model.policy.predict_values = predict


def test_callbacks_of_every_kind_are_called():
    from stable_baselines3.common.callbacks import BaseCallback  # pyright: ignore[reportMissingImports]

    seen = []

    class Seeing(BaseCallback):
        def _on_step(self) -> bool:
            seen.append("own")
            return True

    def see(local: Any, everything: Any) -> bool:
        seen.append("function")
        return True

    for callback, wanted in ((Seeing(), ["own"]), (see, ["function"]), ([Seeing(), Seeing()], ["own", "own"])):
        seen.clear()
        learned(StablePPO, 1, callback)
        assert seen == 25 * wanted


def test_what_it_saves_loads_as_stable_baselines3s_own(tmp_path):
    model, _ = learned(StablePPO, 1)
    model.save(tmp_path / "model.zip")
    observations = np.random.default_rng(0).normal(size=(5, 8)).astype(np.float32)
    wanted, _ = model.predict(observations, deterministic=True)
    for algorithm in (PPO, StablePPO):
        loaded = algorithm.load(tmp_path / "model.zip", device="cpu")
        np.testing.assert_array_equal(loaded.predict(observations, deterministic=True)[0], wanted)
        loaded.set_env(model.get_env())
        loaded.learn(25 * 4)  # goes on
    text = json.dumps(PPO.load(tmp_path / "model.zip", device="cpu").policy_kwargs, default=str)
    assert "aoro_gym" not in text


def test_other_optimisers_are_taken():
    model, _ = learned(StablePPO, 1, policy_kwargs={"optimizer_class": torch.optim.SGD})
    assert type(model.policy.optimizer) is torch.optim.SGD


def test_distributions_are_checked_again_afterwards():
    before = Distribution._validate_args
    Distribution.set_default_validate_args(True)
    try:
        during = []
        learned(StablePPO, 1, lambda *_: bool(during.append(Distribution._validate_args)) or True)
        assert set(during) == {False}
        assert Distribution._validate_args is True
    finally:
        Distribution.set_default_validate_args(before)


def test_a_policy_that_is_not_finite_is_refused_by_the_environment():
    def broken(local: dict[str, Any], _: Any) -> bool:
        with torch.no_grad():
            local["self"].policy.log_std.fill_(torch.nan)
        return True

    with pytest.raises(ValueError, match="action"):
        learned(StablePPO, 1, broken)
