"""Cranes on the front frames of twins: their records, joints, and what they hold.

Law: :mod:`aoro_gym.twin.physics.crane`, oil: :mod:`aoro_gym.twin.physics.crane_oil`; how they move in a main step:
:mod:`aoro_gym.twin.kernels.crane_on_frame`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_finite
from aoro_gym.machine.quantities import Quantity
from aoro_gym.machine.vehicle_crane import GRAPPLE_DROP, VehicleCrane, moments_of_log
from aoro_gym.twin.cranes import pack
from aoro_gym.twin.kernels import crane_on_frame as kernels
from aoro_gym.twin.kernels.laws import ChosenLaws
from aoro_gym.twin.records import CraneCommand, CraneRow

REST_PRESSURE = 5e5
"""Pressure [Pa] in chambers that bear nothing, at the start."""


def _columns(*values: Quantity) -> NDArray[Any]:
    """Numbers or arrays (V,) side by side, (V, len(values))."""
    return np.stack(np.broadcast_arrays(*(np.atleast_1d(one) for one in values)), axis=-1)


def pack_on_frame(vehicle: VehicleCrane) -> NDArray[Any]:
    """Device records of a crane and its mount, one, or one a variant."""
    crane, mount = vehicle.crane, vehicle.mount
    chain, oil = pack(crane), pack_oil(vehicle)
    chain["foot"] = _columns(mount.foot.distance, 0.0, mount.foot.height)
    chain["held_drop"] = GRAPPLE_DROP
    mass, moment, tensor = vehicle.folded()
    layout: Any = kernels.FrameCrane.numpy_dtype()
    rows: Any = np.zeros(max(len(chain), len(oil), len(mass)), dtype=layout)
    rows["chain"], rows["oil"] = chain, oil
    rows["has_oil"] = vehicle.drive == "cylinders"
    rows["has_contact"] = vehicle.log_contact
    for name in ("stiffness", "damping", "friction"):
        rows["contact"][name] = getattr(mount.contact, name)
    rows["folded_mass"], rows["folded_moment"], rows["folded_inertia"] = mass, moment, tensor
    return rows


def pack_oil(vehicle: VehicleCrane) -> NDArray[Any]:
    """Device records of its cylinders, valves, friction and stops."""
    crane, mount = vehicle.crane, vehicle.mount
    lift, fold, slide = crane.lift.cylinder, crane.fold.cylinder, crane.telescope.cylinder
    rack = crane.slew.displacement
    ends = [(one.extension(joint.low)[0], one.extension(joint.high)[0])
            for one, joint in ((lift, crane.lift), (fold, crane.fold))]  # fmt: skip
    shortest = (-crane.slew.range, ends[0][0], ends[1][0], 0.0)
    strokes = (
        2.0 * crane.slew.range, ends[0][1] - ends[0][0], ends[1][1] - ends[1][0], crane.telescope.stroke / slide.ratio
    )  # fmt: skip
    hoses, valves, friction, stops = mount.hoses, mount.valves, mount.friction, mount.stops
    low, high = zip(*crane.limits, strict=True)
    values = {
        "bore_area": _columns(rack, lift.bore_area, fold.bore_area, slide.bore_area),
        "annulus_area": _columns(rack, lift.annulus_area, fold.annulus_area, slide.annulus_area),
        "shortest": _columns(*shortest),
        "stroke": _columns(*strokes),
        "fold_pin": _columns(-fold.pin_back, fold.pin_over),
        "fold_pivot": _columns(-fold.pivot_back, fold.pivot_over),
        "fixed_volume": hoses.volume + hoses.dead_volume,
        "hose_compliance": hoses.volume / hoses.bulk_modulus,
        "valve_cv": valves.cv.T if valves.cv.ndim > 1 else valves.cv,
        "dry": _columns(friction.slew, *[friction.cylinders] * 3),
        "viscous": _columns(friction.slew_viscous, *[friction.cylinder_viscous] * 3),
        "presliding": friction.presliding,
        "middle": 0.5 * (_columns(*low) + _columns(*high)),
        "reach": 0.5 * (_columns(*high) - _columns(*low)),
        "stop_stiffness": _columns(*[stops.stiffness] * 3, stops.telescope_stiffness),
        "stop_damping": _columns(*[stops.damping] * 3, stops.telescope_damping),
    }
    layout: Any = kernels.CraneHydraulics.numpy_dtype()
    of_cylinders = {"lift": lift, "fold": fold, "telescope": slide}
    for name in set(np.dtype(layout).names or ()) - values.keys():
        part, _, rest = name.partition("_")
        values[name] = getattr(of_cylinders[part], rest) if part in of_cylinders else getattr(valves, name)
    vectors = {name for name in values if np.dtype(layout)[name].shape}
    count = max(len(np.atleast_2d(one)) if name in vectors else np.size(one) for name, one in values.items())
    rows: Any = np.zeros(count, dtype=layout)
    for name, value in values.items():
        rows[name] = value
    return rows


class FrameCranes:
    """The cranes of twins (N).

    Args:
        vehicle: Crane and mount.
        state: Rows of the twins' state (R, N) on their device, :class:`~aoro_gym.twin.records.CraneRow` among them.
        commands: Rows of their commands, likewise.
        gravity: [m/s²].

    Raises:
        ValueError: neither one crane nor one a twin.
    """

    def __init__(self, vehicle: VehicleCrane, state: wp.array, commands: wp.array, *, gravity: float):
        self.vehicle = vehicle
        self.crane = vehicle.crane
        self._state, self._commands, self._gravity = state, commands, gravity
        n, device = state.shape[1], state.device
        self.num_twins = int(n)
        rows = pack_on_frame(vehicle)
        if len(rows) not in (1, n):
            raise ValueError(f"the crane has {len(rows)} variants, but must have 1 or num_twins = {n}")
        self._records = wp.array(rows, dtype=kernels.FrameCrane, device=device)
        self._start = wp.array(
            np.broadcast_to(vehicle.start_joints.reshape(4, -1), (4, n)).astype(np.float32), device=device
        )

    def with_laws(self, laws: Any, machines: wp.array) -> Any:
        """What ``advance`` takes as its ``laws``: them, with these cranes on the ``machines``."""
        chosen = type(laws)._cls is ChosenLaws
        out: Any = kernels.ChosenLawsWithCrane() if chosen else kernels.DefaultLawsWithCrane()
        out.laws, out.cranes, out.machines = laws, self._records, machines
        return out

    def start(self, mask: wp.array) -> None:
        """Twins of the ``mask`` (N,) begin anew with cranes as at the start and empty grapples, all on the device."""
        wp.launch(
            kernels.open_grapples,
            dim=self.num_twins,
            inputs=[mask, self._state, self._commands],
            device=self._state.device,
        )
        self._settle(mask, self._start)

    def _settle(self, mask: wp.array, joints: wp.array) -> None:
        wp.launch(
            kernels.settle_cranes,
            dim=self.num_twins,
            inputs=[self._records, mask, joints, self._gravity, REST_PRESSURE, self._state],
            device=self._state.device,
        )

    def _rows(self, first: int) -> NDArray[Any]:
        return self._state[int(first) : int(first) + 4].numpy().copy()

    @property
    def joints(self) -> NDArray[Any]:
        """Slew, lift and fold [rad] and telescope [m], (4, N)."""
        return self._rows(CraneRow.JOINT_SLEW)

    @property
    def rates(self) -> NDArray[Any]:
        """Their rates [rad/s, m/s], (4, N)."""
        return self._rows(CraneRow.RATE_SLEW)

    @property
    def tip(self) -> NDArray[np.float64]:
        """Places of the tips [m] in the front frames (3, N): ahead of the hinge, left, over the design ground plane."""
        return self.vehicle.tip(self.joints)

    @property
    def tip_load(self) -> NDArray[Any]:
        """Force [N] of grapple and log on the tip (N,)."""
        return self._state[int(CraneRow.TIP_LOAD)].numpy().copy()

    @property
    def held_mass(self) -> NDArray[Any]:
        """Mass [kg] of the log in each grapple (N,); 0: empty."""
        return self._state[int(CraneRow.HELD_MASS)].numpy().copy()

    def place(self, joints: ArrayLike, mask: ArrayLike | None = None) -> None:
        """Put the cranes of twins at rest at ``joints``, held by shut oil (or by torques, where they have none).

        Args:
            joints: (4,) or (4, N).
            mask: Which twins, booleans (N,); all by default.

        Raises:
            ValueError: a joint is out of its range, or a shape is wrong; the message names it.
        """
        values = self._checked("joints", joints)
        self.crane.check_joints(values.astype(np.float64))
        n = self.num_twins
        chosen = np.ones(n, dtype=bool) if mask is None else np.asarray(mask, dtype=bool)
        device = self._state.device
        self._settle(wp.array(chosen, dtype=bool, device=device), wp.array(values, device=device))

    def set_torques(self, torques: ArrayLike) -> None:
        """Torques [N m], the last a force [N], on the joints from outside, (4,) or (4, N); they hold until others are
        set."""
        values = self._checked("torques", torques)
        self._state[int(CraneRow.TORQUE_SLEW) : int(CraneRow.TORQUE_SLEW) + 4].assign(values)

    def set_rates(self, rates: ArrayLike) -> None:
        """Make the joints move at ``rates`` (4,) or (4, N) [rad/s, m/s], as a blow would."""
        self._state[int(CraneRow.RATE_SLEW) : int(CraneRow.RATE_SLEW) + 4].assign(self._checked("rates", rates))

    def grasp(
        self, mass: ArrayLike, length: ArrayLike, diameter: ArrayLike, yaw: ArrayLike = 0.0, mask: Any = None
    ) -> None:
        """Let grapples hold logs, cylinders whose middle hangs :data:`~aoro_gym.machine.vehicle_crane.GRAPPLE_DROP` below
        the tip and slews with the pillar.

        Args:
            mass: [kg], scalar or (N,); 0: let go.
            length: [m], likewise.
            diameter: [m], likewise.
            yaw: Angle of the log to the pillar [rad], likewise.
            mask: Which twins, booleans (N,); all by default.
        """
        for name, value in (("mass", mass), ("length", length), ("diameter", diameter), ("yaw", yaw)):
            check_finite(name, value)
            if name != "yaw" and np.any(np.asarray(value) < 0.0):
                raise ValueError(f"{name} is {np.min(value):g}, but must be at least 0")
        axial, across = moments_of_log(mass, length, diameter)
        self._hold(np.ones(self.num_twins, dtype=bool) if mask is None else mask, mass, yaw, axial, across)

    def _hold(self, mask: Any, mass: ArrayLike, yaw: ArrayLike, axial: ArrayLike, across: ArrayLike) -> None:
        chosen = np.asarray(mask, dtype=bool)
        if not chosen.any():
            return
        for array, first in ((self._state, CraneRow.HELD_MASS), (self._commands, CraneCommand.CRANE_HELD_MASS)):
            held = array[int(first) : int(first) + 4]
            rows = held.numpy().copy()
            for row, value in zip(rows, (mass, yaw, axial, across), strict=True):
                row[chosen] = np.broadcast_to(value, chosen.shape)[chosen]
            held.assign(rows)

    def _checked(self, name: str, values: ArrayLike) -> NDArray[np.float32]:
        array = np.asarray(values, dtype=np.float32)
        check_finite(name, array)
        n = self.num_twins
        if array.shape not in ((4,), (4, n)):
            raise ValueError(f"{name} have shape {array.shape}, but must be (4,) or (4, {n})")
        return np.ascontiguousarray(np.broadcast_to(array.reshape(4, -1), (4, n)))
