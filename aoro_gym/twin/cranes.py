"""Cranes apart from the vehicle, on a foot that stands still: their joints driven by torques, what holds and bears them.

Kinematics and rigid-body dynamics alone: oil, valves and friction have cranes on twins (:mod:`aoro_gym.twin.frame_cranes`).
Its parameters, which nothing has validated: :mod:`aoro_gym.machine.crane`; the law: :mod:`aoro_gym.twin.physics.crane`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_finite, check_integer, check_range
from aoro_gym.execution import devices
from aoro_gym.machine.crane import Crane, forwarder_crane
from aoro_gym.machine.quantities import Quantity
from aoro_gym.twin.kernels import crane as kernels
from aoro_gym.twin.physics.crane import CraneRecord
from aoro_gym.twin.recorded import BLOCK_DIM
from aoro_gym.units import GRAVITY

HELD = ("held_drop", "held_mass", "held_yaw", "held_inertia_axial", "held_inertia_transverse")
"""Fields of the device's record that say which log is held: none, apart from the vehicle."""


@dataclass(frozen=True, eq=False)
class CraneState:
    """What cranes (N) do at an instant, in the axes of their foot, float32."""

    tip: NDArray[Any]
    """(3, N) [m]."""
    force: NDArray[Any]
    """(3, N) [N] on the foot."""
    moment: NDArray[Any]
    """(3, N) [N m] on the foot, about it."""
    holding: NDArray[Any]
    """(4, N) torques [N m], the last a force [N], that hold the joints at rest against gravity."""
    kinetic: NDArray[Any]
    """(N,) [J]."""
    potential: NDArray[Any]
    """(N,) [J] of the weight, zero at the foot."""


def pack(crane: Crane) -> NDArray[Any]:
    """Device records of a ``crane``, one, or one a variant."""
    values: dict[str, Quantity] = {"foot": 0.0, **dict.fromkeys(HELD, 0.0)}
    fields_of: Any = CraneRecord.numpy_dtype()
    layout = np.dtype(fields_of)
    for name in layout.names or ():
        if name not in values:
            part, _, rest = name.partition("_")
            values[name] = getattr(getattr(crane, part), rest)
    count = max(np.size(value) for value in values.values())
    rows = np.zeros(count, dtype=layout)
    for name, value in values.items():
        rows[name] = value
    return rows


class Cranes:
    """Many cranes at once, each on its own foot.

    Args:
        num_cranes: At least 1.
        crane: One, or one whose values are arrays (num_cranes,); by default the one that comes with the package.
        gravity: Acceleration [m/s²] in the axes of the foot, (3,) or (num_cranes, 3): tilted for a foot on a slope.
        step: Time step [s].
        device: ``"cpu"`` or ``"cuda:N"``.

    Raises:
        ValueError: a value is out of its bound; the message names it.
    """

    def __init__(
        self,
        num_cranes: int = 1,
        *,
        crane: Crane | None = None,
        gravity: ArrayLike = (0.0, 0.0, -GRAVITY),
        step: float = 1e-3,
        device: str = "cpu",
    ):
        check_integer("num_cranes", num_cranes)
        check_range("step", step, "s", gt=0.0, le=5e-3, note=" for its motion to be followed")
        check_finite("gravity", gravity, "m/s²")
        self.num_cranes, self.step = int(num_cranes), float(step)
        self.crane = forwarder_crane() if crane is None else crane
        self.device = devices.find(device)
        records, down = pack(self.crane), np.atleast_2d(np.asarray(gravity, dtype=np.float32))
        for what, count in (("the crane", len(records)), ("gravity", len(down))):
            if count not in (1, self.num_cranes):
                raise ValueError(f"{what} has {count} variants, but must have 1 or num_cranes = {self.num_cranes}")
        self._records = wp.array(records, dtype=CraneRecord, device=self.device)
        self._gravity = wp.array(down, dtype=wp.vec3, device=self.device)
        self._joints, self._rates, self._accelerations, self._torques = (
            wp.zeros((4, self.num_cranes), dtype=float, device=self.device) for _ in range(4)
        )

    @property
    def joints(self) -> NDArray[Any]:
        """Slew, lift and fold [rad] and telescope [m], (4, num_cranes)."""
        return self._joints.numpy().copy()

    @property
    def rates(self) -> NDArray[Any]:
        """Their rates [rad/s, m/s], (4, num_cranes)."""
        return self._rates.numpy().copy()

    def place(self, joints: ArrayLike, rates: ArrayLike = 0.0) -> None:
        """Put the cranes at ``joints`` (4,) or (4, num_cranes), moving at ``rates`` likewise.

        Raises ValueError naming a joint that is out of its range.
        """
        values = self._checked("joints", joints)
        self.crane.check_joints(values.astype(np.float64))
        self._joints.assign(values)
        self._rates.assign(self._checked("rates", rates))
        self._accelerations.zero_()

    def advance(self, torques: ArrayLike, duration: float) -> None:
        """Move by ``duration`` [s], a whole number of steps, under ``torques`` (4,) or (4, num_cranes) [N m], the last a
        force [N]. Joints have no stops: keep them in their ranges."""
        steps = round(duration / self.step)
        if steps < 1 or abs(steps * self.step - duration) > 1e-6 * duration:
            raise ValueError(
                f"duration is {duration} s, but must be a positive whole multiple of the step {self.step} s"
            )
        self._torques.assign(self._checked("torques", torques))
        self._launch(
            kernels.swing,
            [
                self._records, self._gravity, self._torques, self._joints, self._rates, self._accelerations, steps,
                self.step,
            ],
        )  # fmt: skip

    def state(self) -> CraneState:
        """What they do under the last torques."""
        n = self.num_cranes
        tips, forces, moments = (wp.zeros(n, dtype=wp.vec3, device=self.device) for _ in range(3))
        holding, energies = (wp.zeros((rows, n), dtype=float, device=self.device) for rows in (4, 2))
        out = [tips, forces, moments, holding, energies]
        self._launch(kernels.weigh, [self._records, self._gravity, self._torques, self._joints, self._rates, *out])
        kinetic, potential = energies.numpy()
        tip, force, moment = (one.numpy().T.copy() for one in (tips, forces, moments))
        return CraneState(tip, force, moment, holding.numpy().copy(), kinetic.copy(), potential.copy())

    def _launch(self, kernel: Any, inputs: list[Any]) -> None:
        with devices.compiling(kernel, self.device, BLOCK_DIM):
            wp.launch(kernel, dim=self.num_cranes, inputs=inputs, device=self.device, block_dim=BLOCK_DIM)

    def _checked(self, name: str, values: ArrayLike) -> NDArray[np.float32]:
        array = np.asarray(values, dtype=np.float32)
        check_finite(name, array)
        if array.ndim == 1:
            array = array[:, None]
        try:
            return np.ascontiguousarray(np.broadcast_to(array, (4, self.num_cranes)))
        except ValueError:
            raise ValueError(
                f"{name} have shape {np.shape(values)}, but must be (4,) or (4, {self.num_cranes})"
            ) from None
