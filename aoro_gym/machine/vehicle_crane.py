"""How the vehicle carries its crane: where it stands on the front frame, how it lies in transport, and what moves it.

The masses of the machine files are those of the published machine, whose front frame carries the crane in its transport
pose. With a crane of its own joints, that crane is taken off the front frame as a rigid body and put back as a chain: in
the transport pose mass, centre and tensor of inertia are the published machine's to rounding. Units: m, kg, s, rad, N, Pa.
"""

from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine.crane import Crane, filled_section, forwarder_crane
from aoro_gym.machine.machine_file import Parameter, read_parameters
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity, finite, non_negative, positive, section, within

Floats = NDArray[np.float64]

GRAPPLE_DROP = 1.1
"""Distance [m] from the tip down to the middle of a log that is held. (E: rotator and grapple of the class)"""


@section
class Foot:
    """Where the slewing axis stands on the front frame."""

    distance: Quantity = finite("m")  # in front of the hinge
    height: Quantity = positive("m")  # over the design ground plane


@section
class Transport:
    """Joints of the folded crane."""

    slew: Quantity = finite("rad")
    lift: Quantity = finite("rad")
    fold: Quantity = finite("rad")
    telescope: Quantity = non_negative("m")

    @property
    def joints(self) -> Floats:
        """(4, ...) in the order of :data:`aoro_gym.recording.commands.JOINTS`."""
        return np.stack(np.broadcast_arrays(self.slew, self.lift, self.fold, self.telescope)).astype(np.float64)


@section
class CraneValves:
    """Bank of four sections that share the flow of the load-sensing pump behind a priority valve for the steering."""

    slew_flow: Quantity = positive("m^3/s")  # of an open section at ``pressure_drop``
    lift_flow: Quantity = positive("m^3/s")
    fold_flow: Quantity = positive("m^3/s")
    telescope_flow: Quantity = positive("m^3/s")
    pressure_drop: Quantity = positive("Pa")  # over the open edge, kept by the compensators
    dead_band: Quantity = within("1", 0.0, 1.0, high_open=True)
    time_constant: Quantity = positive("s")
    rate_limit: Quantity = positive("1/s")
    holding_pressure: Quantity = positive("Pa")
    holding_ramp: Quantity = positive("Pa")
    pilot_ratio: Quantity = non_negative("1")
    port_relief: Quantity = positive("Pa")
    port_ramp: Quantity = positive("Pa")
    port_flow: Quantity = positive("m^3/s")
    priority_pressure: Quantity = non_negative(
        "Pa"
    )  # of supply over the steering's load, below which the crane gets nothing
    priority_ramp: Quantity = positive("Pa")

    @property
    def cv(self) -> Floats:
        """Orifice constants of the open sections [m³/s/√Pa], (4, ...)."""
        flows = np.broadcast_arrays(self.slew_flow, self.lift_flow, self.fold_flow, self.telescope_flow)
        return np.stack(flows) / np.sqrt(self.pressure_drop)


@section
class CraneHoses:
    """Oil between the valves and a chamber, and of the chamber when it is closed."""

    volume: Quantity = positive("m^3")
    bulk_modulus: Quantity = positive("Pa")
    dead_volume: Quantity = positive("m^3")


@section
class CraneFriction:
    """Dry and viscous friction of the joints."""

    slew: Quantity = non_negative("N*m")
    cylinders: Quantity = non_negative("N")
    presliding: Quantity = positive("1")  # way [rad], of the telescope [m], after which friction is all there
    slew_viscous: Quantity = non_negative("N*m*s/rad")
    cylinder_viscous: Quantity = non_negative("N*s/m")


@section
class CraneStops:
    """Springs and dampers at the ends of the joints."""

    stiffness: Quantity = positive("N*m/rad")
    damping: Quantity = non_negative("N*m*s/rad")
    telescope_stiffness: Quantity = positive("N/m")
    telescope_damping: Quantity = non_negative("N*s/m")


@section
class LogContact:
    """Contact with the ground of each of three places of a log: the ends and the middle of its lower side."""

    stiffness: Quantity = positive("N/m")
    damping: Quantity = non_negative("N*s/m")
    friction: Quantity = non_negative("1")


