"""Evaluation: the same episodes for everyone, metrics that follow from what was driven, intervals that cover."""

import json
import math

import numpy as np
import pytest
from scipy.stats import beta, norm, trim_mean

from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES
from aoro_gym.agents.evaluation import batches, films
from aoro_gym.agents.evaluation import report as evaluation_report
from aoro_gym.agents.evaluation.drives import STATION
from aoro_gym.agents.evaluation.episodes import TIME_IS_UP
from aoro_gym.agents.evaluation.evaluate import evaluate, policy_factory
from aoro_gym.agents.evaluation.logs import write_episode
from aoro_gym.agents.evaluation.path_tracking import drive_paths
from aoro_gym.agents.evaluation.responses import responses, rollout
from aoro_gym.agents.evaluation.statistics import interquartile_mean, interval, stratified_interval
from aoro_gym.envs.core import vector
from aoro_gym.envs.path_tracking.config import FIXED
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.envs.path_tracking.task import END_OF_PATH
from aoro_gym.envs.turning.environment import TurningVectorEnv
from aoro_gym.recording.tables import read_table
from aoro_gym.terrains import Path, Plane
from aoro_gym.view.replay import log_channels

TRACKING, TURNING = "AORO/PathTracking-v0", "AORO/Turning-v0"
SHORT = Course(
    Plane(),
    (
        Path(np.stack([np.arange(0.0, 13.0), np.zeros(13)], axis=1), name="ahead"),
        Path(np.stack([np.arange(0.0, 10.0), np.zeros(10)], axis=1), name="shorter"),
    ),
    name="two lines",
)


class Asleep:
    """Never moves."""

    def __init__(self, env):
        self.forgotten = []

    def __call__(self, observations):
        return np.zeros((len(observations), 2), dtype=np.float32)

    def reset(self, mask=None):
        self.forgotten.append(mask)


@pytest.fixture(scope="module")
def found():
    """A controller that arrives and one that does not."""
    policies = {"preview": policy_factory(TRACKING, "preview"), "asleep": Asleep}
    return evaluate(TRACKING, policies, episodes=3, seed=5, courses=[SHORT])


@pytest.fixture(scope="module")
def turned():
    return evaluate(TURNING, {"bang-bang": policy_factory(TURNING, "bang-bang")}, episodes=2, seed=3)


def test_results_are_shown_in_a_line(turned):
    assert repr(turned) == "Evaluation('AORO/Turning-v0', 2 episodes each of bang-bang)"
    assert repr(turned.runs["bang-bang"]).startswith("Episodes(2, ")


def test_devices_share_the_episodes(found):
    """Two shards of the CPU give what one gives, to the bit, in the order of the seeds."""
    told: list[float] = []
    policies = {"preview": policy_factory(TRACKING, "preview"), "asleep": Asleep}
    shared = evaluate(
        TRACKING,
        policies,
        episodes=3,
        seed=5,
        courses=[SHORT],
        device="cpu,cpu",
        progress=lambda _, share: told.append(share),
    )
    for name, run in found.runs.items():
        for metric, values in run.metrics.items():
            np.testing.assert_array_equal(shared.runs[name].metrics[metric], values, err_msg=metric)
        assert shared.runs[name].endings == run.endings
        np.testing.assert_array_equal(shared.runs[name].film, run.film)
    assert np.diff(told).min() > -1e-12 and told[-1] == pytest.approx(1.0)  # a sum of shares


def test_who_arrives_succeeds_and_who_sleeps_is_out_of_time(found):
    assert found.runs["preview"].endings == [END_OF_PATH] * 3
    # 8 m and less at 0.75 m/s, twice: the time is up before 20 s without motion make it stuck, or not
    assert set(found.runs["asleep"].endings) <= {"stuck", TIME_IS_UP}
    assert found.summary["preview"]["success_rate"].mean == 1.0
    assert found.summary["asleep"]["success_rate"].mean == 0.0
    assert found.endings["preview"][END_OF_PATH].mean == 1.0
    assert sum(value.mean for value in found.endings["asleep"].values()) == pytest.approx(1.0)
    # the end counts 0.25 m before it; a step of 0.05 s covers less than 0.1 m
    left = [SHORT.paths[row].length - 4.0 for row in found.runs["preview"].course[:, 1]]
    driven = found.runs["preview"].metrics["driven_m"]
    np.testing.assert_allclose(driven, np.array(left) - 0.25, atol=0.1)
    assert np.all(np.abs(found.runs["asleep"].metrics["driven_m"]) < 0.05)


