"""From recordings to a diagnosis: where machine and twin part, why, by how much, and what to record next.

Two questions, one path. *Commissioned*: healthy recordings of the machine exist, and the question is what has changed since.
*Day one*: none exist, and the question is what the machine does otherwise than any of its kind. Networks that were trained
on simulated machines weigh every cause (:mod:`.network`), what they say is held against cases with a known truth
(:mod:`.network.decision`), and the causes that may be are fitted to the recordings (:mod:`.fits`), which says how far the
gap shrinks, but overrules no name. Sizes are the networks': on plants of other laws their intervals hold more often.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from aoro_gym.diagnosis.credible import credible
from aoro_gym.diagnosis.figures import key_figures
from aoro_gym.diagnosis.fits import Fits, fit
from aoro_gym.diagnosis.network.cases import BEGIN, Case, Posterior, case_of, posterior
from aoro_gym.diagnosis.network.decision import Calibration, Decision, decide, sensor_set, shipped
from aoro_gym.diagnosis.network.features import SAMPLES
from aoro_gym.diagnosis.network.forward import Weights, trained
from aoro_gym.diagnosis.network.shape import QUANTILES
from aoro_gym.diagnosis.next_experiments import next_experiments
from aoro_gym.diagnosis.recording import CHANNELS, SENSORS, TICK, Recording, logs_in, read_recording
from aoro_gym.diagnosis.replay import Simulator
from aoro_gym.diagnosis.result import Cause, CredibleInterval, Diagnosis, Experiment
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.machine import Machine

Progress = Callable[[str, float], object]
"""Takes a sentence and the share done."""

READ = CHANNELS[:4]
"""Channels that networks take."""
LISTED = 0.01
"""Probability below which a hypothesis is not listed."""
FITTED = 4
"""Causes that are fitted at most, the likeliest."""
MEDIAN = QUANTILES.index(0.5)
SPAN = TICK * (SAMPLES - BEGIN)
"""Time [s] from the first command on that networks see of a log."""


@dataclass(frozen=True)
class Logs:
    """Recordings by what they are for: to be explained, healthy, and held out of all fits."""

    later: Sequence[Recording]
    healthy: Sequence[Recording]
    held_out: Sequence[Recording]

    @property
    def every(self) -> list[Recording]:
        return [*self.healthy, *self.later, *self.held_out]

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that all of them have."""
        return tuple(name for name in READ if all(name in one.channels for one in self.every))


@dataclass(frozen=True)
class Asked:
    """What networks were shown and said, and what follows."""

    case: Case
    posterior: Posterior
    decision: Decision


def diagnose(
    recordings: Sequence[Recording],
    machine: Machine | str | Path = "aoro",
    *,
    healthy: Sequence[Recording] = (),
    held_out: Sequence[Recording] = (),
    networks: Sequence[Weights] | None = None,
    calibrations: Mapping[str, Calibration] | None = None,
    simulator: Simulator | None = None,
    out: Path | None = None,
    progress: Progress = lambda sentence, share: None,
) -> Diagnosis:
    """Why ``recordings`` of a machine and its twin part. Those that no such machine can have made are left out
    (:mod:`.credible`); where none is left, the verdict is inconclusive.

    Args:
        recordings: To be explained (:func:`~aoro_gym.diagnosis.recording.read_recording`).
        machine: The twin; any machine file of the kind serves.
        healthy: Of the same machine while nothing was wrong; best of the same commands. Further ones of a command show what
            changes by itself.
        held_out: Neither asked of nor fitted to; how far the gap shrinks is asked of them. By default every recording is
            left out once in turn of the fit of a cause.
        networks: That weigh causes; those of the package by default.
        calibrations: Theirs, by set of sensors.
        simulator: Where twins run; on the CPU by default.
        out: Folder for the machine files of the causes; none are written without it.
        progress: Called with a sentence and the share done.

    Raises:
        ValueError: there is no recording.
    """
    began = time.monotonic()
    if not recordings:
        raise ValueError("no recording given; name at least one log")
    twin = machine if isinstance(machine, Machine) else Machine.load(machine)
    simulator = simulator or Simulator()
    given = Logs(recordings, healthy, held_out)
    kept, doubts = credible((recordings, healthy, held_out), twin, simulator)
    logs = Logs(*([_only(one, READ) for one in group] for group in kept))
    if not logs.later or (healthy and not logs.healthy):
        doubts.append(f"No {'healthy ' if logs.later else ''}log is left, and nothing was diagnosed.")
        return replace(_unread(twin, given, doubts), seconds=time.monotonic() - began)
    progress("causes weighed", 0.1)
    networks = trained() if networks is None else networks
    asked = _asked(logs, networks, calibrations or shipped())
    following = "" if asked.decision.verdict == "no_gap" else "; sizes are fitted"
    progress(f"first finding: {first_finding(asked.decision)}{following}", 0.2)
    fits = _fitted(asked, logs, twin, networks, simulator, out)
    progress("what to record next", 0.7)
    tests = _tests(asked, logs, twin, networks, simulator)
    found = _concluded(asked, fits, logs, twin, tests)
    return replace(
        found, limitations=(*doubts, *_limitations(given, logs, asked.case)), seconds=time.monotonic() - began
    )


