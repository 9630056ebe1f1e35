"""What the plants of a plan's cases do: the logs that a user gets, and exactly what has changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from aoro_gym.diagnosis_benchmark.judge.features import CHANNEL_SETS, Floats, features, means, paired, windows
from aoro_gym.diagnosis_benchmark.judge.library import Library
from aoro_gym.diagnosis_benchmark.judge.plants import Log, Plants
from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase, Plan
from aoro_gym.diagnosis_benchmark.judge.verdicts import Reference, Verdict, judge


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

    def judge(self, reference: Reference, manoeuvres: Sequence[str], case: JudgedCase, channel_set: str) -> Verdict:
        """The judge's verdict by a reference of other families."""
        sets = [self.change, *(self.without[effect] for effect in case.effects if self.without)]
        whole, *others = (features([one[name] for name in manoeuvres], CHANNEL_SETS[channel_set]) for one in sets)
        return judge(reference, whole, list(case.effects), others)


def observe(plan: Plan, plants: Plants, cases: Sequence[JudgedCase] | None = None) -> dict[str, Observed]:
    """Simulate cases of one family together, with noise and exactly: all of the plan's by default."""
    cases = [case for case in plan.cases if case.family == plants.name] if cases is None else cases
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


def judge_cases(
    plan: Plan, seen: Mapping[str, Observed], libraries: Sequence[Library]
) -> dict[str, dict[str, Verdict]]:
    """Verdicts by channel set and case, each by the libraries of all families but its plant's."""
    found: dict[str, dict[str, Verdict]] = {channel_set: {} for channel_set in CHANNEL_SETS}
    groups: dict[tuple[str, int], list[JudgedCase]] = {}
    for case in plan.cases:
        groups.setdefault((case.family, case.protocol), []).append(case)
    for (family, protocol), cases in groups.items():
        others = [one for one in libraries if one.family != family]
        manoeuvres = plan.protocols[protocol]
        for channel_set, verdicts in found.items():
            reference = Reference.of(others, manoeuvres, channel_set)
            for case in cases:
                verdicts[case.name] = seen[case.name].judge(reference, manoeuvres, case, channel_set)
    return found