def test_who_fails_is_not_the_better_for_it(found):
    """Who stands still keeps off no path, needs no energy and tilts nowhere: none of that is tabled as if it had driven."""
    asleep = found.summary["asleep"]
    for name in (
        "cross_track_rms_m",
        "cross_track_mean_m",
        "cross_track_p95_m",
        "speed_m_per_s",
        "energy_kJ",
        "duration_s",
    ):
        assert np.isnan(found.runs["asleep"].metrics[name]).all()
        assert asleep[name].episodes == 0 and math.isnan(asleep[name].mean)
        assert found.differences["asleep"][name].episodes == 0
    assert (asleep["worst_tilt_deg"].bounds, found.summary["preview"]["worst_tilt_deg"].bounds) == (3, 0)
    assert (asleep["driven_m"].episodes, asleep["return"].episodes) == (3, 3)
    rows = {row[0]: row for row in evaluation_report.metric_rows(found)}
    assert rows["mean [95 % interval]"][2:] == ["preview", "asleep"]
    assert rows["cross track rms, of successes"][3] == "-"
    assert rows["worst tilt"][3].startswith("≥ ")


def test_every_policy_drives_the_same_episodes(found):
    first, second = found.runs.values()
    np.testing.assert_array_equal(first.course, second.course)
    assert len(np.unique(first.course[:, 1])) == 2  # both paths were drawn
    np.testing.assert_array_equal(first.film[0], second.film[0])  # until somebody acts
    difference = found.differences["asleep"]["success_rate"]
    assert difference.mean == -1.0
    gaps = second.metrics["return"] - first.metrics["return"]
    assert found.differences["asleep"]["return"].mean == pytest.approx(gaps.mean())


def test_figures_follow_from_the_episode(found):
    """One episode again, alone, by the environment's own logging."""
    run, i = found.runs["preview"], 2
    env = PathTrackingVectorEnv(1, courses=[SHORT], randomisation=FIXED, autoreset_mode="Disabled")
    policy = policy_factory(TRACKING, "preview")(env)
    observation, info = env.reset(seed=5 + i)
    returns, errors, power, tilt = 0.0, [], 0.0, 0.0
    done = False
    while not done:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        returns += float(reward[0])
        errors.append(abs(float(info["cross_track"][0])))
        roll, pitch = env.output("roll")[0], env.output("pitch")[0]
        tilt = max(tilt, math.degrees(math.acos(math.cos(roll) * math.cos(pitch))))
        done = bool(terminated[0] or truncated[0])
    power = float(info["engine_work"][0])
    metrics = {name: values[i] for name, values in run.metrics.items()}
    # traces are float32: 1e-7 of some metres, and of an angle whose cosine is 1 - 1e-7 at worst 5e-4 rad
    assert metrics["cross_track_rms_m"] == pytest.approx(float(info["cross_track_rms"][0]), abs=1e-6)
    assert metrics["cross_track_mean_m"] == pytest.approx(np.mean(errors), abs=1e-6)
    assert metrics["cross_track_p95_m"] == pytest.approx(np.quantile(errors, 0.95), abs=1e-6)
    assert metrics["speed_m_per_s"] == pytest.approx(float(info["mean_speed"][0]))
    assert metrics["energy_kJ"] == pytest.approx(power / 1e3)
    assert metrics["worst_tilt_deg"] == pytest.approx(tilt, abs=0.03)
    assert metrics["duration_s"] == pytest.approx(0.05 * len(errors))
    assert metrics["return"] == pytest.approx(returns, rel=1e-6)


