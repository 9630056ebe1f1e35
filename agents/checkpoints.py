"""All that a training has learned and drawn so far, in one file that holds no code.

A checkpoint is taken between two rollouts, when all environments begin anew: what they would draw next is then in the seeds
of the restart, and networks, optimisers, normalisation, replay buffer, counters and random states are all that there is.
It is written whole or not at all, and read by torch with ``weights_only``, which builds tensors and plain values only.
"""

from __future__ import annotations

import json
import random
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.base_class import BaseAlgorithm  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.save_util import recursive_getattr  # pyright: ignore[reportMissingImports]

COUNTERS = ("num_timesteps", "_episode_num", "_n_updates")
STATISTICS = ("ep_info_buffer", "ep_success_buffer")
"""The last episodes, for the log."""
TRANSITIONS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of a replay buffer."""


def save_checkpoint(path: Path, model: BaseAlgorithm, notes: dict[str, Any]) -> None:
    """Write the state of ``model``, and ``notes`` that JSON can hold."""
    _, variables = model._get_torch_save_params()
    content = {
        "parameters": model.get_parameters(),
        "variables": {name: recursive_getattr(model, name).detach() for name in variables},
        "counters": {name: getattr(model, name) for name in COUNTERS if hasattr(model, name)},
        "statistics": json.dumps({name: list(getattr(model, name)) for name in STATISTICS}, default=float),
        "normaliser": None,
        "replay": None,
        "random": _random_states(model),
        "notes": json.dumps(notes),
    }
    normaliser = model.get_vec_normalize_env()
    if normaliser is not None:
        content["normaliser"] = {
            name: {"mean": _tensor(rms.mean), "var": _tensor(rms.var), "count": float(rms.count)}
            for name, rms in _moments(normaliser).items()
        }
    replay = getattr(model, "replay_buffer", None)
    if replay is not None:
        count = replay.buffer_size if replay.full else replay.pos
        content["replay"] = {
            "position": replay.pos,
            "full": replay.full,
            "arrays": {name: torch.from_numpy(getattr(replay, name)[:count]) for name in TRANSITIONS},
        }
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.partial")
    torch.save(content, partial)
    partial.replace(path)


def load_checkpoint(path: Path, model: BaseAlgorithm) -> dict[str, Any]:
    """Give ``model``, made as the one that was saved, its state back; returns the notes."""
    content = torch.load(path, map_location="cpu", weights_only=True)
    model.set_parameters(content["parameters"], exact_match=True, device=model.device)
    with torch.no_grad():
        for name, value in content["variables"].items():
            recursive_getattr(model, name).copy_(value)
    for name, value in content["counters"].items():
        setattr(model, name, value)
    for name, values in json.loads(content["statistics"]).items():
        setattr(model, name, deque(values, maxlen=model._stats_window_size))
    normaliser = model.get_vec_normalize_env()
    if normaliser is not None:
        for name, rms in _moments(normaliser).items():
            saved = content["normaliser"][name]
            rms.mean, rms.var, rms.count = saved["mean"].numpy(), saved["var"].numpy(), saved["count"]
    replay: Any = getattr(model, "replay_buffer", None)
    if replay is not None:
        saved = content["replay"]
        replay.pos, replay.full = saved["position"], saved["full"]
        for name, values in saved["arrays"].items():
            getattr(replay, name)[: len(values)] = values.numpy()
    _restore_random_states(model, content["random"])
    return json.loads(content["notes"])


def _moments(normaliser: Any) -> dict[str, Any]:
    """Running means and variances of a ``VecNormalize``."""
    return {"returns": normaliser.ret_rms} | ({"observations": normaliser.obs_rms} if normaliser.norm_obs else {})


def _tensor(values: Any) -> torch.Tensor:
    return torch.from_numpy(np.array(values, dtype=np.float64))


def _random_states(model: BaseAlgorithm) -> dict[str, Any]:
    name, keys, *rest = np.random.get_state()  # noqa: NPY002 (which Stable-Baselines3 draws from)
    states = {
        "python": json.dumps(random.getstate()),
        "numpy": json.dumps([name, np.asarray(keys).tolist(), *rest]),
        "actions": json.dumps(model.action_space.np_random.bit_generator.state),
        "torch": torch.get_rng_state(),
    }
    if model.device.type == "cuda":
        states["cuda"] = torch.cuda.get_rng_state(model.device)
    return states


def _restore_random_states(model: BaseAlgorithm, states: dict[str, Any]) -> None:
    version, internal, gauss = json.loads(states["python"])
    random.setstate((version, tuple(internal), gauss))
    np.random.set_state(tuple(json.loads(states["numpy"])))  # noqa: NPY002
    model.action_space.np_random.bit_generator.state = json.loads(states["actions"])
    torch.set_rng_state(states["torch"])
    if "cuda" in states:
        torch.cuda.set_rng_state(states["cuda"], model.device)
