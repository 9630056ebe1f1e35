"""A whole benchmark: what is asked for, timed in one run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from aoro_gym.agents.training.plan import TRAINERS
from aoro_gym.benchmark import peers
from aoro_gym.benchmark.ceiling import beside, counted, measure_ceiling
from aoro_gym.benchmark.environments import ENVIRONMENT, OUTPUTS, environments
from aoro_gym.benchmark.newton import newton
from aoro_gym.benchmark.ratios import ratios
from aoro_gym.benchmark.scene import GROUNDS
from aoro_gym.benchmark.startup import time_startup
from aoro_gym.benchmark.timing import Subject, computer, measure
from aoro_gym.benchmark.trainings import trainings
from aoro_gym.benchmark.twins import twins
from aoro_gym.checks import check_choice, check_integer, check_range
from aoro_gym.envs.registration import ENVIRONMENTS
from aoro_gym.execution.device_names import ALL_GPUS, SIMD, on_cpu
from aoro_gym.execution.devices import several
from aoro_gym.machine import Machine
from aoro_gym.reporting import terminal
from aoro_gym.twin.recorded import cores

WHAT = ("twin", "env", "train")
_PACKAGES = {
    "mujoco": ("mujoco",),
    "mujoco_warp": ("mujoco", "mujoco_warp"),
    "newton": ("mujoco", "mujoco_warp", "newton"),
}
MOST_TWINS = 1_000_000
"""Most twins at once; more need more memory than one device has."""


@dataclass(frozen=True)
class Plan:
    """What to time. Raises ``ValueError`` naming the option, its value and its bound."""

    twins: tuple[int, ...] = (1, 64, 4096)
    """Numbers of twins, or of sub-environments, that step together."""
    what: tuple[str, ...] = ("twin",)
    """Some of :data:`WHAT`."""
    env: str = ENVIRONMENT
    """Which environment steps, and is learned in."""
    trainers: tuple[str, ...] = ("sb3",)
    """Who learns: some of :data:`aoro_gym.agents.training.plan.TRAINERS`."""
    ground: str = "plane"
    """One of :data:`GROUNDS`."""
    randomise: bool = False
    """Whether every twin has a machine of its own."""
    output: str = "numpy"
    """Where environments take actions and give observations, one of :data:`OUTPUTS`."""
    device: str = "cpu"
    """Several, with commas between them, or ``"cuda:all"``, share the twins."""
    threads: tuple[int, ...] = ()
    """Numbers of CPU threads; one, and all cores, by default."""
    peers: tuple[str, ...] = ()
    """Some of :data:`aoro_gym.benchmark.peers.WORLDS`."""
    worlds: tuple[int, ...] = ()
    """Batches of the peers; by default those of :data:`aoro_gym.benchmark.peers.WORLDS`."""
    startup: bool = False
    """Whether to time fresh processes, too."""
    seconds: float = 5.0
    """To measure for, each case."""
    seed: int = 0

    def __post_init__(self) -> None:
        cpu = on_cpu(self.device)
        for name, known in (("what", WHAT), ("trainers", tuple(TRAINERS)), ("peers", tuple(peers.WORLDS))):
            for value in getattr(self, name):
                check_choice(name, value, known)
        for name, known in (("ground", GROUNDS), ("env", tuple(ENVIRONMENTS)), ("output", OUTPUTS)):
            check_choice(name, getattr(self, name), known)
        for name, most in (("twins", MOST_TWINS), ("worlds", MOST_TWINS), ("threads", cores())):
            for count in getattr(self, name):
                check_integer(name, count, le=most)
        if self.threads and not cpu:
            raise ValueError(f"threads is {self.threads}, but {self.device} needs none; drop it, or take device cpu")
        if self.shared and (self.what != ("twin",) or self.peers or self.startup):
            raise ValueError(f"device is {self.device}, but twins alone are timed on several devices; name one")
        check_range("seconds", self.seconds, "s", gt=0.0, le=600.0)
        if not self.twins or not self.what:
            raise ValueError("there is nothing to time; give twins and what")
        if self.env != ENVIRONMENT and self.ground != "plane" and {"env", "train"} & set(self.what):
            raise ValueError(f"ground is {self.ground!r}, but {self.env} is timed on the plane; drop one of the two")
        if "train" in self.what:
            from aoro_gym.agents.training.learner import versions

            for trainer in self.trainers:
                versions(trainer)  # all is there
        for peer in self.peers:
            if cpu and peer != "mujoco":
                raise ValueError(f"peer {peer} is timed on a GPU, but the device is {self.device}; take cuda:0")
            if peer not in self.skipped:
                for package in _PACKAGES[peer]:
                    peers.package(package)

    @property
    def skipped(self) -> dict[str, str]:
        """Peers that are not timed here, each with the reason."""
        return peers.skipped(self.peers)

    @property
    def shared(self) -> bool:
        """Whether several devices share the twins."""
        return ("," in self.device or self.device == ALL_GPUS) and len(several(self.device)) > 1

    @property
    def thread_counts(self) -> tuple[int | None, ...]:
        """Numbers of threads to sweep; a GPU has None."""
        if not on_cpu(self.device):
            return (None,)
        return self.threads or tuple(dict.fromkeys((1, cores())))


def run(
    plan: Plan,
    machine: Machine,
    progress: Callable[[str, float], Any] | None = None,
    save: Callable[[dict[str, Any]], Any] | None = None,
) -> dict[str, Any]:
    """Time all that ``plan`` asks for of copies of ``machine``.

    Args:
        plan: What to time.
        machine: One machine.
        progress: Called with what is happening and the share in [0, 1] of it that is done.
        save: Called after every timed run with the benchmark file as far as it goes, and when all is done.

    Raises:
        SimulationDiverged: a twin's state stopped being finite.

    Returns:
        The benchmark file: ``machine`` (the computer, with its ``ceiling``), ``cases``, ``peers``, ``ratios``, where peers
        are left out ``skipped`` and, if asked for, ``startup``.
    """
    cases, others = _cases(plan), _others(plan)
    preparing, timing, starting = _parts(progress, plan.startup)
    subjects = []
    for index, (make, options) in enumerate([*cases, *others]):
        copies = options.get("count", options.get("worlds"))
        preparing(f"preparing {copies} x {make.__name__}", index / (len(cases) + len(others)))
        subjects.append(make(**options, machine=machine, ground=plan.ground, seed=plan.seed))
    on = computer(plan.device)
    ceiling = None
    is_counted = plan.ground in counted() and machine.laws.default and plan.device != SIMD
    is_counted = is_counted and not plan.shared
    if "twin" in plan.what and is_counted:
        preparing("measuring the computer's ceiling", 1.0)
        ceiling = measure_ceiling(plan.device)
        on["ceiling"] = asdict(ceiling)

    def gathered(rows: list[dict[str, Any]]) -> dict[str, Any]:
        timed, compared = rows[: len(cases)], rows[len(cases) :]
        if ceiling is not None:
            timed = [case | beside(case, ceiling) if case["what"] == "twin" else case for case in timed]
        found = {"machine": on, "cases": timed, "peers": compared, "ratios": ratios(timed, compared)}
        return found | ({"skipped": plan.skipped} if plan.skipped else {})

    def keep(rows: list[dict[str, Any]]) -> None:
        if save is not None:
            save(gathered(rows))

    result = gathered(measure(subjects, seconds=plan.seconds, progress=timing, save=keep))
    if plan.startup:
        result["startup"] = time_startup(plan.device, plan.ground, starting)
        if save is not None:
            save(result)
    return result


def _parts(progress: Callable[[str, float], Any] | None, startup: bool) -> tuple[terminal.Tell, ...]:
    """Whom to tell of preparing, timing and starts: each is a part of the whole, by about the time that it takes."""
    tell = progress if progress is not None else lambda what, share, detail="": None
    ends = (0.0, 0.2, 0.8 if startup else 1.0, 1.0)
    return tuple(terminal.within(lambda what, share, detail: tell(what, share), *part) for part in pairwise(ends))


Made = tuple[Callable[..., Subject], dict[str, Any]]
"""What makes a subject, and with what."""


def _cases(plan: Plan) -> list[Made]:
    made: list[Made] = []
    for count in plan.twins:
        for threads in plan.thread_counts:
            if threads is not None and threads > count and threads != plan.thread_counts[0]:
                continue  # as many threads as twins at most: it would be timed twice
            options = {"count": count, "randomise": plan.randomise, "device": plan.device, "threads": threads}
            if "twin" in plan.what:
                made.append((twins, options))
            if "env" in plan.what:
                made.append((environments, options | {"output": plan.output, "environment": plan.env}))
            if "train" in plan.what:
                learning = {"count": count, "device": plan.device, "threads": threads, "environment": plan.env}
                made += [(trainings, learning | {"trainer": trainer}) for trainer in plan.trainers]
    return made


def _others(plan: Plan) -> list[Made]:
    made: list[Made] = []
    for peer in (one for one in plan.peers if one not in plan.skipped):
        for worlds in plan.worlds or peers.WORLDS[peer]:
            if peer != "mujoco":
                make = newton if peer == "newton" else peers.mujoco_warp
                made.append((make, {"worlds": worlds, "device": plan.device}))
                continue
            threads = plan.threads or tuple(dict.fromkeys((1, cores())))
            made += [(peers.mujoco, {"worlds": worlds, "threads": n}) for n in threads if n == 1 or n <= worlds]
    return made