def test_errors_lie_along_the_path(found):
    run = found.runs["preview"]
    for i in range(3):
        known = np.isfinite(run.errors[i])
        stations = STATION * np.flatnonzero(known)
        assert known[: len(stations)].all()
        assert 0.0 <= run.metrics["driven_m"][i] - stations[-1] < STATION + 0.1
        # both lines lead along x from x = 4 m: the reference point's offset is its y, and it gets on as x does
        np.testing.assert_allclose(np.abs(run.places[i, known, 1]), run.errors[i, known], atol=1e-5)
        steps = np.diff(run.places[i, known, 0])
        assert np.all(np.abs(steps - STATION) < 0.1)
    assert not np.isfinite(found.runs["asleep"].errors[:, 1:]).any()


def test_parts_of_an_evaluation_are_the_whole(found, monkeypatch):
    monkeypatch.setattr(batches, "AT_ONCE", 2)
    told = []
    again = evaluate(
        TRACKING,
        {"preview": policy_factory(TRACKING, "preview")},
        episodes=3,
        seed=5,
        courses=[SHORT],
        progress=lambda name, share: told.append(share),
    )
    for name, values in again.runs["preview"].metrics.items():
        np.testing.assert_array_equal(values, found.runs["preview"].metrics[name], err_msg=name)
    np.testing.assert_array_equal(again.runs["preview"].course, found.runs["preview"].course)
    assert again.runs["preview"].errors.shape[0] == 3
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)


def test_policies_forget_what_ended():
    env = PathTrackingVectorEnv(2, courses=[SHORT], autoreset_mode="Disabled")
    policy = Asleep(env)
    # paths of different length: the shorter one's time is up first
    seeds = [seed for seed in range(20) if _path_of(env, seed) == 0][:1] + [
        seed for seed in range(20) if _path_of(env, seed) == 1
    ][:1]
    policy.forgotten.clear()
    run = drive_paths(env, policy, seeds)
    assert policy.forgotten[0] is None
    np.testing.assert_array_equal(policy.forgotten[1], [False, True])
    assert np.isnan(run.metrics["duration_s"]).all()  # neither arrived


def _path_of(env, seed):
    return int(env.reset(seed=[seed, 0])[1]["path"][0])


def test_an_evaluation_needs_its_own_resets():
    env = PathTrackingVectorEnv(1, courses=[SHORT])
    with pytest.raises(ValueError, match="'NextStep', but an evaluation needs 'Disabled'"):
        drive_paths(env, Asleep(env), [0])


def test_turning_figures_are_those_of_its_responses(turned):
    run = turned.runs["bang-bang"]
    env = TurningVectorEnv(1, autoreset_mode="Disabled")
    alone = rollout(env, REFERENCE_POLICIES[TURNING]["bang-bang"](env), seed=4)
    each = responses(alone, tolerance=env.task.config.tolerance)
    assert run.metrics["return"][1] == pytest.approx(float(alone.returns[0]), rel=1e-6)
    assert run.metrics["settling_time_s"][1] == pytest.approx(np.nanmean(each["settling_time"]))
    assert run.metrics["worst_overshoot_deg"][1] == pytest.approx(np.degrees(each["overshoot"].max()))
    assert run.metrics["success_rate"][1] == alone.success[0]
    assert run.metrics["flow_overshoot_share"][1] == pytest.approx(each["flow_overshoot"].mean(), rel=1e-6)
    assert run.film.shape == (501, len(env.task.render_channels))
    # one second after each target was set; the last one need not have stood for the two seconds that are kept
    error = np.degrees(np.abs(alone.target[:, 0].astype(np.float64) - alone.joint_angle[:, 0]))
    starts = [0, *(1 + np.flatnonzero(np.diff(alone.target[:, 0])))]
    later = [error[start + 50] for start in starts if start + 100 < len(error)]
    assert len(later) > 1
    assert run.errors[1, 50] == pytest.approx(np.mean(later))
    assert run.errors.shape == (2, 100)


