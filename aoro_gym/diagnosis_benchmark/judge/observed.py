"""What the plants of a plan's cases do: the logs that a user gets, and exactly what has changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from aoro_gym.diagnosis_benchmark.judge.features import Floats, means, paired, windows
from aoro_gym.diagnosis_benchmark.judge.plants import Log, Plants
from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase, Plan


@dataclass(frozen=True)
class Observed:
    """A case's logs and changes.

    Attributes:
        healthy: Log of each manoeuvre on the machine's healthy day.
        logs: On the later day.
        change: Exact difference (channels, means) of the days by manoeuvre.
        without: The same without one effect each, of cases with two.
    """

    healthy: Mapping[str, Log]
    logs: Mapping[str, Log]
    change: Mapping[str, Floats]
    without: Mapping[str, Mapping[str, Floats]]


def observe(plan: Plan, plants: Plants, cases: Sequence[JudgedCase]) -> dict[str, Observed]:
    """Simulate cases of one family together, with noise and exactly."""
    machines = {number: plan.machine(plants, number) for number in {case.machine for case in cases}}
    runs = [plan.runs(case, plants, machines[case.machine]) for case in cases]
    noisy = iter(plants.record([r for each in runs for r in each["healthy"] + each["logs"]], exact=False))
    exact = iter(plants.record([r for each in runs for group in each.values() for r in group], exact=True))
    found = {}
    for case, each in zip(cases, runs, strict=True):
        names = plan.protocols[case.protocol]
        shown = {purpose: {name: next(noisy) for name in names} for purpose in ("healthy", "logs")}
        true = {purpose: {name: next(exact) for name in names} for purpose in each}
        changes = {p: changed(plan, true["healthy"], true[p]) for p in each if p != "healthy"}
        found[case.name] = Observed(
            shown["healthy"],
            shown["logs"],
            changes.pop("logs"),
            {purpose.removeprefix("without "): change for purpose, change in changes.items()},
        )
    return found


def changed(plan: Plan, healthy: Mapping[str, Log], later: Mapping[str, Log]) -> dict[str, Floats]:
    """Differences (channels, means) of two days' logs by manoeuvre."""
    differences = {}
    for name, log in healthy.items():
        weights = windows(plan.excitations[name].steering, plan.excitations[name].drive)
        differences[name] = paired(means([later[name]], weights), means([log], weights))[0]
    return differences
