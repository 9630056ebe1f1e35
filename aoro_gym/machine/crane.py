"""A forwarder crane: its parameters with their sources, where its tip is, and which joints bring it where.

Four joints in a row: ``slew`` q₁ turns the pillar about the upright of its foot, left positive; ``lift`` q₂ raises the main
boom; ``fold`` q₃ raises the stick against the boom, in line at zero; ``telescope`` q₄ pushes the extension out of the stick.
The grapple hangs from the tip as a point mass. Axes at the foot: x forward, y left, z up. Of the
cylinders there are the linkages: which pressures hold a pose. Units: m, kg, s, rad, N, Pa.
"""

from dataclasses import fields, is_dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_finite
from aoro_gym.machine.machine_file import Parameter, read_parameters
from aoro_gym.machine.quantities import Quantity, finite, non_negative, positive, section, within
from aoro_gym.recording.commands import JOINTS
from aoro_gym.units import GRAVITY

_STRAIGHT = np.pi


@section
class Piston:
    """Bore and rod of a cylinder."""

    bore: Quantity = positive("m")
    rod: Quantity = positive("m")

    @property
    def bore_area(self) -> Quantity:
        """Piston area [m²]."""
        return np.pi / 4.0 * self.bore**2

    @property
    def annulus_area(self) -> Quantity:
        """Piston area on the rod's side [m²]."""
        return np.pi / 4.0 * (self.bore**2 - self.rod**2)

    def pressures(self, force: Quantity, back: Quantity) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pressures [Pa] in bore and annulus that push with ``force`` [N]; the other side is at ``back`` [Pa]."""
        pushing = (force + back * self.annulus_area) / self.bore_area
        pulling = (back * self.bore_area - force) / self.annulus_area
        return np.maximum(pushing, back), np.maximum(pulling, back)


@section
class LiftCylinder(Piston):
    """Cylinder between pillar and main boom."""

    pillar_pin: Quantity = positive("m")  # from the lift's pin
    boom_pin: Quantity = positive("m")  # likewise
    level_angle: Quantity = positive("rad")  # between both ways, boom level

    def extension(self, lift: Quantity) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Length pin to pin [m] at the angle ``lift`` [rad], and its slope [m/rad] (law of cosines)."""
        between = self.level_angle + np.asarray(lift)
        product = self.pillar_pin * self.boom_pin
        length = np.sqrt(self.pillar_pin**2 + self.boom_pin**2 - 2.0 * product * np.cos(between))
        return length, product * np.sin(between) / length


@section
class FoldCylinder(Piston):
    """Cylinder of the stick, which turns it over four bars: boom, lever, coupler, and lug of the stick."""

    pin_back: Quantity = positive("m")  # of the cylinder on the boom, behind the fold's pin
    pin_over: Quantity = finite("m")
    pivot_back: Quantity = positive("m")  # of the lever on the boom
    pivot_over: Quantity = finite("m")
    lever: Quantity = positive("m")
    coupler: Quantity = positive("m")
    lug: Quantity = positive("m")  # from the fold's pin
    lug_angle: Quantity = finite("rad")  # against the stick

    def pins(self, fold: Quantity) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Lug of the stick, and pin that lever, coupler and cylinder share, at the angle ``fold`` [rad]: along the boom and
        over it from the fold's pin [m], as complex numbers."""
        lug = self.lug * np.exp(1j * (self.lug_angle + np.asarray(fold, dtype=np.float64))).astype(np.complex128)
        pivot = -self.pivot_back + 1j * np.asarray(self.pivot_over)
        way = lug - pivot
        cosine = (np.abs(way) ** 2 + self.lever**2 - self.coupler**2) / (2.0 * np.abs(way) * self.lever)
        return lug, (pivot + self.lever * way / np.abs(way) * np.exp(-1j * np.arccos(cosine))).astype(np.complex128)

    def extension(self, fold: Quantity) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Length pin to pin [m] at the angle ``fold`` [rad], and its slope [m/rad].

        The lug moves at right angles to its arm; the shared pin to the lever, as fast along the coupler as the lug.
        """
        lug, shared = self.pins(fold)
        pivot, pin = (
            -self.pivot_back + 1j * np.asarray(self.pivot_over),
            -self.pin_back + 1j * np.asarray(self.pin_over),
        )
        along, lever = shared - lug, shared - pivot
        turn = _dot(1j * lug, along) / _dot(1j * lever, along)
        length = np.abs(shared - pin)
        return length, turn * _dot(1j * lever, shared - pin) / length


@section
class TelescopeCylinder(Piston):
    """Cylinder of the extension."""

    ratio: Quantity = positive("1")  # way of the extension over that of the piston


def _dot(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Scalar product of two vectors of the plane."""
    return np.real(a * np.conj(b))


