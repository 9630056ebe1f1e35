"""Policies on the Hugging Face Hub, each with a model card; or in a folder that holds what would be uploaded."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.execution.files import read_json, written_whole
from aoro_gym.version import VERSION

NAME = "policy.json"
"""Of a policy in a repository; its numbers stand beside it, in ``policy.safetensors``."""
CARD = "README.md"
EVALUATIONS = "evaluations.json"
"""What 'aoro-gym train' found of a policy; it stands beside it."""
FILES = (NAME, "policy.safetensors", CARD)


def is_folder(place: str) -> bool:
    """Whether a place is a folder of this computer, and no repository OWNER/NAME of the Hub."""
    return place.startswith((".", "/", "~")) or place.count("/") != 1


def push(file: Path, place: str, *, private: bool = False) -> str:
    """Write a policy with its card to a repository or a folder; its address.

    Args:
        file: Policy (.json with its .safetensors).
        place: ``OWNER/NAME`` of the Hub, made where there is none, or a folder, such as ``./shared``.
        private: Whether a repository that is made is private.

    Raises ValueError if the policy cannot be read or huggingface_hub is missing, OSError if it cannot be written.
    """
    policy = LearnedPolicy.load(file)
    figures = _figures(file.parent / EVALUATIONS)
    if is_folder(place):
        folder = Path(place).expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        _write(policy, figures, folder, place)
        return str(folder)
    hub = _hub()
    with tempfile.TemporaryDirectory() as made:
        _write(policy, figures, Path(made), place)
        api = hub.HfApi()
        try:
            api.create_repo(place, private=private, exist_ok=True)
            return str(api.upload_folder(repo_id=place, folder_path=made, commit_message=f"aoro-gym {VERSION}"))
        except Exception as error:  # of the network, of the account, or of the repository
            raise OSError(f"{place} takes no upload: {_said(error)}") from None


def pull(place: str, folder: Path) -> Path:
    """Fetch a policy and its card from a repository or a folder into ``folder``; the policy's file, which was read.

    Raises ValueError if what is there is no policy, OSError if it cannot be had.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if is_folder(place):
        source = Path(place).expanduser()
        LearnedPolicy.load(source / NAME)
        for name in FILES:
            if (source / name).exists() and not (folder / name).exists():
                shutil.copy(source / name, folder / name)
            elif (source / name).exists() and (source / name).resolve() != (folder / name).resolve():
                with written_whole(folder / name) as temporary:
                    shutil.copy(source / name, temporary)
    else:
        hub = _hub()
        try:
            hub.snapshot_download(place, local_dir=folder, allow_patterns=list(FILES))
        except Exception as error:  # likewise
            raise OSError(f"{place} cannot be fetched: {_said(error)}") from None
    LearnedPolicy.load(folder / NAME)
    return folder / NAME


def _hub() -> Any:
    try:
        import huggingface_hub  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise ValueError("the Hub needs huggingface_hub: pip install 'aoro-gym[hub]'") from None
    return huggingface_hub


def _said(error: Exception) -> str:
    """First line of an error of the Hub's client."""
    return next(iter(str(error).splitlines()), type(error).__name__)


def _write(policy: LearnedPolicy, figures: Mapping[str, Any], folder: Path, place: str) -> None:
    policy.save(folder / NAME)
    (folder / CARD).write_text(card(policy, figures, place), encoding="utf-8")


def _figures(file: Path) -> dict[str, Any]:
    """Figures of the evaluation of the best return that a training wrote; none without one."""
    if not file.exists():
        return {}
    found = read_json(file).get("evaluations", [])
    best = max(found, key=lambda one: one["figures"]["return"]["mean"], default=None)
    return {} if best is None else dict(best["figures"])


def _interval(figure: Mapping[str, Any]) -> str:
    """The 95 % interval of a figure; one episode has none."""
    low, high = figure.get("low95"), figure.get("high95")
    return "none" if low is None or high is None else f"{low:.4g} to {high:.4g}"


def card(policy: LearnedPolicy, figures: Mapping[str, Any], place: str) -> str:
    """A model card: what the policy is for, what it observes, how it came about, how well it does.

    Args:
        policy: Of the repository.
        figures: Mean and interval of each figure of its evaluation, by name.
        place: Of the repository.
    """
    inputs = [f"| {where.start} to {where.stop - 1} | `{name}` |" for name, where in policy.layout.items()] or [
        "| | not known |"
    ]
    rows = [
        f"| {name.replace('_', ' ')} | {one['mean']:.4g} | {_interval(one)} | {one['episodes']} |"
        for name, one in figures.items()
        if one.get("mean") is not None
    ]
    results = (
        ["| figure | mean | 95 % interval | episodes |", "|---|---|---|---|", *rows]
        if rows
        else ["None stood beside the policy; `aoro-gym evaluate` measures them."]
    )
    training = [f"| {name} | `{value}` |" for name, value in policy.training.items()] or ["| | not known |"]
    return "\n".join(
        [
            "---",
            "library_name: aoro-gym",
            "pipeline_tag: reinforcement-learning",
            "tags: [reinforcement-learning, gymnasium, aoro-gym]",
            "---",
            "",
            f"# {place.rstrip('/').rpartition('/')[2]}",
            "",
            f"A policy for the environment `{policy.environment or 'unknown'}` of aoro-gym {VERSION}, a digital",
            "twin of a 10 t forestry machine: a multilayer perceptron of",
            f"{' - '.join(map(str, policy.sizes))} neurons ({policy.activation}).",
            "Weights are numbers in a safetensors file: loading them runs no code.",
            "",
            "## Use",
            "",
            "```sh",
            f"aoro-gym hub pull {place} --out pulled",
            f"aoro-gym evaluate --env {policy.environment} --policy pulled/{NAME}",
            "```",
            "",
            "## Observation",
            "",
            "| columns | term |",
            "|---|---|",
            *inputs,
            "",
            "## Training",
            "",
            "| what | value |",
            "|---|---|",
            *training,
            "",
            "## Evaluation",
            "",
            *results,
            "",
            "## Limits",
            "",
            "It was trained and evaluated in simulation. It has no safety function of its own: on a machine it belongs",
            "behind limits of speed, angle and place, and a person with a stop button.",
            "",
        ]
    )