def test_returns_are_of_the_rewards_that_were_asked_for(turned):
    made = REFERENCE_POLICIES[TURNING]["bang-bang"]
    others = dict.fromkeys(("precision", "overshoot", "flow_oscillation", "signal_change"), 0.0)
    found = evaluate(TURNING, {"bang-bang": made}, episodes=2, seed=3, reward_terms={"tracking": 2.0, **others})
    metrics, before = found.runs["bang-bang"].metrics, turned.runs["bang-bang"].metrics
    np.testing.assert_array_equal(metrics["settling_time_s"], before["settling_time_s"])
    assert np.all(metrics["return"] > before["return"])
    assert np.all(metrics["return"] <= 1000.0)


def test_interval_of_a_rate_is_clopper_pearson():
    values = np.array([1.0] * 7 + [0.0] * 3)
    found = interval(values, rate=True)
    assert found.mean == pytest.approx(0.7)
    assert found.low95 == pytest.approx(beta.ppf(0.025, 7, 4))
    assert found.high95 == pytest.approx(beta.ppf(0.975, 8, 3))
    assert interval(np.ones(5), rate=True).high95 == 1.0


def test_interval_of_a_mean_is_that_of_many_draws():
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    found = interval(values)
    half = norm.ppf(0.975) * values.std() / math.sqrt(400)
    # of 9999 resamples: the 2.5 % quantile lies within 4 of its standard errors, sqrt(p q / n) / density = 0.027 deviations
    spread = 4.0 * 0.027 * values.std() / math.sqrt(400)
    assert found.mean == pytest.approx(values.mean())
    assert found.low95 == pytest.approx(values.mean() - half, abs=spread)
    assert found.high95 == pytest.approx(values.mean() + half, abs=spread)
    assert found == interval(values)
    with_gaps = interval(np.concatenate([values, [np.nan]]))
    assert with_gaps == found
    assert interval(np.array([2.0]))[0] == 2.0
    assert math.isnan(interval(np.array([2.0])).low95)
    assert math.isnan(interval(np.array([np.nan])).mean)


def test_interquartile_mean_leaves_out_what_is_not_known():
    rows = np.random.default_rng(2).normal(size=(5, 13))
    gaps = np.concatenate([rows, np.full((5, 4), np.nan)], axis=1)
    np.testing.assert_allclose(interquartile_mean(gaps), interquartile_mean(rows))


def test_interquartile_mean_leaves_the_wild_out():
    values = np.concatenate([np.arange(1.0, 9.0), [1e6, -1e6, 2e6, -2e6]])
    # the middle half of 12 are 6: 2 to 7, as two wild ones and 1 go below, two and 8 above
    assert interquartile_mean(values) == 4.5
    found = interval(np.random.default_rng(1).normal(3.0, 2.0, 400), statistic=interquartile_mean)
    # of a normal distribution its variance is 1.20 times the mean's
    assert found.high95 - found.low95 == pytest.approx(2 * norm.ppf(0.975) * 2.0 * math.sqrt(1.20 / 400), rel=0.15)


def test_stratified_interval_of_a_mean_is_that_of_its_closed_form():
    """Of strata of n_k members with the variances s_k², the mean of K stratum means has the standard error
    √(Σ s_k² / n_k) / K, whatever tells the strata apart."""
    rng, count, size = np.random.default_rng(1), 40, 4
    members = rng.normal(rng.normal(0.0, 5.0, (count, 1)), rng.uniform(0.5, 2.0, (count, 1)), (count, size))
    strata = np.repeat(np.arange(count), size)
    order = rng.permutation(members.size)
    found = stratified_interval(members.ravel()[order], strata[order])
    error = math.sqrt((members.var(axis=1, ddof=1) / size).sum()) / count
    # as above: of 9999 resamples the 2.5 % quantile lies within 4 times 0.027 standard errors; a mean of 40 times 3 draws is
    # nearly normal, its kurtosis at most that of single draws, -2, over their number
    assert found.mean == pytest.approx(members.mean())
    assert found.low95 == pytest.approx(found.mean - norm.ppf(0.975) * error, abs=4.0 * 0.027 * error)
    assert found.high95 == pytest.approx(found.mean + norm.ppf(0.975) * error, abs=4.0 * 0.027 * error)