@section
class Slew:
    """Bearing of the pillar."""

    range: Quantity = positive("rad")  # to either side
    displacement: Quantity = positive("m^3/rad")  # of its racks


@section
class Pillar:
    """Slewing base and pillar."""

    mass: Quantity = positive("kg")
    cog_forward: Quantity = finite("m")  # of the slewing axis
    cog_height: Quantity = positive("m")  # over the foot
    inertia_axial: Quantity = positive("kg*m^2")  # about the upright through its CoG
    inertia_transverse: Quantity = positive("kg*m^2")


@section
class Lift:
    """Pin between pillar and main boom."""

    offset: Quantity = finite("m")  # in front of the slewing axis
    height: Quantity = positive("m")  # over the foot
    low: Quantity = within("rad", -_STRAIGHT, _STRAIGHT)
    high: Quantity = within("rad", -_STRAIGHT, _STRAIGHT)
    cylinder: LiftCylinder


@section
class Boom:
    """Main boom."""

    mass: Quantity = positive("kg")
    length: Quantity = positive("m")  # pin to pin
    cog_along: Quantity = finite("m")  # from the lift's pin
    cog_over: Quantity = finite("m")  # over the line between the pins
    inertia_axial: Quantity = positive("kg*m^2")  # about the CoG
    inertia_transverse: Quantity = positive("kg*m^2")


@section
class Fold:
    """Pin between main boom and stick."""

    low: Quantity = within("rad", -_STRAIGHT, _STRAIGHT)
    high: Quantity = within("rad", -_STRAIGHT, _STRAIGHT)
    cylinder: FoldCylinder


@section
class Stick:
    """Outer boom, without what slides in it."""

    mass: Quantity = positive("kg")
    length: Quantity = positive("m")  # from the fold's pin to the retracted tip
    cog_along: Quantity = finite("m")  # from the fold's pin
    inertia_axial: Quantity = positive("kg*m^2")
    inertia_transverse: Quantity = positive("kg*m^2")


@section
class Telescope:
    """Slide of the extension."""

    stroke: Quantity = positive("m")
    cylinder: TelescopeCylinder


@section
class Extension:
    """Inner booms."""

    mass: Quantity = positive("kg")
    cog_along: Quantity = finite("m")  # from the tip, outward positive
    inertia_axial: Quantity = positive("kg*m^2")
    inertia_transverse: Quantity = positive("kg*m^2")


@section
class Grapple:
    """What hangs from the tip: grapple, rotator, and what it holds."""

    mass: Quantity = non_negative("kg")


