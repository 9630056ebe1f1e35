"""A network of torch that remembers: the one behind :class:`aoro_gym.agents.policies.memory.GatedMemory`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch  # pyright: ignore[reportMissingImports]
from torch import nn  # pyright: ignore[reportMissingImports]

from aoro_gym.agents.policies.memory import GatedMemory
from aoro_gym.agents.policies.networks import into_network, of_network
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training.perceptron import perceptron


class Memory(nn.Module):
    """A layer, and gated recurrent units behind it; see there.

    Args:
        observed: Numbers of a normalised observation, O.
        units: Of the memory, U, and of the layer before it.
    """

    def __init__(self, observed: int, units: int):
        super().__init__()
        self.encoder = nn.Linear(observed, units)
        self.cell = nn.GRUCell(units, units)

    def beginning(self, count: int) -> torch.Tensor:
        """State (N, U) in which ``count`` episodes begin."""
        return torch.zeros(count, self.cell.hidden_size, device=self.encoder.weight.device)

    def remember(self, observations: torch.Tensor, state: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """What a perceptron behind it takes (N, 2 U), and the new state (N, U), for normalised observations (N, O)."""
        encoded = torch.tanh(self.encoder(observations))
        state = self.cell(encoded, state)
        return torch.cat([encoded, state], dim=1), state

    def take_memory(self, memory: GatedMemory | None) -> None:
        """Remember as ``memory`` does. Raises ValueError if it is of other sizes, or none."""
        mine = self.encoder.in_features, self.encoder.out_features, self.cell.hidden_size
        if memory is None or memory.sizes != mine:
            has = "no memory" if memory is None else f"a memory of {memory.sizes}"
            raise ValueError(f"the policy to start from has {has}, but the network to train one of {mine}; set memory")
        with torch.no_grad():
            for parameter, value in (
                (self.encoder.weight, memory.encoder_weight), (self.encoder.bias, memory.encoder_bias),
                (self.cell.weight_ih, memory.input_weight), (self.cell.weight_hh, memory.state_weight),
                (self.cell.bias_ih, memory.input_bias), (self.cell.bias_hh, memory.state_bias),
            ):  # fmt: skip
                parameter.copy_(torch.from_numpy(value))


class MemoryNetwork(Memory):
    """A memory, and a perceptron that takes what it gives.

    Args:
        observed: See :class:`Memory`.
        units: See there.
        hidden: Sizes of the perceptron's hidden layers.
        acts: Numbers of an action, A.
        errors: Numbers that a further layer guesses from the memory alone while it learns, see
            :class:`aoro_gym.agents.training.recurrent_dagger.RecurrentDagger`.
    """

    def __init__(self, observed: int, units: int, hidden: Sequence[int], acts: int, errors: int):
        super().__init__(observed, units)
        self.head = perceptron([2 * units, *hidden, acts])
        self.errors = nn.Linear(units, errors) if errors else None

    def step(self, observations: torch.Tensor, state: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions (N, A) and the new state (N, U) for normalised observations (N, O)."""
        taken, state = self.remember(observations, state)
        return self.head(taken), state

    def forward(
        self, observations: torch.Tensor, state: torch.Tensor, begins: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Actions (T, N, A) and guessed errors (T, N, K) along T steps.

        Args:
            observations: Normalised (T, N, O).
            state: Before the first of them (N, U).
            begins: Whether an episode begins with an observation (T, N).
        """
        encoded, states = torch.tanh(self.encoder(observations)), []
        going_on = (~begins).to(state.dtype)[..., None]
        for taken, goes_on in zip(encoded, going_on, strict=True):
            state = self.cell(taken, state * goes_on)
            states.append(state)
        remembered = torch.stack(states)
        guessed = None if self.errors is None else self.errors(remembered)
        return self.head(torch.cat([encoded, remembered], dim=2)), guessed

    def policy(self, action_space: Any, **about: Any) -> LearnedPolicy:
        """The policy of this network; see :func:`aoro_gym.agents.policies.networks.of_network`."""

        def plain(values: torch.Tensor) -> Any:
            return values.detach().cpu().numpy().copy()

        memory = GatedMemory(
            encoder_weight=plain(self.encoder.weight),
            encoder_bias=plain(self.encoder.bias),
            input_weight=plain(self.cell.weight_ih),
            state_weight=plain(self.cell.weight_hh),
            input_bias=plain(self.cell.bias_ih),
            state_bias=plain(self.cell.bias_hh),
        )
        return of_network(self.head, action_space, memory=memory, **about)

    def take(self, policy: LearnedPolicy) -> None:
        """Act as ``policy`` does. Raises ValueError if its network is another one."""
        self.take_memory(policy.memory)
        into_network(policy, self.head, normalised=True)