def diagnose_case(place: Path, out: Path, *, sensors: str, device: str) -> Diagnosis:
    """Diagnose a case of the blind check: ``machine.toml``, ``logs/*.csv`` and, if there, ``healthy/*.csv`` in ``place``;
    writes ``diagnosis.json`` to ``out``."""
    recordings, healthy = (
        [_only(read_recording(path), SENSORS[sensors]) for path in logs_in(place / purpose)]
        for purpose in ("logs", "healthy")
    )
    found = diagnose(recordings, place / "machine.toml", healthy=healthy, simulator=Simulator(device))
    found.save(out)
    return found


def _only(recording: Recording, channels: Sequence[str]) -> Recording:
    return replace(
        recording, channels={name: values for name, values in recording.channels.items() if name in channels}
    )


def _asked(logs: Logs, networks: Sequence[Weights], calibrations: Mapping[str, Calibration]) -> Asked:
    case = case_of(logs.later, logs.healthy)
    calibration = calibrations[sensor_set(logs.channels)]
    said = posterior(networks, case).widened(calibration.widening)
    return Asked(case, said, decide(said.probabilities, calibration))


def first_finding(decision: Decision) -> str:
    """The verdict in a few words."""
    effects, share = decision.hypotheses[0]
    named = " and ".join(name.replace("_", " ") for name in effects) or "nothing wrong"
    return f"{named} ({100.0 * share:.0f} %)"


def _fitted(
    asked: Asked, logs: Logs, twin: Machine, networks: Sequence[Weights], simulator: Simulator, out: Path | None
) -> Fits:
    """Fits of the causes that may be: of those that are listed, the likeliest that the declared set holds, and the first
    that it does not, which the others are held against. None where nothing is wrong."""
    decision = asked.decision
    if decision.verdict == "no_gap":
        return Fits((), (), None)
    named = [effects for effects, share in decision.hypotheses if effects and set(effects) <= set(IDS)]
    within = [one for one in named if set(one) <= set(decision.declared)][:FITTED]
    others = [one for one in named if within and len(one) == len(within[0]) and not set(one) & set(within[0])][:1]
    without = []
    if within and len(logs.later) > 1 and not logs.held_out:
        rest = [[one for one in logs.later if one is not left] for left in logs.later]
        without = [sizes_of(posterior(networks, case_of(those, logs.healthy))) for those in rest]
    return fit(
        twin, logs.later, logs.healthy, [*within, *(one for one in others if one not in within)], held_out=logs.held_out,
        quantiles=sizes_of(asked.posterior), quantiles_without=without, simulator=simulator, out=out,
    )  # fmt: skip


def sizes_of(said: Posterior) -> dict[str, tuple[float, ...]]:
    """Quantiles of the change of every effect's first operational magnitude [SI], by id."""
    return {name: tuple(values.tolist()) for name, values in zip(IDS, said.quantiles, strict=True)}


def _tests(
    asked: Asked, logs: Logs, twin: Machine, networks: Sequence[Weights], simulator: Simulator
) -> tuple[Experiment, ...]:
    """What to record next; nothing where nothing is wrong."""
    if asked.decision.verdict == "no_gap":
        return ()
    return next_experiments(logs.later, logs.healthy, twin, networks, asked.posterior, simulator=simulator)


def _concluded(asked: Asked, fits: Fits, logs: Logs, twin: Machine, tests: tuple[Experiment, ...]) -> Diagnosis:
    """What follows from the networks' decision and the fits."""
    decision = asked.decision
    first = next((one for one in fits.causes if one.effects == decision.hypotheses[0][0]), None)
    components = components_of(decision)
    blamed = next(iter(components), "") if decision.verdict in ("cause", "ambiguous") else ""
    return replace(
        _of_logs(twin, logs, decision.verdict),
        where=tuple(replace(place, component=blamed) for place in fits.places),
        where_p=decision.null_p,
        components=components,
        causes=_causes(asked, fits),
        declared_set=decision.declared,
        shrinkage=() if first is None else first.shrinkage,
        controls={} if first is None else fits.controls(first.effects),
        key_figures={} if first is None else key_figures(logs.later, first.curves, twin),
        next_experiments=tests,
        alike=alike_causes(decision),
        curves=() if first is None else first.curves,
    )