@section
class Crane:
    """A crane; floats, or arrays of shape (N,) with one value a crane."""

    slew: Slew
    pillar: Pillar
    lift: Lift
    boom: Boom
    fold: Fold
    stick: Stick
    telescope: Telescope
    extension: Extension
    grapple: Grapple

    @property
    def mass(self) -> Quantity:
        """All of it [kg]."""
        return self.pillar.mass + self.boom.mass + self.stick.mass + self.extension.mass + self.grapple.mass

    @property
    def reach(self) -> Quantity:
        """Farthest place of the tip from the slewing axis, at the lift's height [m]."""
        return self.lift.offset + self.boom.length + self.stick.length + self.telescope.stroke

    @property
    def limits(self) -> tuple[tuple[Quantity, Quantity], ...]:
        """Lowest and highest value of each joint [rad], of the telescope [m]."""
        return (
            (-self.slew.range, self.slew.range),
            (self.lift.low, self.lift.high),
            (self.fold.low, self.fold.high),
            (0.0 * self.telescope.stroke, self.telescope.stroke),
        )

    def with_grapple(self, mass: ArrayLike) -> "Crane":
        """The crane with another ``mass`` [kg] at its tip: of the grapple and of the logs in it."""
        check_finite("mass", mass, "kg")
        if np.any(np.less(mass, 0.0)):
            raise ValueError(f"mass is {np.min(mass):g} kg, but must be at least 0")
        held = np.asarray(mass, dtype=np.float64)
        return replace(self, grapple=Grapple(mass=held if held.ndim else float(held)))

    def holding(self, joints: ArrayLike) -> NDArray[np.float64]:
        """Torques [N m] (4, ...), the last a force [N], that hold the joints (4, ...) of an upright crane at rest."""
        _, lift, fold, out = np.asarray(joints, dtype=np.float64)
        boom, stick, inner = self.boom, self.stick, self.extension
        raised, length = lift + fold, stick.length + out
        beyond = stick.mass + inner.mass + self.grapple.mass
        # first moments of what hangs on either pin
        on_fold = stick.mass * stick.cog_along + inner.mass * (length + inner.cog_along) + self.grapple.mass * length
        on_fold = on_fold * np.cos(raised)
        on_lift = boom.mass * (boom.cog_along * np.cos(lift) - boom.cog_over * np.sin(lift))
        on_lift = on_lift + beyond * boom.length * np.cos(lift) + on_fold
        slid = (inner.mass + self.grapple.mass) * np.sin(raised)
        return GRAVITY * np.stack(np.broadcast_arrays(0.0 * raised, on_lift, on_fold, slid))

    def pressures(
        self, joints: ArrayLike, torques: ArrayLike, back: float = 5e5
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pressures [Pa] in the bores and the annuli (4, ...) with which the cylinders give ``torques`` (4, ...), without
        friction. The slew's racks push one way by their bore, the other way by their annulus.

        Args:
            joints: (4, ...).
            torques: [N m], the last a force [N].
            back: Pressure [Pa] of the side that does not bear.
        """
        _, lift, fold, _ = np.asarray(joints, dtype=np.float64)
        slewing, raising, folding, pushing = np.asarray(torques, dtype=np.float64)
        racks = back + np.maximum(slewing, 0.0) / self.slew.displacement
        racks_back = back + np.maximum(-slewing, 0.0) / self.slew.displacement
        slide = self.telescope.cylinder
        pairs = [
            (racks, racks_back),
            self.lift.cylinder.pressures(raising / self.lift.cylinder.extension(lift)[1], back),
            self.fold.cylinder.pressures(folding / self.fold.cylinder.extension(fold)[1], back),
            slide.pressures(slide.ratio * pushing, back),
        ]
        bores, annuli = zip(*pairs, strict=True)
        return np.stack(np.broadcast_arrays(*bores)), np.stack(np.broadcast_arrays(*annuli))

    def capacity(self, joints: ArrayLike, pressure: float) -> NDArray[np.float64]:
        """Mass [kg] (...) beyond the grapple's that lift and fold hold at ``joints`` (4, ...) with ``pressure`` [Pa] in
        their bores, without back pressure; negative where they cannot hold the crane itself."""
        _, lift, fold, out = np.asarray(joints, dtype=np.float64)
        held, length = self.holding(joints), self.stick.length + out
        on_fold = length * np.cos(lift + fold)
        levers = (self.boom.length * np.cos(lift) + on_fold, on_fold)
        most = []
        for cylinder, angle, own, lever in (
            (self.lift.cylinder, lift, held[1], levers[0]), (self.fold.cylinder, fold, held[2], levers[1]),
        ):  # fmt: skip
            spare = pressure * cylinder.bore_area * cylinder.extension(angle)[1] - own
            most.append(np.where(lever > 0.0, spare / (GRAVITY * np.where(lever > 0.0, lever, 1.0)), np.inf))
        return np.minimum(*most)

    def tip(self, joints: ArrayLike) -> NDArray[np.float64]:
        """Place (3, ...) of the tip [m] at ``joints`` (4, ...): q₁, q₂, q₃ [rad] and q₄ [m]."""
        slew, lift, fold, out = np.asarray(joints, dtype=np.float64)
        length = self.stick.length + out
        radius = self.lift.offset + self.boom.length * np.cos(lift) + length * np.cos(lift + fold)
        height = self.lift.height + self.boom.length * np.sin(lift) + length * np.sin(lift + fold)
        return np.stack(np.broadcast_arrays(radius * np.cos(slew), radius * np.sin(slew), height))

    def jacobian(self, joints: ArrayLike) -> NDArray[np.float64]:
        """Slopes (3, 4, ...) of the tip's place with the joints (4, ...)."""
        slew, lift, fold, out = np.broadcast_arrays(*np.asarray(joints, dtype=np.float64))
        length = self.stick.length + out
        raised = lift + fold
        radius = self.lift.offset + self.boom.length * np.cos(lift) + length * np.cos(raised)
        # radial and upward slopes of the plane of the booms
        stick = np.stack([-length * np.sin(raised), length * np.cos(raised)])
        boom = np.stack([-self.boom.length * np.sin(lift), self.boom.length * np.cos(lift)])
        plane = np.stack([boom + stick, stick, np.stack([np.cos(raised), np.sin(raised)])], axis=1)
        cosine, sine, still = np.cos(slew), np.sin(slew), np.zeros_like(slew)
        turning = np.stack([-radius * sine, radius * cosine, still])[:, None]
        return np.concatenate([turning, np.stack([plane[0] * cosine, plane[0] * sine, plane[1]])], axis=1)

    def displacements(self, joints: ArrayLike) -> NDArray[np.float64]:
        """Volumes (4, ...) that the pushing sides take up a unit of each joint [m³/rad], the last [m³/m] = [m²]."""
        _, lift, fold, _ = np.broadcast_arrays(*np.asarray(joints, dtype=np.float64))
        slide = self.telescope.cylinder
        volumes = (
            self.slew.displacement + 0.0 * lift,
            self.lift.cylinder.bore_area * self.lift.cylinder.extension(lift)[1],
            self.fold.cylinder.bore_area * self.fold.cylinder.extension(fold)[1],
            slide.bore_area / slide.ratio + 0.0 * lift,
        )
        return np.stack(volumes)

    def flows(self, joints: ArrayLike, rates: ArrayLike) -> NDArray[np.float64]:
        """Flows (4, ...) [m³/s] that the pump gives for the joints' ``rates`` (4, ...): into the bores of what lengthens,
        into the annuli of what shortens."""
        pushed = self.displacements(joints) * np.asarray(rates, dtype=np.float64)
        pistons = self.lift.cylinder, self.fold.cylinder, self.telescope.cylinder
        shares = [1.0, *(one.annulus_area / one.bore_area for one in pistons)]
        pulled = np.stack([np.asarray(share) * -flow for share, flow in zip(shares, pushed, strict=True)])
        return np.maximum(pushed, pulled)

    def tip_rates(
        self, joints: ArrayLike, velocity: ArrayLike, available: float = np.inf, damping: float = 1e-9
    ) -> NDArray[np.float64]:
        """Rates (4, ...) of the joints that move the tip at ``velocity`` (3, ...) [m/s]; tip control.

        Of all that do, those with the least sum of squared volumes, q̇ = W Jᵀ (J W Jᵀ)⁻¹ v with W = D⁻² of the
        displacements; a joint at its end does not move beyond it. If their flows are more than the pump has, all slow down
        alike, as valves that share the flow let them: the tip keeps its direction.

        Args:
            joints: (4, ...).
            velocity: (3, ...).
            available: Flow of the pump [m³/s].
            damping: Share of the mean of J W Jᵀ by which it is kept from being singular, where the booms are in line.
        """
        places, wanted = np.asarray(joints, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
        jacobian, weights = self.jacobian(joints), self.displacements(joints) ** -2.0
        low, high = (np.stack(np.broadcast_arrays(*ends, places[0])[:4]) for ends in zip(*self.limits, strict=True))
        rates = _least(jacobian, weights, wanted, damping)
        for _ in range(len(JOINTS)):
            stopped = ((places <= low) & (rates < 0.0)) | ((places >= high) & (rates > 0.0))
            if not np.any(stopped & (weights > 0.0)):
                break
            weights = np.where(stopped, 0.0, weights)
            rates = _least(jacobian, weights, wanted, damping)
        asked = self.flows(joints, rates).sum(axis=0)
        return rates * np.minimum(1.0, available / np.maximum(asked, 1e-12))

    def joints_at(self, place: ArrayLike, out: ArrayLike = 0.0) -> NDArray[np.float64]:
        """Joints (4, ...) that bring the tip to ``place`` (3, ...) [m] with the extension ``out`` [m].

        The slew follows from the direction, lift and fold from the triangle of boom, stick and the way from the lift's pin
        to the tip (law of cosines), with the knee above that way.

        Raises:
            ValueError: a place out of reach, or one that asks a joint for more than its range; the message names it.
        """
        x, y, z = np.asarray(place, dtype=np.float64)
        out = np.asarray(out, dtype=np.float64)
        along, up = np.hypot(x, y) - self.lift.offset, z - self.lift.height
        boom, stick = np.asarray(self.boom.length), self.stick.length + out
        cosine = (along**2 + up**2 - boom**2 - stick**2) / (2.0 * boom * stick)
        if np.any(np.abs(cosine) > 1.0):
            raise ValueError(
                f"the tip cannot be {np.hypot(along, up).flat[0]:.2f} m from the lift's pin with the telescope "
                f"{out.flat[0]:.2f} m out: it reaches {np.abs(boom - stick).flat[0]:.2f} to {(boom + stick).flat[0]:.2f} m"
            )
        fold = -np.arccos(cosine)
        lift = np.arctan2(up, along) - np.arctan2(stick * np.sin(fold), boom + stick * np.cos(fold))
        joints = np.stack(np.broadcast_arrays(np.arctan2(y, x), lift, fold, out))
        self.check_joints(joints)
        return joints

    def check_joints(self, joints: ArrayLike) -> None:
        """ValueError that names joint, value and range if ``joints`` (4, ...) leave their ranges."""
        values = np.asarray(joints, dtype=np.float64)
        if values.shape[:1] != (4,):
            raise ValueError(f"joints have shape {values.shape}, but must be (4, ...): {', '.join(JOINTS)}")
        for name, value, (low, high) in zip(JOINTS, values, self.limits, strict=True):
            outside = ~((value >= low - 1e-9) & (value <= high + 1e-9))
            if np.any(outside):
                worst = np.ravel(value)[int(np.argmax(outside))]
                unit, size = ("m", 1.0) if name == "telescope" else ("deg", np.degrees(1.0))
                raise ValueError(
                    f"{name} is {size * worst:.4g} {unit}, but must be in [{size * np.min(low):.4g}, "
                    f"{size * np.max(high):.4g}] {unit}"
                )


def _least(
    jacobian: NDArray[np.float64], weights: NDArray[np.float64], velocity: NDArray[np.float64], damping: float
) -> NDArray[np.float64]:
    """Rates W Jᵀ (J W Jᵀ + λ 1)⁻¹ v (4, ...), λ the ``damping`` as a share of the mean of the diagonal."""
    weighted = weights * jacobian
    square = np.einsum("ik...,jk...->...ij", weighted, jacobian)
    square = square + damping * np.trace(square, axis1=-2, axis2=-1)[..., None, None] / 3.0 * np.eye(3)
    wanted = np.moveaxis(np.broadcast_to(velocity, (3, *square.shape[:-2])), 0, -1)[..., None]
    return np.einsum("ik...,...i->k...", weighted, np.linalg.solve(square, wanted)[..., 0])


def crane_parameters() -> dict[str, Parameter]:
    """Every parameter of the crane by dotted key, with unit, range and source."""
    return read_parameters(Path(str(files("aoro_gym").joinpath("machine", "crane.toml"))))


def forwarder_crane() -> Crane:
    """The crane that comes with the package, of the class of the vehicle's own; not validated."""
    return filled_section(Crane, "", crane_parameters())


def filled_section(kind: Any, prefix: str, entries: dict[str, Parameter]) -> Any:
    """Instance of a section from the entries whose keys begin with ``prefix``."""
    members = {}
    for one in fields(kind):
        key = f"{prefix}{one.name}"
        if is_dataclass(one.type):
            members[one.name] = filled_section(one.type, f"{key}.", entries)
            continue
        entry, declaration = entries[key], one.metadata["declaration"]
        if not np.all(declaration.admits(entry.si)):
            raise ValueError(f"{key} = {entry.value} {entry.unit}: must be finite and {declaration.bounds(entry.unit)}")
        members[one.name] = entry.si
    return kind(**members)