def test_what_tells_strata_apart_adds_nothing():
    strata = np.repeat(np.arange(20), 3)
    found = stratified_interval(strata.astype(np.float64), strata)
    assert found.low95 == found.mean == found.high95 == 9.5
    whole = interval(strata.astype(np.float64))
    assert whole.high95 - whole.low95 > 1.0
    middle = stratified_interval(strata.astype(np.float64), strata, statistic=interquartile_mean)
    assert middle.low95 == middle.high95 == pytest.approx(9.5)


def test_strata_have_gaps_and_single_members():
    values = np.array([1.0, 3.0, np.nan, 7.0, np.nan])
    found = stratified_interval(values, np.array([0, 0, 1, 1, 2]))
    # of the first stratum one of two is drawn, with the single member of the second
    assert (found.low95, found.high95) == (4.0, 5.0)
    assert found.mean == pytest.approx(11.0 / 3.0)
    assert math.isnan(stratified_interval(values, np.arange(5)).low95)
    assert math.isnan(stratified_interval(values[[2, 4]], np.arange(2)).mean)


def test_repeats_ask_for_the_same_with_other_noise_and_machines(short_episodes):
    """Two episodes, three times: starts and targets as of the plain ones, other errors of the sensors."""
    seeds: list[list[int]] = []

    def drawn(machine, part):
        seeds.append(list(part))
        return machine

    policies = {"pd": policy_factory(TURNING, "proportional-derivative")}
    found = evaluate(TURNING, policies, episodes=2, repeats=3, seed=3, drawn=drawn)
    plain = evaluate(TURNING, policies, episodes=2, seed=3)
    assert seeds == [[3, 4, 5, 6, 7, 8]]
    run, alone = found.runs["pd"], plain.runs["pd"]
    # at once after a new target all are as far from it, but for where they stood at the one before: within some 1°
    np.testing.assert_allclose(run.errors[:, 0], np.tile(alone.errors[:, 0], 3), atol=1.0)
    assert abs(np.diff(alone.errors[:, 0])[0]) > 10.0
    assert len(np.unique(run.metrics["return"])) == 6
    rows = run.metrics["return"].reshape(3, 2)
    whole = found.summary["pd"]["return"]
    assert whole == interval(rows.T, statistic=np.nanmean)
    # of two episodes one is drawn twice in half of all cases
    assert (whole.low95, whole.high95) == pytest.approx(tuple(sorted(rows.mean(axis=0))))
    settling = run.metrics["settling_time_s"]
    expected = stratified_interval(settling, np.tile([0, 1], 3), statistic=interquartile_mean)
    assert found.stratified["pd"]["settling_time_s"] == expected
    assert plain.stratified == {}
    content = found.to_json()
    assert content["repeats"] == 3
    assert set(content["stratified_interquartile_means"]["pd"]) == set(found.task.decisive)
    names = [row[0] for row in evaluation_report.metric_rows(found)]
    assert "settling time, middle half, over repeats" in names


def test_repeats_of_a_drive_begin_alike():
    found = evaluate(TRACKING, {"asleep": Asleep}, episodes=2, repeats=2, seed=5, courses=[SHORT])
    run = found.runs["asleep"]
    np.testing.assert_array_equal(run.course[:2], run.course[2:])
    np.testing.assert_array_equal(run.places[:2, 0], run.places[2:, 0])
    assert not np.array_equal(run.places[0, 0], run.places[1, 0])