def _causes(asked: Asked, fits: Fits) -> tuple[Cause, ...]:
    """Hypotheses worth listing, with the sizes that networks say of those that were fitted, and of a second operational
    magnitude what the fit says."""
    fitted = {one.effects: one for one in fits.causes}
    said = sizes_of(asked.posterior)
    found = []
    for place, (effects, share) in enumerate(asked.decision.hypotheses):
        if effects in fitted:
            cause = fitted[effects].cause(share)
            sizes = {name: (interval_of(name, said[name]), *parts[1:]) for name, parts in cause.magnitudes.items()}
            found.append(replace(cause, magnitudes=sizes))
        elif share >= LISTED or not place:
            parts = dict.fromkeys(EFFECTS[name].component for name in effects if name in EFFECTS)
            found.append(Cause(effects, share, components=tuple(parts)))
    return tuple(found)


def interval_of(name: str, quantiles: Sequence[float]) -> CredibleInterval:
    """Of an effect's first operational magnitude, from its quantiles [SI]."""
    of = EFFECTS[name].operational[0]
    return CredibleInterval(quantiles[MEDIAN], quantiles[0], quantiles[-1], of.unit, of.quantity)


def components_of(decision: Decision) -> dict[str, float]:
    """Probability that a cause lies in a component, the largest first."""
    found: dict[str, float] = {}
    for effects, share in decision.hypotheses:
        for component in {EFFECTS[name].component for name in effects if name in EFFECTS}:
            found[component] = found.get(component, 0.0) + share
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def alike_causes(decision: Decision) -> tuple[tuple[str, str], ...]:
    """Pairs of effects that these logs cannot tell apart: single causes of the declared set, where a gap is said."""
    if decision.verdict == "no_gap":
        return ()
    single = {effects[0] for effects, share in decision.hypotheses if len(effects) == 1 and share >= LISTED}
    names = [name for name in decision.declared if name in single]
    return tuple((one, other) for k, one in enumerate(names) for other in names[k + 1 :])


# ---- recordings ----


def _unread(twin: Machine, logs: Logs, doubts: Sequence[str]) -> Diagnosis:
    """Of recordings that cannot be believed."""
    said = (*doubts, *(sentence for one in logs.every for sentence in one.limitations))
    return replace(_of_logs(twin, logs, "inconclusive"), limitations=said)


def _of_logs(twin: Machine, logs: Logs, verdict: str) -> Diagnosis:
    """What was compared, and the verdict; no more yet."""
    return Diagnosis(
        machine=twin.name,
        mode="commissioned" if logs.healthy else "day-one",
        logs=tuple(one.name for one in logs.later),
        healthy=tuple(one.name for one in logs.healthy),
        signals=logs.channels,
        verdict=verdict,
    )


def _limitations(given: Logs, logs: Logs, case: Case) -> tuple[str, ...]:
    """What these recordings cannot say."""
    found = [sentence for one in given.every for sentence in one.limitations]
    unused = dict.fromkeys(name for one in given.every for name in one.channels if name not in logs.channels)
    if unused:
        found.append(f"Not in all logs, or not what causes are weighed by: {', '.join(unused)}.")
    if not given.healthy:
        found.append(
            "No healthy recordings: what this machine does otherwise than others of its kind cannot be told from an effect."
        )
    elif not any(before and after for before, after in case.names):
        found.append("No healthy recording has the commands of these: the two days could not be compared directly.")
    if not any("pressure" in name for name in logs.channels):
        found.append("Only the joint angle was logged: effects that mainly show in pressures stay hidden.")
    longer = [one.name for one in logs.later if _told_after(one, SPAN)]
    if longer:
        found.append(
            f"Causes are weighed by the {SPAN:.1f} s from the first command on; later ones were not: {', '.join(longer)}."
        )
    hidden = [name for name, effect in EFFECTS.items() if effect.hidden]
    if hidden and not any(np.any(one.commands[:, 1]) for one in logs.later):
        found.append(f"Standing turns do not show {', '.join(hidden)}, or hardly.")
    return tuple(dict.fromkeys(found))


def _told_after(recording: Recording, time: float) -> bool:
    """Whether a command changes more than ``time`` [s] after the first one."""
    changes = np.flatnonzero(np.any(np.diff(recording.commands, axis=0) != 0.0, axis=1))
    return bool(len(changes)) and TICK * float(changes[-1] - changes[0]) > time
