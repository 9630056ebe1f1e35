"""The way-point loader: inverse kinematics that finds a way to every place, and logs that come to lie on the bunk."""

import numpy as np
import pytest

from aoro_gym.agents.controllers.loading import Loader, WaypointLoader
from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES, reference_policy
from aoro_gym.agents.evaluation.loading import every_log, load_logs
from aoro_gym.agents.policies.files import shipped_policies
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.envs import LoadingConfig, LoadingVectorEnv
from aoro_gym.envs.loading.config import MILD
from aoro_gym.envs.loading.logs import held_out_sites, validation_sites
from aoro_gym.envs.loading.task import PLACED
from aoro_gym.machine.vehicle_crane import VehicleCrane

ENV = "AORO/Loading-v0"


@pytest.fixture(scope="module")
def envs() -> LoadingVectorEnv:
    """Eight cranes of a mild spread beside logs of every difficulty."""
    return LoadingVectorEnv(8, courses=validation_sites(), autoreset_mode="Disabled", randomisation=MILD)


def test_its_joints_bring_the_tip_where_it_wants_it():
    """200 places within reach, from anywhere: to 1 mm, with every joint in its range, and by the slew's shorter way."""
    rng, vehicle = np.random.default_rng(7), VehicleCrane()
    layout = {
        name: slice(0, 4) for name in ("joints", "joint_rates", "grapple", "log", "log_angle", "bunk", "bunk_angle")
    }
    loader = WaypointLoader(Loader(layout, vehicle, LoadingConfig()))
    low, high = (np.array(one, dtype=float) for one in zip(*vehicle.crane.limits, strict=True))
    aim = rng.uniform([-2.9, -0.2, -2.3, 0.0], [2.9, 1.2, -0.8, 0.0], (200, 4))
    places, now = vehicle.tip(aim.T), rng.uniform(low, high, (200, 4))
    found = loader._joints(places.T, now)
    np.testing.assert_allclose(vehicle.tip(found.T), places, atol=1e-3)
    assert np.all(found >= low) and np.all(found <= high)
    near = np.abs(now[:, 0]) < 0.3
    assert np.abs(found - now)[near, 0].max() < np.pi


@pytest.mark.parametrize("name", sorted(REFERENCE_POLICIES[ENV]))
def test_it_puts_logs_on_the_bunk(envs, name):
    """All of eight by either; the fast one swings the grapple too much to succeed."""
    episodes = load_logs(envs, reference_policy(ENV, name, envs), list(range(8)))
    assert episodes.endings == [PLACED] * 8
    calm = name == "waypoints"
    assert episodes.metrics["success_rate"].mean() >= 0.75 if calm else episodes.metrics["success_rate"].max() == 0.0
    assert np.all(episodes.metrics["sway_rms_deg"] < (12.0 if calm else 30.0))
    assert episodes.film.shape[1] == len(envs.task.render_channels)
    left = episodes.errors[0][np.isfinite(episodes.errors[0])]
    assert left[0] > 6.0 and left[-1] < 1.0


def test_the_learned_policy_does_as_well(envs):
    learned = LearnedPolicy.load(shipped_policies(ENV)["loading-dagger"]).made_for(envs)
    episodes = load_logs(envs, learned, list(range(8)))
    assert episodes.endings == [PLACED] * 8
    assert episodes.metrics["success_rate"].mean() >= 0.75 and np.all(episodes.metrics["sway_rms_deg"] < 12.0)


def test_the_one_that_went_on_loads_in_less_time_and_energy_with_less_swing(envs):
    """Log by log, beside the controller that succeeds."""
    names = "duration_s", "energy_kJ", "sway_rms_deg"
    learned = LearnedPolicy.load(shipped_policies(ENV)["loading-ppo"]).made_for(envs)
    episodes = load_logs(envs, learned, list(range(8)))
    assert episodes.endings == [PLACED] * 8 and np.all(episodes.metrics["success_rate"] == 1.0)
    others = load_logs(envs, reference_policy(ENV, "waypoints", envs), list(range(8)))
    for name in names:
        less = others.metrics[name] - episodes.metrics[name]
        assert np.all(less[others.metrics["success_rate"] == 1.0] > 0.0), name


def test_seeds_in_a_row_load_every_log_once():
    sites = held_out_sites()
    assert len(np.unique(every_log(sites, range(200)), axis=0)) == 200
    with pytest.raises(ValueError, match="an evaluation needs 'Disabled'"):
        load_logs(LoadingVectorEnv(1), lambda observations: observations, [1])  # pyright: ignore[reportArgumentType]
