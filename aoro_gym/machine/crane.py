"""A forwarder crane: its parameters with their sources, where its tip is, and which joints bring it where.

Four joints in a row: ``slew`` q₁ turns the pillar about the upright of its foot, left positive; ``lift`` q₂ raises the main
boom; ``fold`` q₃ raises the stick against the boom, in line at zero; ``telescope`` q₄ pushes the extension out of the stick.
The grapple hangs from the tip as a point mass. Axes at the foot: x forward, y left, z up. No cylinders yet: joints are
driven by torques, and by a force. Units: m, kg, s, rad, N.
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

JOINTS = ("slew", "lift", "fold", "telescope")
"""Names of the joints, in the order of their coordinates."""
_STRAIGHT = np.pi


@section
class Slew:
    """Bearing of the pillar."""

    range: Quantity = positive("rad")  # to either side


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

    def with_grapple(self, mass: ArrayLike) -> "Crane":
        """The crane with another ``mass`` [kg] at its tip: of the grapple and of the logs in it."""
        check_finite("mass", mass, "kg")
        if np.any(np.less(mass, 0.0)):
            raise ValueError(f"mass is {np.min(mass):g} kg, but must be at least 0")
        held = np.asarray(mass, dtype=np.float64)
        return replace(self, grapple=Grapple(mass=held if held.ndim else float(held)))

    def tip(self, joints: ArrayLike) -> NDArray[np.float64]:
        """Place (3, ...) of the tip [m] at ``joints`` (4, ...): q₁, q₂, q₃ [rad] and q₄ [m]."""
        slew, lift, fold, out = np.asarray(joints, dtype=np.float64)
        length = self.stick.length + out
        radius = self.lift.offset + self.boom.length * np.cos(lift) + length * np.cos(lift + fold)
        height = self.lift.height + self.boom.length * np.sin(lift) + length * np.sin(lift + fold)
        return np.stack(np.broadcast_arrays(radius * np.cos(slew), radius * np.sin(slew), height))

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
        limits = (
            (-self.slew.range, self.slew.range), (self.lift.low, self.lift.high), (self.fold.low, self.fold.high),
            (0.0 * np.asarray(self.telescope.stroke), self.telescope.stroke),
        )  # fmt: skip
        values = np.asarray(joints, dtype=np.float64)
        if values.shape[:1] != (4,):
            raise ValueError(f"joints have shape {values.shape}, but must be (4, ...): {', '.join(JOINTS)}")
        for name, value, (low, high) in zip(JOINTS, values, limits, strict=True):
            outside = ~((value >= low - 1e-9) & (value <= high + 1e-9))
            if np.any(outside):
                worst = np.ravel(value)[int(np.argmax(outside))]
                unit, size = ("m", 1.0) if name == "telescope" else ("deg", np.degrees(1.0))
                raise ValueError(
                    f"{name} is {size * worst:.4g} {unit}, but must be in [{size * np.min(low):.4g}, "
                    f"{size * np.max(high):.4g}] {unit}"
                )


def crane_parameters() -> dict[str, Parameter]:
    """Every parameter of the crane by dotted key, with unit, range and source."""
    return read_parameters(Path(str(files("aoro_gym").joinpath("machine", "crane.toml"))))


def forwarder_crane() -> Crane:
    """The crane that comes with the package, of the class of the vehicle's own; not validated."""
    return _filled(Crane, "", crane_parameters())


def _filled(kind: Any, prefix: str, entries: dict[str, Parameter]) -> Any:
    """Instance of a section from the entries whose keys begin with ``prefix``."""
    members = {}
    for one in fields(kind):
        key = f"{prefix}{one.name}"
        if is_dataclass(one.type):
            members[one.name] = _filled(one.type, f"{key}.", entries)
            continue
        entry, declaration = entries[key], one.metadata["declaration"]
        if not np.all(declaration.admits(entry.si)):
            raise ValueError(f"{key} = {entry.value} {entry.unit}: must be finite and {declaration.bounds(entry.unit)}")
        members[one.name] = entry.si
    return kind(**members)