def test_the_pose_is_estimated_as_asked():
    """The filter's estimate is another one: who drives by it drives otherwise."""
    policies = {"stanley": REFERENCE_POLICIES[TRACKING]["stanley"]}
    found = [
        evaluate(TRACKING, policies, episodes=1, courses=[SHORT], localisation=each)
        for each in (None, "gains", "filter")
    ]
    returns = [each.runs["stanley"].metrics["return"][0] for each in found]
    assert returns[0] == returns[1] != returns[2]
    for env, localisation, message in (
        (TURNING, "filter", "env with a localisation"),
        (TRACKING, "best", "localisation is"),
    ):
        with pytest.raises(ValueError, match=message):
            evaluate(env, policies, localisation=localisation)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: policy_factory(TRACKING, "me"),
            "'me' is no policy for AORO/PathTracking-v0; choose from: pure",
        ),
        (lambda: policy_factory("AORO/Flying-v0", "me"), "env is 'AORO/Flying-v0'; choose one of"),
        (lambda: evaluate("AORO/Flying-v0", {"me": Asleep}), "env is 'AORO/Flying-v0'"),
        (lambda: evaluate(TRACKING, {"me": Asleep}, episodes=0), "episodes is 0, but must be a positive integer"),
        (lambda: evaluate(TRACKING, {"me": Asleep}, repeats=0), "repeats is 0, but must be a positive integer"),
        (lambda: evaluate(TRACKING, {}), "policies is empty"),
        (lambda: evaluate(TURNING, {"me": Asleep}, courses=[SHORT]), "turns on level ground"),
    ],
)
def test_wrong_arguments_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_report_holds_everything(found, tmp_path, monkeypatch):
    monkeypatch.setattr(films, "MOST_FRAMES", 3)
    written = evaluation_report.write_report(found, tmp_path, lead="Machine mine, as it is.")
    names = [path.name for path in written]
    assert names[:4] == ["evaluation.json", "figures.png", "errors.png", "plan_1.png"]
    assert names[4:] == ["preview.mp4", "asleep.mp4", "index.html"]
    assert all(path.stat().st_size > 0 for path in written)
    content = json.loads(written[0].read_text())
    assert (content["env"], content["episodes"], content["seed"]) == (TRACKING, 3, 5)
    metrics = content["policies"]["preview"]
    assert set(metrics["cross_track_rms_m"]) == {"mean", "low95", "high95", "episodes"}
    assert metrics["cross_track_rms_m"]["episodes"] == 3
    assert content["policies"]["asleep"]["cross_track_rms_m"]["episodes"] == 0
    assert content["ranking"] == ["preview", "asleep"]
    assert metrics["success_rate"]["high95"] == 1.0
    assert content["endings"]["preview"][END_OF_PATH]["mean"] == 1.0
    middle = content["interquartile_means"]["preview"]
    assert middle["speed_m_per_s"]["mean"] == trim_mean(found.runs["preview"].metrics["speed_m_per_s"], 0.25)
    assert "success_rate" not in middle
    page = written[-1].read_text(encoding="utf-8")
    assert page.count("data:video/mp4;base64,") == 2
    assert page.count("data:image/webp;base64,") == 3
    for row in (*evaluation_report.metric_rows(found), *evaluation_report.difference_rows(found)):
        for cell in row:
            assert str(cell).replace("'", "&#x27;") in page
    assert "two lines" in page
    assert "3 episodes a policy from seed 5. Machine mine, as it is.<" in page
    rate = next(row for row in evaluation_report.difference_rows(found) if row[0] == "success rate")
    assert rate == ["success rate", "%", '<span class="no">-100 [-100, -100] worse</span>']


@pytest.mark.parametrize(("fixture", "policy"), [("turned", "bang-bang"), ("found", "preview")])
@pytest.mark.parametrize("suffix", ["mcap", "rosbag2", "parquet"])
def test_the_first_episode_is_logged_to_the_last_digit(fixture, policy, suffix, tmp_path, request):
    result = request.getfixturevalue(fixture)
    run, channels = result.runs[policy], list(result.task.channels)
    film = {name: run.film[:, channels.index(name)].astype(np.float64) for name in channels}
    path = tmp_path / f"log.{suffix}"
    assert write_episode(result, policy, path) == [path, path.with_suffix(".toml")]
    log = read_table(path)
    np.testing.assert_allclose(log["time_s"], result.control_step * np.arange(len(run.film)), rtol=0.0, atol=1e-9)
    # the command of a row leads to the state of the next one
    np.testing.assert_array_equal(log["steering_signal"][:-1], film["steering_signal"][1:])
    np.testing.assert_array_equal(log["joint_angle_rad"], film["joint_angle"])
    np.testing.assert_allclose(np.radians(log["true_yaw_deg"]), film["yaw"], rtol=1e-15)
    if fixture == "found":
        np.testing.assert_array_equal(log["true_position_z_m"], film["z"])
        np.testing.assert_allclose(np.radians(log["true_arm_angle_rl_deg"]), film["arm_rl"], rtol=1e-15)
        assert "arm_rl" not in log  # an angle there, and no command
    else:
        np.testing.assert_array_equal(log["target_joint_angle_rad"], film["target"])
    time, shown = log_channels(path)  # as a replay shows it
    np.testing.assert_allclose(shown["position_y"], film["y"], rtol=1e-15)
    assert time[-1] == pytest.approx(result.control_step * (len(run.film) - 1))


