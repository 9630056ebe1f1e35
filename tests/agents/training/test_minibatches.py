"""Gradients of minibatches are those of the objective, whatever was launched before, and recorded as they are not."""

import copy
from typing import Any

import numpy as np
import pytest
import warp as wp

torch: Any = pytest.importorskip("torch")

from aoro_gym.agents.training.minibatches import Figures, Minibatches, Samples, uploaded  # noqa: E402

COUNT, COLUMNS = 64, 5
CUDA = pytest.param("cuda:0", marks=pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device"))


class Networks(torch.nn.Module):
    """A Gaussian of one action, and a value."""

    def __init__(self) -> None:
        super().__init__()
        self.mean, self.value = torch.nn.Linear(COLUMNS, 1), torch.nn.Linear(COLUMNS, 1)
        self.log_std = torch.nn.Parameter(torch.full((1,), -0.5))

    def evaluate(self, observations: Any, actions: Any) -> tuple[Any, Any, Any]:
        """As Samples and Minibatches want it; π(a) = exp(−((a − µ)/σ)²/2) / (σ √2π)."""
        away = (actions - self.mean(observations)) / self.log_std.exp()
        constant = self.log_std + 0.5 * np.log(2.0 * np.pi)
        entropies = (constant + 0.5).expand(len(actions))
        return self.value(observations)[:, 0], (-0.5 * away.square() - constant)[:, 0], entropies


def case(device: str, **changes) -> tuple[Networks, Samples, Minibatches]:
    torch.manual_seed(0)
    networks = Networks()
    values, log_probs, advantages, returns = torch.randn(4, COUNT)
    samples = Samples(torch.randn(COUNT, COLUMNS), torch.randn(COUNT, 1), values, log_probs - 1.0, advantages, returns)
    weights = {"value_weight": 0.5, "entropy_weight": 0.01, "max_norm": 0.5, "normalised": True}
    networks.to(device)
    minibatches = Minibatches(networks.evaluate, networks.parameters(), **(weights | changes))
    minibatches.clip(0.2, None)
    return networks, Samples(*(one.to(device) for one in samples)), minibatches


def gradients(networks: Networks) -> list[Any]:
    return [None if one.grad is None else one.grad.cpu().clone() for one in networks.parameters()]


def objective(networks: Networks, samples: Samples, rows: Any, clip: float) -> Any:
    """In float64, sample by sample."""
    double = copy.deepcopy(networks).double()
    batch = [one[rows].double() for one in samples]
    values, log_probs, entropies = double.evaluate(batch[0], batch[1])
    advantages = (batch[4] - batch[4].mean()) / (batch[4].std() + 1e-8)
    losses = []
    for k in range(len(rows)):
        ratio = torch.exp(log_probs[k] - batch[3][k])
        bounded = min(max(ratio.item(), 1.0 - clip), 1.0 + clip)
        gain = ratio * advantages[k]
        gain = gain if gain.item() <= bounded * advantages[k].item() else torch.tensor(bounded) * advantages[k]
        losses.append(-gain + 0.5 * (batch[5][k] - values[k]) ** 2 - 0.01 * entropies[k])
    torch.stack(losses).mean().backward()
    return double


def test_gradients_are_those_of_the_objective():
    networks, samples, minibatches = case("cpu")
    rows = torch.arange(0, COUNT, 2)
    figures = Figures(*minibatches.gradients(samples, rows).tolist())
    double = objective(networks, samples, rows, 0.2)
    found = torch.cat([one.flatten() for one in gradients(networks)])
    wanted = torch.cat([one.grad.flatten() for one in double.parameters()])
    wanted = wanted * min(1.0, 0.5 / float(wanted.norm()))
    # sums of 32 terms below 100 in float32, of a norm of a half
    torch.testing.assert_close(found.double(), wanted, rtol=0.0, atol=32 * 2.0**-23)
    assert 0.0 < figures.clip_fraction < 1.0
    assert float(found.norm()) == pytest.approx(0.5, abs=1e-5)


@pytest.mark.parametrize("device", ["cpu", CUDA])
def test_one_launch_gives_what_many_do(device):
    """Of batches of two sizes in turns, with an actor that is held and let go, with other clip ranges, after a step."""
    networks, samples, minibatches = case(device)
    plain, _, others = case(device)
    optimisers = [torch.optim.Adam(one.parameters(), fused=True) for one in (networks, plain)]
    order = torch.randperm(COUNT, generator=torch.Generator().manual_seed(3)).to(device)
    for k, rows in enumerate([*order.split(24), *order.split(24)] * 2):
        for one, batches in ((networks, minibatches), (plain, others)):
            batches.clip(0.2 if k < 5 else 0.05, None if k < 8 else 0.1)
            one.mean.requires_grad_(k not in (3, 4))
        figures = minibatches.gradients(samples, rows)
        wanted = others._gradients(samples, rows)
        torch.testing.assert_close(figures, wanted, rtol=0.0, atol=1e-5)
        for one, other in zip(gradients(networks), gradients(plain), strict=True):
            assert (one is None) == (other is None)
            if one is not None:
                torch.testing.assert_close(one, other, rtol=0.0, atol=1e-6)
        for one in optimisers:
            one.step()
    for one, other in zip(networks.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=0.0, atol=1e-5)


@pytest.mark.parametrize("device", ["cpu", CUDA])
def test_what_is_uploaded_is_there(device):
    values = np.arange(100_000)
    here = uploaded(values, torch.device(device))
    assert here.device == torch.device(device)
    np.testing.assert_array_equal(here.cpu().numpy(), values)
