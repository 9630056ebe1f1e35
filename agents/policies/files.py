"""Policies that come with the package, and those of a file."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterable
from pathlib import Path

from aoro_gym.agents.policies.description import shortened
from aoro_gym.agents.policies.networks import of_stable_baselines3
from aoro_gym.agents.policies.policy import LearnedPolicy

SHIPPED = Path(__file__).parent


def shipped_policies(environment: str, localisation: str | None = None) -> dict[str, Path]:
    """The policies for an environment that come with the package, by name.

    Args:
        environment: Its id.
        localisation: Only those that learned with the pose estimated so: ``"gains"``, the default of environments, or
            ``"filter"``; None: all.
    """
    files = sorted(SHIPPED.glob("*.json"))
    found = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in files}
    return {
        name: SHIPPED / f"{name}.json"
        for name, content in found.items()
        if content["environment"] == environment
        and localisation in (None, content["training"].get("localisation", "gains"))
    }


def policy_file(environment: str, name: str, others: Iterable[str] = ()) -> Path:
    """File of a learned policy for an environment: of one that comes with the package, by its name, or ``name`` itself.

    Args:
        environment: Its id.
        name: Of a policy, or a file.
        others: Names that the caller knows beside these, for the message.

    Raises ValueError that lists what there is if ``name`` is neither.
    """
    shipped = shipped_policies(environment)
    if name not in shipped and not Path(name).suffix:
        known = ", ".join([*others, *shipped])
        raise ValueError(f"{name!r} is no policy for {environment}; choose from: {known}; or give a file")
    return shipped.get(name, Path(name))


def load_policy(path: Path, *, trust_pickle: bool = False) -> LearnedPolicy:
    """The policy of a file: ``.json`` with ``.safetensors``, or, if it is trusted, a ``.zip`` of Stable-Baselines3.

    Raises ValueError naming the file and what is wrong, OSError if there is none.
    """
    if path.suffix in (".json", ".safetensors"):
        return LearnedPolicy.load(path)
    if path.suffix != ".zip":
        raise ValueError(f"{path} is no policy; give a .json with its .safetensors, or a .zip of Stable-Baselines3")
    if not trust_pickle:
        raise ValueError(f"{path} is a pickle, which runs code of whoever made it; give --trust-pickle if you trust it")
    return _from_zip(path)


def _from_zip(path: Path) -> LearnedPolicy:
    """What ``model.save`` wrote, with the ``vecnormalize.pkl`` beside it or in the folder of its name, if there is one."""
    try:
        from stable_baselines3.common.save_util import load_from_zip_file  # pyright: ignore[reportMissingImports]
        from stable_baselines3.common.vec_env import VecNormalize  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ValueError(f"{path} needs {error.name}: pip install 'aoro-gym[agents]'") from error
    import pickle

    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    try:
        data, parameters, _ = load_from_zip_file(path, device="cpu")
        data = data or {}
        policy = data["policy_class"](
            data["observation_space"], data["action_space"], lambda _: 0.0, **data.get("policy_kwargs", {})
        )
        policy.load_state_dict(parameters["policy"])
    except Exception as error:  # a pickle of whoever may fail with anything
        raise ValueError(f"{path} holds no policy of Stable-Baselines3: {shortened(str(error))}") from error
    normaliser = None
    for folder in (path.parent, path.with_suffix("")):
        if (folder / "vecnormalize.pkl").exists():
            normaliser = pickle.loads((folder / "vecnormalize.pkl").read_bytes())
            if not isinstance(normaliser, VecNormalize):
                raise ValueError(f"{folder / 'vecnormalize.pkl'} is no VecNormalize")
    return of_stable_baselines3(policy, normaliser)