@section
class CraneMount:
    """Place, transport pose, valves, hoses, friction, stops, and contact of a log with the ground."""

    foot: Foot
    transport: Transport
    valves: CraneValves
    hoses: CraneHoses
    friction: CraneFriction
    stops: CraneStops
    contact: LogContact


def crane_mount_parameters() -> dict[str, Parameter]:
    """Every parameter of the mount by dotted key, with unit, range and source."""
    return read_parameters(Path(str(files("aoro_gym").joinpath("machine", "vehicle_crane.toml"))))


def crane_mount() -> CraneMount:
    """The mount that comes with the package; not validated."""
    return filled_section(CraneMount, "", crane_mount_parameters())


@dataclass(frozen=True, eq=False)
class VehicleCrane:
    """A crane as twins take it."""

    crane: Crane = field(default_factory=forwarder_crane)
    mount: CraneMount = field(default_factory=crane_mount)
    drive: str = "cylinders"
    """What moves the joints: ``"cylinders"``, by oil and valves, or ``"torques"``, without oil, friction and stops."""
    start: tuple[float, float, float, float] | None = None
    """Joints after a reset; those of the transport pose by default."""
    log_contact: bool = True
    """Whether the ground bears a log in the grapple."""

    def __post_init__(self) -> None:
        if self.drive not in ("cylinders", "torques"):
            raise ValueError(f"drive is {self.drive!r}, but must be one of: cylinders, torques")
        self.crane.check_joints(self.mount.transport.joints)
        self.crane.check_joints(self.start_joints)

    @property
    def start_joints(self) -> Floats:
        """Joints (4, ...) after a reset."""
        return self.mount.transport.joints if self.start is None else np.asarray(self.start, dtype=np.float64)

    def tip(self, joints: ArrayLike) -> Floats:
        """Place (3, ...) of the tip [m] in the front frame: x ahead of the hinge, y left, z over the design ground plane."""
        x, y, z = self.crane.tip(joints)
        return np.stack([x + self.mount.foot.distance, y, z + self.mount.foot.height])

    def at_foot(self, place: ArrayLike) -> Floats:
        """A ``place`` (3, ...) in the front frame as the crane's kinematics take it, from its foot [m]."""
        x, y, z = np.asarray(place, dtype=np.float64)
        return np.stack(np.broadcast_arrays(x - self.mount.foot.distance, y, z - self.mount.foot.height))

    def folded(self) -> tuple[Floats, Floats, Floats]:
        """The crane in its transport pose as a rigid body about the hinge's origin, by variant (V,): masses (V,) [kg], first
        moments (V, 3) [kg m] and tensors of inertia (V, 3, 3) [kg m²]."""
        masses, places, tensors = bodies(self.crane, self.mount.transport.joints)
        foot = np.stack(np.broadcast_arrays(self.mount.foot.distance, 0.0, self.mount.foot.height), axis=-1)
        places = places + np.atleast_2d(foot)
        squares = np.einsum("bvi,bvi->bv", places, places)[..., None, None] * np.eye(3)
        about = masses[..., None, None] * (squares - np.einsum("bvi,bvj->bvij", places, places))
        return masses.sum(0), np.sum(masses[..., None] * places, axis=0), np.sum(tensors + about, axis=0)

    def check_fits(self, machine: Machine, numbers: ArrayLike | None = None) -> None:
        """ValueError if the front frame of a ``machine`` is not heavy enough to have carried this crane in transport; of
        cranes that differ, those of the twins ``numbers`` (K,), all by default."""
        frame = machine.frame.front
        one = np.stack(np.broadcast_arrays(frame.cog_x, 0.0, frame.cog_height), axis=-1).reshape(-1, 3)
        mass = np.atleast_1d(frame.mass)
        moments = np.stack(np.broadcast_arrays(frame.inertia_xx, frame.inertia_yy, frame.inertia_zz), axis=-1)
        crane, moment, tensor = (
            one if numbers is None or len(one) == 1 else one[np.asarray(numbers)] for one in self.folded()
        )
        left = mass - crane
        if np.any(left <= 0.0):
            raise ValueError(
                f"frame.front.mass is {np.min(mass):g} kg, but must be above the crane's {np.max(crane):g} kg, which it"
                " includes"
            )
        centre = (mass[:, None] * one - moment) / left[:, None]
        whole = moments.reshape(-1, 1, 3) * np.eye(3) + mass[:, None, None] * _steiner(one) - tensor
        least = np.linalg.eigvalsh(whole - left[:, None, None] * _steiner(centre)).min()
        if least <= 0.0:
            raise ValueError(
                f"the front frame without the folded crane has a moment of inertia of {least:.0f} kg m², but must have none"
                " that is not positive; change frame.front.inertia_xx, inertia_yy or inertia_zz, or the crane's foot and"
                " transport pose"
            )


