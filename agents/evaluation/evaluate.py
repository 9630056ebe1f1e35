"""How well policies do: the same episodes for every one of them, and figures with 95 % intervals.

>>> from aoro_gym.agents.evaluation.evaluate import evaluate
>>> from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES
>>> policies = REFERENCE_POLICIES["AORO/Turning-v0"]
>>> found = evaluate("AORO/Turning-v0", policies, episodes=4)  # doctest: +SKIP
>>> found.summary["bang-bang"]["settling_time_s"].mean  # doctest: +SKIP

Episode i has the seed ``seed`` + i whoever drives, and with it its course, its machine, its start and its noise. Figures
say their unit in their name. Who fails is not the better for it: figures that failing would flatter are those of what was
achieved (:data:`OVER`), and say over how many episodes, or are lower bounds (:data:`BOUNDED`); policies are ranked by their
success first.

Two questions have two intervals. What would other episodes give? The episodes are resampled (:func:`interval`). What would
other noise and other machines give in these episodes? With ``repeats``, each is driven several times: repeat r of episode
i asks for what the seed ``seed`` + i asks for, and ``seed`` + r ``episodes`` + i draws the sensors' errors and the machine;
repeats are resampled, within each episode alone (:func:`stratified_interval`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from scipy.stats import binomtest, bootstrap, trim_mean

from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES, Factory
from aoro_gym.agents.evaluation import inputs
from aoro_gym.agents.evaluation.episodes import Kept
from aoro_gym.agents.evaluation.responses import EPISODE_STEPS, responses, rollout
from aoro_gym.agents.policies.files import load_policy, shipped_policies
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.path_tracking.courses import Course, library
from aoro_gym.envs.path_tracking.task import PathTrackingVectorEnv
from aoro_gym.envs.turning.task import TurningVectorEnv
from aoro_gym.execution.cluster import ClusterError, Failed, connected, on_ray
from aoro_gym.machine import Machine

AT_ONCE = 64
"""Episodes that are driven together."""
SHARD = 16
"""The same on a cluster: enough jobs for many nodes."""
CONFIDENCE = 0.95
RESAMPLES = 9999
"""Of a bootstrap."""
TIME_IS_UP = "time is up"
"""Ending of an episode that was truncated."""
FIGURE = "figure "
"""Before the name of a figure in a file."""
STATION = 0.25
"""Distance [m] at which the error of a drive is kept."""
SUCCESS = "success_rate"
RATES = (SUCCESS,)
"""Figures that count episodes."""
OVER: Mapping[str, str] = {
    **dict.fromkeys(
        ("cross_track_rms_m", "cross_track_mean_m", "cross_track_p95_m", "speed_m_per_s", "energy_kJ", "duration_s"),
        "successful episodes",
    ),
    **dict.fromkeys(
        ("rise_time_s", "overshoot_deg", "worst_overshoot_deg", "flow_overshoot_share"), "targets that were reached"
    ),
}
"""What a figure is over, where it is not over everything that was driven; NaN of an episode that has nothing of it."""
BOUNDED: Mapping[str, str] = {"settling_time_s": "settled_share", "worst_tilt_deg": SUCCESS}
"""Figures that are lower bounds in an episode whose share, of the other name, is below 1: of a target that was not settled
the time that it stood counts, and of a path that was not driven to its end the part that was."""
MORE_IS_BETTER = (SUCCESS, "speed_m_per_s", "return", "settled_share", "driven_m")

Floats = NDArray[np.float64]


class Interval(NamedTuple):
    """Mean of a figure over the episodes, and where the mean of all possible episodes lies with 95 % confidence."""

    mean: float
    """Or another statistic, such as the mean of the middle half."""
    low95: float
    """NaN, as ``high95``, with fewer than two episodes; only of a rate one episode says something."""
    high95: float
    episodes: int | None = None
    """Over so many: those that have the figure."""
    bounds: int = 0
    """In so many of them it is a lower bound, and so is the mean."""


@dataclass(frozen=True)
class Episodes:
    """What one policy did in N episodes."""

    figures: Mapping[str, Floats]
    """By name, (N,); NaN where an episode has none."""
    endings: list[str]
    """(N,)"""
    course: NDArray[np.intp]
    """(N, 2) which course, and which of its paths."""
    errors: Floats
    """(N, K) magnitude of the error along the episode, at multiples of the trial's ``interval``; NaN beyond the end."""
    places: Floats
    """(N, K, 2) where the vehicle's reference point was [m]; no rows where the task is no drive."""
    film: NDArray[np.float32]
    """(T, channels) of the first episode, as a task's scene draws them."""

    def bounded(self, name: str) -> NDArray[np.bool_]:
        """Whether a figure is a lower bound, (N,)."""
        if name not in BOUNDED:
            return np.zeros(len(self.endings), dtype=bool)
        return self.figures[BOUNDED[name]] < 1.0

    def exact(self, name: str) -> Floats:
        """A figure (N,), NaN where it is a lower bound: of those no difference says anything."""
        return np.where(self.bounded(name), np.nan, self.figures[name])

    def joined(self, other: Episodes) -> Episodes:
        """These episodes, then the ``other`` ones; the film is the first one's."""
        width = max(self.errors.shape[1], other.errors.shape[1])

        def wide(values: Floats) -> Floats:
            lacking = [(0, width - n if axis == 1 else 0) for axis, n in enumerate(values.shape)]
            return np.pad(values, lacking, constant_values=np.nan)

        return Episodes(
            {name: np.concatenate([values, other.figures[name]]) for name, values in self.figures.items()},
            self.endings + other.endings,
            np.concatenate([self.course, other.course]),
            np.concatenate([wide(self.errors), wide(other.errors)]),
            np.concatenate([wide(self.places), wide(other.places)]),
            self.film,
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it by name, as a file without code can hold it."""
        figures = {FIGURE + name: values for name, values in self.figures.items()}
        endings = np.array(self.endings, dtype=np.str_)
        return figures | {
            "endings": endings, "course": self.course, "errors": self.errors, "places": self.places, "film": self.film,
        }  # fmt: skip

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Episodes:
        """What :meth:`arrays` were of."""
        figures = {name.removeprefix(FIGURE): arrays[name] for name in arrays if name.startswith(FIGURE)}
        rest = (arrays[name] for name in ("course", "errors", "places", "film"))
        return cls(figures, arrays["endings"].tolist(), *rest)


@dataclass(frozen=True)
class Trial:
    """How an environment's episodes are driven and judged."""

    make: Callable[..., Any]
    """Its vector environment."""
    drive: Callable[[Any, Policy, list[int], Callable[[float], Any]], Episodes]
    """Drives one episode each of all sub-environments, and is told whom to tell the share that is done."""
    interval: float
    """Between the columns of ``Episodes.errors``."""
    along: str
    """What they lie along, with its unit."""
    error: str
    """What they are, with its unit."""
    decisive: tuple[str, ...]
    """Figures that policies are compared by, after their success; less is better, but for the speed."""


@dataclass(frozen=True)
class Evaluation:
    """Episodes of several policies."""

    env: str
    episodes: int
    seed: int
    courses: tuple[Course, ...]
    """Where was driven; none where the task is no drive."""
    runs: Mapping[str, Episodes]
    """By policy; all episodes, then all of them once more for each further repeat."""
    machine: Machine
    control_step: float
    """[s]"""
    scene: Callable[[], Any]
    """Makes what draws ``Episodes.film``."""
    repeats: int = 1
    """How often each episode was driven."""

    @property
    def trial(self) -> Trial:
        return TRIALS[self.env]

    @property
    def summary(self) -> dict[str, dict[str, Interval]]:
        """Every figure by policy and name."""
        return {
            policy: {
                name: interval(run.figures[name], rate=True) if name in RATES else self.of(run, name)
                for name in run.figures
            }
            for policy, run in self.runs.items()
        }

    @property
    def ranking(self) -> list[str]:
        """Policies from the best to the worst: by success, then by the first decisive figure."""
        return ranked(self.summary, self.trial.decisive[0])

    def of(self, run: Episodes, name: str, statistic: Callable[..., Any] = np.nanmean) -> Interval:
        """A figure of ``run``, over the episodes that have it."""
        found = self.over_episodes(run.figures[name], statistic)
        return found._replace(bounds=int(run.bounded(name).sum()))

    def over_episodes(self, values: Floats, statistic: Callable[..., Any] = np.nanmean) -> Interval:
        """Of a figure (repeats * episodes,), as other episodes might have been driven: each resampled with its repeats."""
        return interval(values.reshape(self.repeats, self.episodes).T, statistic=statistic)

    def over_repeats(self, values: Floats, statistic: Callable[..., Any] = np.mean) -> Interval:
        """The same, as these episodes might have been driven with other noise and on other machines."""
        return stratified_interval(values, np.tile(np.arange(self.episodes), self.repeats), statistic=statistic)

    @property
    def interquartile(self) -> dict[str, dict[str, Interval]]:
        """The same for the mean of the middle half of the episodes; not of rates, of which it would be 0 or 1."""
        return {
            policy: {name: self.of(run, name, interquartile_mean) for name in run.figures if name not in RATES}
            for policy, run in self.runs.items()
        }

    @property
    def stratified(self) -> dict[str, dict[str, Interval]]:
        """The mean of the middle half of all that was driven, with its interval over repeats of these episodes: decisive
        figures by policy and name; empty where each episode was driven once."""
        if self.repeats == 1:
            return {}
        return {
            policy: {
                name: self.over_repeats(run.figures[name], interquartile_mean)._replace(
                    bounds=int(run.bounded(name).sum())
                )
                for name in self.trial.decisive
            }
            for policy, run in self.runs.items()
        }

    @property
    def endings(self) -> dict[str, dict[str, Interval]]:
        """Share of episodes by policy and ending, the most frequent ending first."""
        known = [ending for ending, _ in Counter(e for run in self.runs.values() for e in run.endings).most_common()]
        return {
            policy: {
                ending: interval(np.array([ended == ending for ended in run.endings], dtype=np.float64), rate=True)
                for ending in known
            }
            for policy, run in self.runs.items()
        }

    @property
    def differences(self) -> dict[str, dict[str, Interval]]:
        """Every figure of the other policies less that of the first one, episode by episode, over those in which both have
        it: what they share cancels."""
        first, *others = self.runs
        return {policy: self.less(policy, first, tuple(self.runs[policy].figures)) for policy in others}

    def less(self, policy: str, other: str, names: Sequence[str]) -> dict[str, Interval]:
        """Figures of ``policy`` less those of ``other``, likewise."""
        one, two = self.runs[policy], self.runs[other]
        return {name: self.over_episodes(one.exact(name) - two.exact(name)) for name in names}

    @property
    def asked(self) -> dict[str, Any]:
        """What was driven, as JSON."""
        return {
            "env": self.env,
            "episodes": self.episodes,
            "repeats": self.repeats,
            "seed": self.seed,
            "machine": self.machine.name,
            "courses": [course.name for course in self.courses],
        }

    def to_json(self) -> dict[str, Any]:
        """Content of ``evaluation.json``; None where an interval says nothing."""
        return self.asked | {
            "ranking": self.ranking,
            "over": {name: what for name, what in OVER.items() if name in next(iter(self.runs.values())).figures},
            "policies": plain(self.summary),
            "interquartile_means": plain(self.interquartile),
            "stratified_interquartile_means": plain(self.stratified),
            "endings": plain(self.endings),
            "differences": {"from": next(iter(self.runs)), "policies": plain(self.differences)},
        }


def asked_of(
    env: str,
    policies: Mapping[str, Factory],
    *,
    machine: Machine,
    courses: Sequence[Course] | None = None,
    **others: Any,
) -> dict[str, Any]:
    """What an evaluation with these arguments, see :func:`evaluate`, depends on, by name."""
    return {
        "env": env,
        "policy": {name: inputs.policy_content(policy) for name, policy in policies.items()},
        "machine": inputs.machine_values(machine),
        "terrain": inputs.grounds(courses),
        "path": inputs.paths(courses),
        **others,
    }


def policy_factory(env: str, name: str, *, trust_pickle: bool = False) -> Factory:
    """What makes the policy that is called ``name`` for an environment: a reference controller, a policy that comes with
    the package, or that of a file; see :mod:`aoro_gym.agents.policies.files`.

    Raises ValueError if there is none of this name, naming those that there are, or if the file does not hold a policy for
    this environment; OSError if there is no such file.
    """
    controllers = REFERENCE_POLICIES.get(env)
    if controllers is None:
        raise ValueError(f"{env!r} cannot be evaluated; choose one of: {', '.join(TRIALS)}")
    if name in controllers:
        return controllers[name]
    shipped = shipped_policies(env)
    if name not in shipped and not Path(name).suffix:
        known = ", ".join([*controllers, *shipped])
        raise ValueError(f"{name!r} is no policy for {env}; choose from: {known}; or give a file")
    policy = load_policy(shipped.get(name, Path(name)), trust_pickle=trust_pickle)
    if policy.environment not in ("", env):
        raise ValueError(f"{name} was trained in {policy.environment}, not in {env}")
    return policy.made_for


def evaluate(
    env: str,
    policies: Mapping[str, Factory],
    *,
    episodes: int = 32,
    repeats: int = 1,
    seed: int = 0,
    courses: Sequence[Course] | None = None,
    machine: str | Machine = "aoro",
    drawn: Callable[[Machine, Sequence[int]], Machine] = lambda machine, seeds: machine,
    device: str = "cpu",
    reward_terms: Mapping[str, Any] | None = None,
    ray: str | None = None,
    kept: Path | None = None,
    progress: Callable[[str, float], Any] | None = None,
) -> Evaluation:
    """Drive the same episodes under every policy.

    Args:
        env: Id of the environment, a key of :data:`TRIALS`.
        policies: What makes each policy for a vector environment, by a name of your choice.
        episodes: A policy.
        repeats: How often each is driven, with other noise of the sensors, and on another machine if machines are ``drawn``.
        seed: Of the first episode.
        courses: Where to drive; by default the environment's own. Not for the turning task.
        machine: Bundled name, machine file or Machine: the one that policies are made for.
        drawn: Gives the machines that are driven, one a seed, such as :mod:`aoro_gym.agents.evaluation.perturbations`
            does; by default the same.
        device: ``"cpu"`` or ``"cuda:N"``.
        reward_terms: Changes by name to what the return is made of; see :mod:`aoro_gym.envs.core.terms`.
        ray: Address of the Ray cluster to drive on, see :func:`aoro_gym.execution.cluster.connected`; here by default.
            The episodes are the same.
        kept: Folder to keep episodes in, by parts, and to read those from that were driven before; see
            :mod:`aoro_gym.agents.evaluation.episodes`.
        progress: Called with a policy's name and the share of everything that is done.

    Raises:
        ValueError: naming what is wrong.
        TwinLost: a twin was lost in the turning task.
        ClusterError: a job on the cluster failed.
    """
    if env not in TRIALS:
        raise ValueError(f"{env!r} cannot be evaluated; choose one of: {', '.join(TRIALS)}")
    if episodes < 1:
        raise ValueError(f"episodes is {episodes}, but must be at least 1")
    if repeats < 1:
        raise ValueError(f"repeats is {repeats}, but must be at least 1")
    if not policies:
        raise ValueError("policies is empty; give at least one")
    machine = machine if isinstance(machine, Machine) else Machine.load(machine)
    make = partial(
        TRIALS[env].make, courses=courses, device=device, autoreset_mode="Disabled", reward_terms=reward_terms
    )
    drive = TRIALS[env].drive if repeats == 1 else partial(_repeated, TRIALS[env].drive, seed, episodes)
    seeds = seed + np.arange(episodes * repeats)
    keeper = Kept(
        kept,
        env,
        None if courses is None else (inputs.grounds(courses), inputs.paths(courses)),
        inputs.machine_values(machine),
        device,
        None if reward_terms is None else list(reward_terms.items()),  # their sum depends on their order
        None if repeats == 1 else (seed, episodes),
    )
    if ray is None:
        arguments = {"make": make, "machine": machine, "drawn": drawn, "kept": keeper, "progress": progress}
        runs = _here(drive, policies, seeds, **arguments)
    else:
        work = partial(_shard, drive, make=make, machine=machine, drawn=drawn)
        known = {"machine": machine, "drawn": drawn, "kept": keeper}
        runs = _on_cluster(work, policies, seeds, ray=ray, device=device, progress=progress, **known)
    task = make(1, machine=machine).task
    return Evaluation(
        env,
        episodes,
        seed,
        tuple(getattr(task, "courses", ())),
        runs,
        machine,
        task.control_step,
        lambda: task.scene(machine),
        repeats,
    )


def _repeated(
    drive: Callable[..., Episodes],
    first: int,
    episodes: int,
    env: Any,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
) -> Episodes:
    """Drives what the first ``episodes`` seeds from ``first`` on ask for, again and again, with what ``seeds`` draw."""
    return drive(env, policy, seeds, tell, asked=[first + (seed - first) % episodes for seed in seeds])


def _here(
    drive: Callable[..., Episodes],
    policies: Mapping[str, Factory],
    seeds: NDArray[np.int_],
    *,
    make: Callable[..., Any],
    machine: Machine,
    drawn: Callable[[Machine, Sequence[int]], Machine],
    kept: Kept,
    progress: Callable[[str, float], Any] | None,
) -> dict[str, Episodes]:
    """Episodes by policy, part by part; environments of one size are made once."""
    runs: dict[str, Episodes] = {}
    known: Any = None
    vector: Any = None
    done = 0
    for part in _parts(seeds, AT_ONCE):
        plant = drawn(machine, part)
        files = {name: kept.file(policy, part, plant) for name, policy in policies.items()}
        before = {name: kept.find(file) for name, file in files.items()}
        if None in before.values():
            if known is None or known.num_envs != len(part):
                known = vector = make(len(part), machine=machine)
            if plant is not machine:
                vector = make(len(part), machine=plant)
        for name, policy in policies.items():

            def tell(share: float, name: str = name, done: int = done, size: int = len(part)) -> None:
                if progress is not None:
                    progress(name, (done + share * size) / (len(seeds) * len(policies)))

            arrays = before[name]
            if arrays is None:
                run = drive(vector, policy(known), part, tell)
                kept.keep(files[name], run.arrays())
            else:
                run = Episodes.of(arrays)
            runs[name] = runs[name].joined(run) if name in runs else run
            done += len(part)
    return runs


def _on_cluster(
    work: Callable[..., Episodes],
    policies: Mapping[str, Factory],
    seeds: NDArray[np.int_],
    *,
    ray: str,
    device: str,
    machine: Machine,
    drawn: Callable[[Machine, Sequence[int]], Machine],
    kept: Kept,
    progress: Callable[[str, float], Any] | None,
) -> dict[str, Episodes]:
    """The same from a cluster: what each policy does in each shard is a job.

    Raises ClusterError if one failed.
    """
    shards = _parts(seeds, SHARD)
    jobs = {f"{name}, part {k}": (policy, part) for name, policy in policies.items() for k, part in enumerate(shards)}
    plants = [drawn(machine, part) for part in shards]
    files = {job: kept.file(*jobs[job], plants[k % len(shards)]) for k, job in enumerate(jobs)}
    before = {job: kept.find(file) for job, file in files.items()}
    found = {job: Episodes.of(arrays) for job, arrays in before.items() if arrays is not None}
    with connected(ray):
        for job, run in on_ray(work, {job: jobs[job] for job in jobs if job not in found}, device=device):
            if isinstance(run, Failed):
                raise ClusterError(f"{job}: {run.reason}")
            found[job] = run
            kept.keep(files[job], run.arrays())
            if progress is not None:
                progress(job, len(found) / len(jobs))
    return {
        name: reduce(Episodes.joined, (found[f"{name}, part {k}"] for k in range(len(shards)))) for name in policies
    }


def _shard(
    drive: Callable[..., Episodes],
    policy: Factory,
    seeds: list[int],
    *,
    make: Callable[..., Any],
    machine: Machine,
    drawn: Callable[[Machine, Sequence[int]], Machine],
) -> Episodes:
    """What a policy does in a part of the episodes."""
    known = vector = make(len(seeds), machine=machine)
    plant = drawn(machine, seeds)
    if plant is not machine:
        vector = make(len(seeds), machine=plant)
    return drive(vector, policy(known), seeds)


def _parts(seeds: NDArray[np.int_], most: int) -> list[list[int]]:
    """The seeds in parts of nearly the same size: a small last one would take as long as a large one."""
    return [part.tolist() for part in np.array_split(seeds, math.ceil(len(seeds) / most))]


def interquartile_mean(values: Floats, axis: int = -1) -> Any:
    """Mean of the middle half of the values, those that are NaN left out: what a few wild episodes hardly move, and more
    exact than the median."""
    if not np.isnan(values).any():
        return trim_mean(values, 0.25, axis=axis)
    ordered = np.sort(np.moveaxis(values, axis, -1), axis=-1)  # NaN last
    count = np.isfinite(ordered).sum(axis=-1, keepdims=True)
    rank, cut = np.arange(ordered.shape[-1]), count // 4
    return np.mean(ordered, axis=-1, where=(rank >= cut) & (rank < count - cut))


def interval(values: Floats, *, rate: bool = False, statistic: Callable[..., Any] = np.mean) -> Interval:
    """Mean and 95 % interval of ``values`` (N,), those that are NaN left out.

    The interval is the percentiles' of a bootstrap over the episodes, always with the same draws; of a ``rate``, whose
    values are 0 and 1, it is the exact one of Clopper and Pearson.

    Args:
        values: One an episode, or a row (N, R) of its repeats, which are resampled together.
        rate: Whether they are 0 or 1.
        statistic: Instead of the mean, such as :func:`interquartile_mean`; not for rates.
    """
    if values.ndim == 2 and values.shape[1] > 1:
        return _of_rows(values, statistic)
    values = values[np.isfinite(values)]
    if not values.size:
        return Interval(math.nan, math.nan, math.nan, 0)
    if rate:
        low, high = binomtest(round(values.sum()), values.size).proportion_ci(CONFIDENCE)
        return Interval(float(values.mean()), float(low), float(high), values.size)
    mean = float(statistic(values))
    if values.size < 2:
        return Interval(mean, math.nan, math.nan, values.size)
    found = bootstrap(
        (values,),
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        batch=max(1, 1_000_000 // values.size),
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Interval(mean, float(found.low), float(found.high), values.size)


def _of_rows(values: Floats, statistic: Callable[..., Any]) -> Interval:
    """The same of rows (N, R), resampled whole; the statistic leaves out what is NaN."""
    known = values[np.isfinite(values)]
    if not known.size:
        return Interval(math.nan, math.nan, math.nan, 0)
    if len(values) < 2:
        return Interval(float(statistic(known)), math.nan, math.nan, known.size)

    def resampled(rng: np.random.Generator, count: int) -> Floats:
        drawn = values[rng.integers(len(values), size=(count, len(values)))].reshape(count, -1)
        return statistic(drawn[np.isfinite(drawn).any(axis=1)], axis=-1)

    return Interval(float(statistic(known)), *_percentiles(resampled, values.size), known.size)


def stratified_interval(
    values: Floats, strata: NDArray[np.intp], *, statistic: Callable[..., Any] = np.mean
) -> Interval:
    """Statistic and 95 % interval of ``values`` (N,) whose strata stay while their members might have been others; those
    that are NaN are left out.

    The interval is the percentiles' of a stratified bootstrap, always with the same draws: members are resampled within
    their stratum, so that what tells strata apart adds nothing (R. Agarwal et al., "Deep reinforcement learning at the edge
    of the statistical precipice", NeurIPS 2021). Of n members n - 1 are drawn, with which the variance of the mean of few
    is right, where n draws make it too small by the share 1 / n (J. N. K. Rao and C. F. J. Wu, "Resampling inference with
    complex survey data", J. American Statistical Association 83, 1988).

    Args:
        values: Figures.
        strata: The stratum of each (N,).
        statistic: Of all values together, such as :func:`interquartile_mean`; takes ``axis``.
    """
    known = np.isfinite(values)
    if not known.any():
        return Interval(math.nan, math.nan, math.nan, 0)
    order = np.argsort(strata[known], kind="stable")
    members = values[known][order]
    _, counts = np.unique(strata[known], return_counts=True)
    mean = float(statistic(members))
    if counts.max() < 2:
        return Interval(mean, math.nan, math.nan, members.size)
    draws = np.maximum(counts - 1, 1)
    first, size = (np.repeat(of_each, draws) for of_each in (np.cumsum(counts) - counts, counts))

    def resampled(rng: np.random.Generator, count: int) -> Floats:
        rows = first + (rng.random((count, len(first))) * size).astype(np.intp)
        return statistic(members[rows], axis=-1)

    return Interval(mean, *_percentiles(resampled, len(first)), members.size)


def _percentiles(resampled: Callable[[np.random.Generator, int], Floats], size: int) -> tuple[float, float]:
    """Ends of the interval of a statistic, of which ``resampled`` gives so many draws, each of ``size`` values: a million
    values at once."""
    rng = np.random.default_rng(0)
    parts = np.array_split(np.arange(RESAMPLES), math.ceil(RESAMPLES * size / 1_000_000))
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(np.concatenate([resampled(rng, len(part)) for part in parts]), [tail, 100.0 - tail])
    return float(low), float(high)


def ranked(figures: Mapping[str, Mapping[str, Interval]], decisive: str) -> list[str]:
    """Policies from the best to the worst by their figures: success first, then ``decisive``; who has none of it is last."""
    sign = -1.0 if decisive in MORE_IS_BETTER else 1.0

    def rank(policy: str) -> tuple[float, float]:
        value = sign * figures[policy][decisive].mean
        return -figures[policy][SUCCESS].mean, value if math.isfinite(value) else math.inf

    return sorted(figures, key=rank)


def plain(figures: Mapping[str, Mapping[str, Interval]]) -> dict[str, dict[str, dict[str, float | None]]]:
    """Figures by policy and name for JSON; None where an interval says nothing. ``episodes`` is over how many a figure is,
    and ``lower_bounds`` in how many of those it is at least so much."""
    return {policy: {name: _plain(value) for name, value in found.items()} for policy, found in figures.items()}


def _plain(value: Interval) -> dict[str, float | None]:
    numbers = {"mean": value.mean, "low95": value.low95, "high95": value.high95}
    found: dict[str, float | None] = {key: number if math.isfinite(number) else None for key, number in numbers.items()}
    if value.episodes is not None:
        found["episodes"] = value.episodes
    if value.bounds:
        found["lower_bounds"] = value.bounds
    return found


def _begun(seeds: list[int], asked: list[int] | None) -> dict[str, Any]:
    """Arguments of a reset; see :func:`drive_paths`."""
    if asked is None:
        return {"seed": seeds}
    return {"seed": asked, "options": {"sensor_seed": np.array(seeds)}}


# ---- AORO/PathTracking-v0 --------------------------------------------------------------------------------------------


def _make_tracking(num_envs: int, courses: Sequence[Course] | None, **arguments: Any) -> PathTrackingVectorEnv:
    return PathTrackingVectorEnv(num_envs, courses=library() if courses is None else courses, **arguments)


KEPT = ("s", "cross_track", "reference_x", "reference_y", "roll", "pitch")
"""Channels of a drive that its figures and plots need."""


def drive_paths(
    env: PathTrackingVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
) -> Episodes:
    """Drive every sub-environment through one episode.

    Args:
        env: Made with ``autoreset_mode="Disabled"``.
        policy: Who drives; reset first.
        seeds: One each.
        tell: Called with the share that is done.
        asked: Seeds of what is asked for, where ``seeds`` draw the sensors' errors alone.

    Raises ValueError if the environment resets by itself.
    """
    if env.autoreset_mode is not AutoresetMode.DISABLED:
        raise ValueError(f"autoreset_mode is {env.autoreset_mode.value!r}, but an evaluation needs 'Disabled'")
    n = env.num_envs
    rows = [env.task.render_channels.index(name) for name in KEPT]
    policy.reset()
    observations, infos = env.reset(**_begun(seeds, asked))
    course, whole = np.stack([infos["terrain"], infos["path"]], axis=1), infos["remaining"]
    running, returns, steps = np.ones(n, dtype=bool), np.zeros(n), np.zeros(n, dtype=np.intp)
    endings, last = [""] * n, {name: np.zeros(n) for name in ("is_success", "mean_speed", "engine_work", "remaining")}
    first = np.array(env.task.traces(), dtype=np.float32)
    kept, film = [first[rows]], [first[:, 0]]
    while running.any():
        observations, rewards, terminated, truncated, infos = env.step(policy(observations))
        returns += running * rewards
        steps += running
        traces = np.asarray(env.task.traces(), dtype=np.float32)
        kept.append(traces[rows])
        if running[0]:
            film.append(traces[:, 0].copy())
        ended = np.asarray(terminated | truncated)
        for i in np.flatnonzero(ended & running):
            endings[i] = infos["termination"][i] if terminated[i] else TIME_IS_UP
            for name, values in last.items():
                values[i] = infos[name][i]
        running &= ~ended
        tell(float(np.where(running, 1.0 - infos["remaining"] / whole, 1.0).mean()))
        if ended.any() and running.any():  # who is done drives on, unseen
            observations, _ = env.reset(options={"reset_mask": ended})
            policy.reset(ended)
    data = dict(zip(KEPT, np.array(kept, dtype=np.float64).transpose(1, 2, 0), strict=True))  # (N, 1 + T) each
    tilt = np.degrees(np.arccos(np.clip(np.cos(data["roll"]) * np.cos(data["pitch"]), -1.0, 1.0)))
    parts = [slice(1, 1 + count) for count in steps]
    error = [np.abs(data["cross_track"][i, part]) for i, part in enumerate(parts)]
    arrived = last["is_success"].astype(bool)
    figures = {
        SUCCESS: last["is_success"],
        "cross_track_rms_m": np.array([np.sqrt((e**2).mean()) for e in error]),
        "cross_track_mean_m": np.array([e.mean() for e in error]),
        "cross_track_p95_m": np.array([np.quantile(e, 0.95) for e in error]),
        "speed_m_per_s": last["mean_speed"],
        "energy_kJ": last["engine_work"] / 1e3,
        "worst_tilt_deg": np.array([tilt[i, part].max() for i, part in enumerate(parts)]),
        "driven_m": whole - last["remaining"],
        "duration_s": steps * env.task.control_step,
        "return": returns,
    }
    figures |= {name: np.where(arrived, values, np.nan) for name, values in figures.items() if name in OVER}
    stations = STATION * np.arange(1 + math.ceil(float(whole.max()) / STATION))
    errors, places = np.full((n, len(stations)), np.nan), np.full((n, len(stations), 2), np.nan)
    for i, part in enumerate(parts):
        # a vehicle may slide back: the first time that it came so far counts
        ahead = np.maximum.accumulate(data["s"][i, part]) - data["s"][i, 0]
        there = stations <= ahead[-1]
        when = np.searchsorted(ahead, stations[there])
        errors[i, there] = error[i][when]
        for axis, name in enumerate(("reference_x", "reference_y")):
            places[i, there, axis] = data[name][i, part][when]
    return Episodes(figures, endings, course, errors, places, np.array(film))


# ---- AORO/Turning-v0 -------------------------------------------------------------------------------------------------


def _make_turning(num_envs: int, courses: Sequence[Course] | None, **arguments: Any) -> TurningVectorEnv:
    if courses is not None:
        raise ValueError("courses are for AORO/PathTracking-v0; AORO/Turning-v0 turns on level ground")
    return TurningVectorEnv(num_envs, **arguments)


RESPONSE = 2.0
"""Time [s] after a new target over which the error is kept: every target is held for as long."""


def turn_joints(
    env: TurningVectorEnv,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
    *,
    asked: list[int] | None = None,
) -> Episodes:
    """Steer every sub-environment through one episode; the arguments are those of :func:`drive_paths`."""
    film: list[NDArray[np.float32]] = []

    def watch() -> None:
        film.append(np.array(env.task.traces()[:, 0], dtype=np.float32))
        tell((len(film) - 1) / EPISODE_STEPS)

    run = rollout(env, policy, **_begun(seeds, asked), watch=watch)
    found = responses(run, tolerance=env.task.config.tolerance)
    mine = [found["episode"] == i for i in range(env.num_envs)]

    def mean(values: NDArray[Any]) -> Floats:
        return np.array([_mean(values[rows]) for rows in mine])

    settled = np.isfinite(found["settling_time"])
    figures = {
        SUCCESS: run.success.astype(np.float64),
        "settling_time_s": mean(np.where(settled, found["settling_time"], found["held"])),
        "settled_share": mean(settled * 1.0),
        "rise_time_s": mean(found["rise_time"]),
        "overshoot_deg": mean(np.degrees(found["overshoot"])),
        "worst_overshoot_deg": np.array([_worst(np.degrees(found["overshoot"][rows])) for rows in mine]),
        "flow_overshoot_share": mean(found["flow_overshoot"]),
        "final_error_deg": mean(np.degrees(found["final_error"])),
        "return": run.returns,
    }
    error = np.degrees(np.abs(run.target.astype(np.float64) - run.joint_angle))
    fresh = np.diff(run.target, axis=0, prepend=np.nan) != 0.0
    count = round(RESPONSE / run.control_step)
    # the mean over the targets of an episode that stood so long
    errors = np.array(
        [
            np.mean(
                [error[start : start + count, i] for start in np.flatnonzero(fresh[: len(error) - count, i])], axis=0
            )
            for i in range(env.num_envs)
        ]
    )
    return Episodes(
        figures,
        [TIME_IS_UP] * env.num_envs,
        np.zeros((env.num_envs, 2), dtype=np.intp),
        errors,
        np.zeros((env.num_envs, 0, 2)),
        np.array(film),
    )


def _worst(values: Floats) -> float:
    """The largest of those that are not NaN; NaN if all are."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else math.nan


def _mean(values: Floats) -> float:
    """Of those that are not NaN; NaN if all are."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else math.nan


TRIALS: Mapping[str, Trial] = {
    "AORO/Turning-v0": Trial(
        _make_turning,
        turn_joints,
        0.02,
        "time since the target was set [s]",
        "distance from the target [°]",
        ("settling_time_s", "flow_overshoot_share", "overshoot_deg"),
    ),
    "AORO/PathTracking-v0": Trial(
        _make_tracking,
        drive_paths,
        STATION,
        "distance driven along the path [m]",
        "cross-track error [m]",
        ("cross_track_rms_m", "speed_m_per_s"),
    ),
}
"""What can be evaluated, by the environment's id."""