@pytest.mark.parametrize(
    ("fixture", "policy", "size"), [("turned", "bang-bang", (720, 720)), ("found", "asleep", (720, 405))]
)
def test_film_without_moviepy_is_an_animation(fixture, policy, size, tmp_path, monkeypatch, request):
    import sys

    from PIL import Image

    result = request.getfixturevalue(fixture)
    monkeypatch.setitem(sys.modules, "moviepy", None)
    monkeypatch.setattr(films, "MOST_FRAMES", 4)
    path = films.write_film(result, result.runs[policy], tmp_path / "film")
    assert path.suffix in (".avif", ".webp")
    with Image.open(path) as film:
        assert film.size == size
        # of 5 pictures every other; an animation may hold one picture for several that are the same
        assert getattr(film, "n_frames") == 3 if fixture == "turned" else 1 <= getattr(film, "n_frames") <= 3  # noqa: B009


def test_films_are_drawn_where_arrays_live_on_a_gpu(tmp_path, monkeypatch):
    """As there, on a CPU: arrays are tensors that are brought home."""
    monkeypatch.setattr(vector, "calculates_there", lambda task, twin: True)
    monkeypatch.setattr(films, "MOST_FRAMES", 2)
    result = evaluate(TRACKING, {"asleep": Asleep}, episodes=1, seed=5, courses=[SHORT])
    assert films.write_film(result, result.runs["asleep"], tmp_path / "film").stat().st_size > 0


def test_one_episode_has_no_interval_but_of_its_rate(tmp_path, short_episodes):
    found = evaluate(TURNING, {"bang-bang": policy_factory(TURNING, "bang-bang")}, episodes=1)
    content = found.to_json()["policies"]["bang-bang"]
    assert content["return"]["low95"] is None
    rate = content[
        "success_rate"
    ]  # 1 of 1 happens in 2.5 % of all cases at a rate of 0.025; 0 of 1 is its mirror image
    ends = (0.025, 1.0) if rate["mean"] else (0.0, 0.975)
    assert (rate["low95"], rate["high95"]) == pytest.approx(ends)
    rows = {row[0]: row[2] for row in evaluation_report.metric_rows(found)}
    assert "[" not in rows["return"]
    evaluation_report.write_report(found, tmp_path, films=False)
    assert not list(tmp_path.glob("*.mp4"))


def test_drives_on_soil_have_their_ruts():
    """A metric that drives on hard ground have not; on the same paths, by the same start."""
    policies = {"preview": policy_factory(TRACKING, "preview")}
    soft = evaluate(TRACKING, policies, episodes=2, seed=5, courses=[SHORT], soil="peat")
    metrics = soft.runs["preview"].metrics
    assert (metrics["rut_depth_m"] > 0.1).all() and (metrics["success_rate"] == 1.0).all()
    assert soft.to_json()["policies"]["preview"]["rut_depth_m"]["mean"] == pytest.approx(metrics["rut_depth_m"].mean())
    hard = evaluate(TRACKING, policies, episodes=1, seed=5, courses=[SHORT])
    assert "rut_depth_m" not in hard.runs["preview"].metrics
    with pytest.raises(ValueError, match="soil is 'mud'"):
        evaluate(TRACKING, policies, episodes=1, courses=[SHORT], soil="mud")