def moments_of_log(mass: ArrayLike, length: ArrayLike, diameter: ArrayLike) -> tuple[Floats, Floats]:
    """Moments of inertia [kg m²] of logs, cylinders, about their axis and across it."""
    square = 0.25 * np.asarray(diameter, dtype=np.float64) ** 2
    weight = np.asarray(mass, dtype=np.float64)
    return 0.5 * weight * square, weight * (0.25 * square + np.asarray(length, dtype=np.float64) ** 2 / 12.0)


def size_of_log(mass: float, axial: float, transverse: float) -> tuple[float, float] | None:
    """Length and diameter [m] of the cylinder of a mass [kg] with such moments of inertia [kg m²]; None of none."""
    square = transverse - 0.5 * axial
    if mass <= 0.0 or axial <= 0.0 or square <= 0.0:
        return None
    return float(np.sqrt(12.0 * square / mass)), float(np.sqrt(8.0 * axial / mass))


def _steiner(place: Floats) -> Floats:
    """|p|² 1 − p pᵀ (V, 3, 3) of places (V, 3)."""
    return np.einsum("vi,vi->v", place, place)[:, None, None] * np.eye(3) - np.einsum("vi,vj->vij", place, place)


def bodies(crane: Crane, joints: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Pillar, boom, stick, extension and grapple of a ``crane`` at ``joints`` (4, ...), flattened to V variants: masses (5,
    V) [kg], places of their centres from the foot (5, V, 3) [m], and tensors of inertia about them (5, V, 3, 3) [kg m²]."""
    slew, lift, fold, out = (np.atleast_1d(one) for one in np.asarray(joints, dtype=np.float64))
    still = np.zeros_like(slew)
    radial = np.stack([np.cos(slew), np.sin(slew), still], axis=-1)
    up = np.array([0.0, 0.0, 1.0])

    def raised(angle: Floats) -> Floats:
        return np.cos(angle)[:, None] * radial + np.sin(angle)[:, None] * up

    def times(length: Quantity, way: Floats) -> Floats:
        return np.reshape(length, (-1, 1)) * way

    along, over, stick = raised(lift), raised(lift + 0.5 * np.pi), raised(lift + fold)
    pin = times(crane.lift.offset, radial) + times(crane.lift.height, up[None])
    knee = pin + times(crane.boom.length, along)
    reach = crane.stick.length + out
    inner = crane.extension
    parts = (
        (
            crane.pillar,
            times(crane.pillar.cog_forward, radial) + times(crane.pillar.cog_height, up[None]),
            up + 0.0 * along,
        ),
        (crane.boom, pin + times(crane.boom.cog_along, along) + times(crane.boom.cog_over, over), along),
        (crane.stick, knee + times(crane.stick.cog_along, stick), stick),
        (inner, knee + times(reach + inner.cog_along, stick), stick),
        (crane.grapple, knee + times(reach, stick), stick),
    )
    masses, places, tensors = [], [], []
    for part, place, axis in parts:
        axial, across = (
            np.reshape(getattr(part, f"inertia_{name}", 0.0), (-1, 1, 1)) for name in ("axial", "transverse")
        )
        tensor = across * np.eye(3) + (axial - across) * np.einsum("vi,vj->vij", axis, axis)
        masses.append(np.atleast_1d(part.mass))
        places.append(place)
        tensors.append(tensor)
    count = max(len(one) for kind in (masses, places, tensors) for one in kind)
    return tuple(
        np.stack([np.broadcast_to(one, (count, *one.shape[1:])) for one in kind]) for kind in (masses, places, tensors)
    )  # pyright: ignore[reportReturnType]
