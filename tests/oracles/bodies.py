"""Float64 reference of the 15-degree-of-freedom tree: the composite-rigid-body and recursive Newton-Euler algorithms.

The machine is a list of ten rigid bodies (two frames, four arms with their motors, four wheels), each with a parent and
one revolute joint; the front frame floats. Nothing below the list knows what machine it is: mass matrix and bias force
come from spatial (6-D) vectors over the tree, all written about one point (the hinge origin) in one set of axes (those
of the front frame, fixed in space at the instant), so that no body-to-body transforms are needed.

Source: R. Featherstone, *Rigid Body Dynamics Algorithms*, Springer 2008: spatial vectors ch. 2, recursive Newton-Euler
sec. 5.3, composite rigid body sec. 6.2, floating base sec. 9.4.

Conventions
-----------
SI units. Every array carries an optional trailing batch shape ``...``; vectors come first: (3, 4, ...) is one vector a
wheel. Axes x forward, y left, z up. Wheels and arms: front left, front right, rear left, rear right. Halves: front,
rear.

Pose ``q`` (16, ...)::

    0:3    hinge origin [m], world
    3:7    quaternion w, x, y, z of the front frame (front frame to world); normalised before use
    7      joint angle θ [rad]: heading of the front frame relative to the rear one
    8:12   arm angles φ [rad]: elevation of the wheel above the pivot
    12:16  wheel angles ψ [rad] relative to the arm

Velocity ``v`` (15, ...)::

    0:3    velocity of the hinge origin [m/s], front-frame axes
    3:6    angular velocity of the front frame [rad/s], front-frame axes
    6      θ' [rad/s]
    7:11   φ' [rad/s]
    11:15  wheel rates w = ψ' [rad/s] relative to the arm (what the motor sees)

``accelerations`` returns the time derivative of these fifteen numbers (so 0:3 are derivatives of components along
moving axes, not the inertial acceleration).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

HALF_OF_WHEEL = np.array([0, 0, 1, 1])
"""Half (0 front, 1 rear) that carries each wheel."""
DIRECTION_OF_WHEEL = np.array([1.0, 1.0, -1.0, -1.0])
"""+1 where the arm leads (front), -1 where it trails (rear)."""
SIDE_OF_WHEEL = np.array([1.0, -1.0, 1.0, -1.0])
"""+1 left, -1 right."""


@dataclass(frozen=True)
class Body:
    """A rigid body on a revolute joint; vectors in the axes of the body, or of the parent where said."""

    name: str
    parent: int  # index in the list; -1: floats
    axis: np.ndarray  # (3,) joint axis, the same in parent and body axes
    anchor: np.ndarray  # (3,) [m] origin of the body (a point of the joint axis) in parent axes
    mass: float  # [kg]
    cog: np.ndarray  # (3,) [m] centre of mass from the body's origin
    inertia: np.ndarray  # (3, 3) [kg m²] about the centre of mass


@dataclass(frozen=True)
class Kinematics:
    """Poses and velocities of frames and wheels; leading axes as said, then the batch."""

    rotation: np.ndarray  # (3, 3, 2, ...) half-frame to world: front, rear
    hinge: np.ndarray  # (3, ...) [m] hinge origin, world
    hinge_velocity: np.ndarray  # (3, ...) [m/s] world
    frame_angular: np.ndarray  # (3, 2, ...) [rad/s] angular velocity of each frame, world
    wheel_center: np.ndarray  # (3, 4, ...) [m] world
    wheel_velocity: np.ndarray  # (3, 4, ...) [m/s] of the wheel centres, world
    wheel_angular: np.ndarray  # (3, 4, ...) [rad/s] angular velocity of each wheel including its spin, world
    spin: np.ndarray  # (4, ...) [rad/s] absolute spin Ω: wheel_angular along the axle (the half-frame's y)
    snapshot: Snapshot = field(repr=False)  # for `accelerations`, which then need not repeat the forward pass

    def to_world(self, x, half):
        """Vectors ``x`` (3, n, ...) in the axes of the halves ``half`` (n,) as world vectors (3, n, ...)."""
        return np.einsum("ijn...,jn...->in...", self.rotation[:, :, half], x)

    def to_half(self, x, half):
        """World vectors ``x`` (3, n, ...) in the axes of the halves ``half`` (n,)."""
        return np.einsum("jin...,jn...->in...", self.rotation[:, :, half], x)


def machine_bodies(machine) -> list[Body]:
    """The ten bodies of ``machine``: front, rear, arms (each with its motor), wheels.

    Uses independent parameters only.
    """
    frame, arm, wheel = machine.frame, machine.arm, machine.wheel
    height = machine.arm.pivot_height
    zero, y, z = np.zeros(3), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    half = 0.5 * frame.track

    bodies = []
    for name, section, s, parent in (("front", frame.front, 1.0, -1), ("rear", frame.rear, -1.0, 0)):
        cog = np.array([s * (section.axle_distance - section.cog_offset), 0.0, section.cog_height])
        inertia = np.diag([section.inertia_xx, section.inertia_yy, section.inertia_zz])
        own, load = (section.mass, cog, inertia), machine.payload
        if s < 0.0 and machine.loaded:  # fixed in the middle of its bunk
            moments = np.diag([load.inertia_xx, load.inertia_yy, load.inertia_zz])
            own = _joined(own, (load.mass, np.array([-load.distance, 0.0, load.cog_height]), moments))
        bodies.append(Body(name, parent, -z, zero, *own))

    # an arm's own axes coincide with the frame's at φ = 0: x is +e (front) or -e (rear)
    for i, name in enumerate(("fl", "fr", "rl", "rr")):
        s, side, h = DIRECTION_OF_WHEEL[i], SIDE_OF_WHEEL[i], HALF_OF_WHEEL[i]
        section = (frame.front, frame.rear)[h]
        pivot = np.array([s * (section.axle_distance - arm.length), side * arm.pivot_lateral, height])
        outward = half - arm.pivot_lateral
        link = (
            arm.mass,
            np.array([s * arm.cog_fraction * arm.length, side * 0.5 * outward, 0.0]),
            np.diag([arm.inertia_axial, arm.inertia_transverse, arm.inertia_transverse]),
        )
        motor = (arm.motor_mass, np.array([s * arm.length, side * outward, 0.0]), np.zeros((3, 3)))
        bodies.append(Body(f"arm_{name}", int(h), -s * y, pivot, *_joined(link, motor)))

    for i, name in enumerate(("fl", "fr", "rl", "rr")):
        s, side = DIRECTION_OF_WHEEL[i], SIDE_OF_WHEEL[i]
        axle = np.array([s * arm.length, side * (half - arm.pivot_lateral), 0.0])
        inertia = np.diag([wheel.inertia_transverse, wheel.inertia_spin, wheel.inertia_transverse])
        bodies.append(Body(f"wheel_{name}", 2 + i, y, axle, wheel.mass, zero, inertia))
    return bodies


def _joined(*parts: tuple[float, np.ndarray, np.ndarray]) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia of rigidly joined (mass, cog, inertia) in common axes."""
    mass = sum(m for m, _, _ in parts)
    cog, inertia = np.zeros(3), np.zeros((3, 3))
    for m, c, _ in parts:
        cog += m / mass * c
    for m, c, own in parts:
        r = c - cog
        inertia += own + m * (r @ r * np.eye(3) - np.outer(r, r))
    return mass, cog, inertia


class Tree:
    """Dynamics of a floating tree of ``bodies`` (parents first) under ``gravity`` [m/s²], world -z.

    Pose (7 + n, ...) and velocity (6 + n, ...) are those of the module's head with n = len(bodies) - 1 joint angles and
    rates in the order of the bodies.
    """

    def __init__(self, bodies: list[Body], gravity: float = 9.81):
        self.gravity = float(gravity)
        self.bodies = bodies
        num = len(bodies)
        self.mass = np.array([b.mass for b in bodies], float)
        self._cog = np.array([b.cog for b in bodies], float)
        self._inertia = np.array([b.inertia for b in bodies], float)
        self._anchor = np.array([b.anchor for b in bodies], float)
        self._axis = np.array([b.axis for b in bodies], float)
        self._skew = _skew(self._axis[1:])
        self._skew_squared = self._skew @ self._skew

        # path[b, j] = 1 where freedom j moves body b; body b > 0 owns freedom 5 + b
        owner = np.concatenate([np.zeros(6, int), np.arange(1, num)])
        path = np.zeros((num, owner.size))
        depth = np.zeros(num, int)
        for b, body in enumerate(bodies):
            if body.parent >= 0:
                path[b] = path[body.parent]
                depth[b] = depth[body.parent] + 1
            path[b, owner == b] = 1.0
        self._path = path
        self._on_path = path[owner].T.astype(bool)  # [i, j]: freedom i moves the body that owns freedom j
        parent = np.array([b.parent for b in bodies])
        self._levels = [(np.flatnonzero(depth == d), parent[depth == d]) for d in range(1, depth.max() + 1)]

    # ------------------------------------------------------------------------------------------------------- interface
    def forward_dynamics(self, x: Snapshot, joint_torque=None, force=None, moment=None):
        """dv/dt (6 + n, ...) of snapshot ``x``.

        joint_torque (n, ...) [N m]; force (3, bodies, ...) [N] and moment (3, bodies, ...) [N m], world axes, act on
        each body at, and about, its origin.
        """
        applied = -self._bias(x, force, moment)
        if joint_torque is not None:
            applied[:, 6:] += _batch_first(joint_torque, x, (len(self.bodies) - 1,))
        return _batch_last(np.linalg.solve(self._mass_matrix(x), applied[..., None])[..., 0], x)

    def mass_matrix(self, q):
        """Mass matrix (6 + n, 6 + n, ...) in the coordinates of ``v``, by the composite-rigid-body algorithm."""
        x = self.snapshot(q)
        return _batch_last(self._mass_matrix(x), x)

    def pose_rate(self, q, v):
        """dq/dt (7 + n, ...). The quaternion follows q' = q∘(0, ω)/2; its length is left as it is."""
        q, v = np.asarray(q, float), np.asarray(v, float)
        w, i, j, k = q[3:7]
        a, b, c = v[3:6]
        rate = np.empty((q.shape[0], *np.broadcast_shapes(q.shape[1:], v.shape[1:])))
        rate[0:3] = np.einsum("ij...,j...->i...", quaternion_matrix(q[3:7]), v[0:3])
        rate[3] = -0.5 * (i * a + j * b + k * c)
        rate[4] = 0.5 * (w * a + j * c - k * b)
        rate[5] = 0.5 * (w * b + k * a - i * c)
        rate[6] = 0.5 * (w * c + i * b - j * a)
        rate[7:] = v[6:]
        return rate

    def energy(self, q, v):
        """Kinetic plus potential energy [J] (...); potential zero at world z = 0."""
        x = self.snapshot(q, v)
        kinetic = 0.5 * np.sum(x.velocity * _momentum(x, x.velocity), (-1, -2))
        height = np.einsum("kj,knj->kn", x.to_world[:, 2], x.cog) + x.hinge[:, 2, None]
        return _batch_last(kinetic + self.gravity * height @ self.mass, x)

    def linear_momentum(self, q, v):
        """Linear momentum [kg m/s] (3, ...), world."""
        x = self.snapshot(q, v)
        return _batch_last(_rotate(x.to_world, _momentum(x, x.velocity).sum(1)[:, 3:]), x)

    def angular_momentum(self, q, v, about=(0.0, 0.0, 0.0)):
        """Angular momentum [kg m²/s] (3, ...), world axes, about the world point ``about`` (3,) or (3, ...)."""
        x = self.snapshot(q, v)
        total = _momentum(x, x.velocity).sum(1)
        linear, angular = _rotate(x.to_world, total[:, 3:]), _rotate(x.to_world, total[:, :3])
        return _batch_last(angular + _cross(x.hinge - _batch_first(about, x, (3,)), linear), x)

    def center_of_mass(self, q):
        """Centre of mass [m] (3, ...), world."""
        x = self.snapshot(q)
        local = np.einsum("n,knj->kj", self.mass / self.mass.sum(), x.cog)
        return _batch_last(x.hinge + _rotate(x.to_world, local), x)

    # ------------------------------------------------------------------------------------------------------ algorithms
    def snapshot(self, q, v=None) -> Snapshot:
        """Forward pass: poses, joint axes and velocities of all bodies at pose ``q`` and velocity ``v`` (default 0)."""
        num = len(self.bodies)
        q = np.asarray(q, float)
        v = np.zeros((num + 5, *q.shape[1:])) if v is None else np.asarray(v, float)
        if q.shape[:1] != (num + 6,) or v.shape[:1] != (num + 5,):
            raise ValueError(f"q and v of shapes {q.shape} and {v.shape} must be ({num + 6}, ...) and ({num + 5}, ...)")
        x = Snapshot()
        x.batch = np.broadcast_shapes(q.shape[1:], v.shape[1:])
        q, v = _batch_first(q, x, (num + 6,)), _batch_first(v, x, (num + 5,))
        size = q.shape[0]
        x.hinge = q[:, 0:3]
        x.to_world = np.moveaxis(quaternion_matrix(q[:, 3:7].T), -1, 0)

        # Rodrigues: the rotation of every joint, then outward through the tree
        angle = q[:, 7:, None, None]
        joint = np.eye(3) + np.sin(angle) * self._skew + (1.0 - np.cos(angle)) * self._skew_squared
        x.rotation = rotation = np.empty((size, num, 3, 3))
        x.origin = origin = np.empty((size, num, 3))
        rotation[:, 0], origin[:, 0] = np.eye(3), 0.0
        for here, parent in self._levels:
            rotation[:, here] = rotation[:, parent] @ joint[:, here - 1]
            origin[:, here] = origin[:, parent] + _rotate(rotation[:, parent], self._anchor[here])
        x.cog = origin + _rotate(rotation, self._cog)
        x.inertia = rotation @ self._inertia @ np.swapaxes(rotation, -1, -2)
        x.mass = self.mass[:, None]

        # joint motion vectors (angular, linear at the base's origin); the base has unit vectors, linear first
        x.motion = motion = np.zeros((size, num + 5, 6))
        motion[:, [0, 1, 2, 3, 4, 5], [3, 4, 5, 0, 1, 2]] = 1.0
        axis = _rotate(rotation[:, 1:], self._axis[1:])
        motion[:, 6:, :3] = axis
        motion[:, 6:, 3:] = _cross(origin[:, 1:], axis)
        x.joint_velocity = motion * v[:, :, None]
        x.velocity = self._path @ x.joint_velocity
        return x

    def _bias(self, x, force, moment):
        """Recursive Newton-Euler with zero dv/dt: generalised force (size, 6 + n)."""
        # S' = v × S for an axis that its body carries along; gravity as an upward acceleration of the base
        turning = _cross_motion(x.velocity[:, 1:], x.joint_velocity[:, 6:])
        acceleration = self._path[:, 6:] @ turning
        acceleration[..., 3:] += self.gravity * x.to_world[:, None, 2, :]
        needed = _momentum(x, acceleration) + _cross_force(x.velocity, _momentum(x, x.velocity))
        to_base = np.swapaxes(x.to_world, -1, -2)[:, None]
        shape = (3, len(self.bodies))
        if force is not None:
            given = _rotate(to_base, np.swapaxes(_batch_first(force, x, shape), 1, 2))
            needed[..., 3:] -= given
            needed[..., :3] -= _cross(x.origin, given)
        if moment is not None:
            needed[..., :3] -= _rotate(to_base, np.swapaxes(_batch_first(moment, x, shape), 1, 2))
        return np.sum(x.motion * (self._path.T @ needed), -1)

    def _mass_matrix(self, x):
        """Composite-rigid-body algorithm: (size, 6 + n, 6 + n)."""
        size, num = x.cog.shape[:2]
        spatial = np.zeros((size, num, 6, 6))
        skew = _skew(x.cog)
        moment = x.mass[..., None] * skew
        spatial[..., :3, :3] = x.inertia - moment @ skew
        spatial[..., :3, 3:] = moment
        spatial[..., 3:, :3] = -moment
        spatial[..., [3, 4, 5], [3, 4, 5]] = x.mass
        # inertia of everything outward of each freedom, and the force that its unit acceleration takes
        composite = (self._path.T @ spatial.reshape(size, num, 36)).reshape(size, -1, 6, 6)
        force = (composite @ x.motion[..., None])[..., 0]
        work = x.motion @ np.swapaxes(force, -1, -2)
        return np.where(self._on_path, work, np.where(self._on_path.T, np.swapaxes(work, -1, -2), 0.0))


class Snapshot:
    """What the forward pass leaves: arrays (size, bodies, ...) in the base's axes about the base's origin."""

    batch: tuple[int, ...]
    hinge: np.ndarray  # (size, 3) [m] base origin, world
    to_world: np.ndarray  # (size, 3, 3)
    rotation: np.ndarray  # (size, bodies, 3, 3) body to base
    origin: np.ndarray  # (size, bodies, 3) [m]
    cog: np.ndarray  # (size, bodies, 3) [m]
    inertia: np.ndarray  # (size, bodies, 3, 3) [kg m²] about the centre of mass
    mass: np.ndarray  # (bodies, 1) [kg]
    motion: np.ndarray  # (size, freedoms, 6) joint motion vectors
    joint_velocity: np.ndarray  # (size, freedoms, 6) motion vectors times their rates
    velocity: np.ndarray  # (size, bodies, 6) spatial velocities


class BodyModel(Tree):
    """The tree of ``machine`` (one machine, float parameters) under ``gravity`` [m/s²], world -z."""

    def __init__(self, machine, gravity: float = 9.81):
        super().__init__(machine_bodies(machine), gravity)

    def kinematics(self, q, v) -> Kinematics:
        """World poses and velocities of frames and wheels at pose ``q`` (16, ...) and velocity ``v`` (15, ...)."""
        x = self.snapshot(q, v)
        frames, wheels = slice(0, 2), slice(6, 10)
        rotate = x.to_world[:, None]
        angular, linear = x.velocity[:, :, :3], x.velocity[:, :, 3:]
        center = x.origin[:, wheels]

        def world(local):
            return _batch_last(np.swapaxes(_rotate(rotate, local), 1, 2), x)

        return Kinematics(
            rotation=_batch_last(np.moveaxis(rotate @ x.rotation[:, frames], 1, 3), x),
            hinge=_batch_last(x.hinge, x),
            hinge_velocity=_batch_last(_rotate(x.to_world, linear[:, 0]), x),
            frame_angular=world(angular[:, frames]),
            wheel_center=world(center) + _batch_last(x.hinge, x)[:, None],
            wheel_velocity=world(linear[:, wheels] + _cross(angular[:, wheels], center)),
            wheel_angular=world(angular[:, wheels]),
            spin=_batch_last(np.sum(angular[:, wheels] * x.rotation[:, wheels, :, 1], -1), x),
            snapshot=x,
        )

    def accelerations(
        self,
        q,
        v,
        tau_theta: ArrayLike = 0.0,
        tau_phi: ArrayLike = 0.0,
        tau_wheel: ArrayLike = 0.0,
        wheel_force: ArrayLike | None = None,
        wheel_moment: ArrayLike | None = None,
        frame_force: ArrayLike | None = None,
        frame_moment: ArrayLike | None = None,
        *,
        kinematics: Kinematics | None = None,
    ):
        """dv/dt (15, ...) at pose ``q`` (16, ...) and velocity ``v`` (15, ...).

        tau_theta (...) [N m] acts between the frames, drives θ up; tau_phi (4, ...) raises the arms; tau_wheel (4, ...)
        acts between arm and wheel, drives forward. wheel_force (3, 4, ...) [N] and wheel_moment (3, 4, ...) [N m] act
        on each wheel at, and about, its centre; frame_force (3, 2, ...) and frame_moment (3, 2, ...) on each frame at,
        and about, the hinge origin: all four in world axes, None for none. Of a moment on a wheel, the part along the
        axle spins the wheel; the rest loads the arm. ``kinematics`` of the same ``q`` and ``v`` saves the forward pass.
        """
        x = self.snapshot(q, v) if kinematics is None else kinematics.snapshot
        torque = np.empty((9, *x.batch))
        torque[0], torque[1:5], torque[5:9] = tau_theta, _trailing(tau_phi, x), _trailing(tau_wheel, x)
        force = moment = None
        if wheel_force is not None or frame_force is not None:
            force = np.zeros((3, 10, *x.batch))
            force[:, 0:2] = 0.0 if frame_force is None else _trailing(frame_force, x, 2)
            force[:, 6:10] = 0.0 if wheel_force is None else _trailing(wheel_force, x, 2)
        if wheel_moment is not None or frame_moment is not None:
            moment = np.zeros((3, 10, *x.batch))
            moment[:, 0:2] = 0.0 if frame_moment is None else _trailing(frame_moment, x, 2)
            moment[:, 6:10] = 0.0 if wheel_moment is None else _trailing(wheel_moment, x, 2)
        return self.forward_dynamics(x, torque, force, moment)


def quaternion_matrix(quaternion):
    """Rotation matrix (3, 3, ...) of a quaternion w, x, y, z (4, ...) of any length but zero."""
    w, x, y, z = quaternion / np.sqrt(np.sum(np.square(quaternion), 0))
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


# ---------------------------------------------------------------------------------------------- samples for comparisons
@dataclass(frozen=True)
class Sample:
    """States and loads; the fields have the shapes of the arguments of ``BodyModel.accelerations``, batch (size,)."""

    q: np.ndarray
    v: np.ndarray
    tau_theta: np.ndarray
    tau_phi: np.ndarray
    tau_wheel: np.ndarray
    wheel_force: np.ndarray
    wheel_moment: np.ndarray
    frame_force: np.ndarray
    frame_moment: np.ndarray

    @property
    def loads(self) -> tuple[np.ndarray, ...]:
        """Everything but the state, in the order of the arguments."""
        return (
            self.tau_theta,
            self.tau_phi,
            self.tau_wheel,
            self.wheel_force,
            self.wheel_moment,
            self.frame_force,
            self.frame_moment,
        )

    def one(self, i: int) -> Sample:
        """Sample ``i`` without a batch axis."""
        return Sample(**{name: value[..., i] for name, value in vars(self).items()})


def random_sample(rng: np.random.Generator, size: int) -> Sample:
    """``size`` states in any attitude, joint and arms within their ranges, rates of several rad/s, loads up to what the
    machine's cylinders, motors and tires bring about (tens of kN and kN m, normally distributed)."""

    def uniform(bound, *shape):
        return rng.uniform(-bound, bound, (*shape, size))

    def normal(scale, *shape):
        return scale * rng.standard_normal((*shape, size))

    quaternion = normal(1.0, 4)
    quaternion /= np.linalg.norm(quaternion, axis=0)
    position, theta, phi, psi = uniform(10.0, 3), uniform(0.7, 1), uniform(0.5, 4), uniform(np.pi, 4)
    return Sample(
        q=np.concatenate([position, quaternion, theta, phi, psi]),
        v=np.concatenate([normal(3.0, 3), normal(2.0, 3), normal(2.0, 1), normal(3.0, 4), normal(8.0, 4)]),
        tau_theta=normal(4e4),
        tau_phi=normal(4e4, 4),
        tau_wheel=normal(1e4, 4),
        wheel_force=normal(4e4, 3, 4),
        wheel_moment=normal(1e4, 3, 4),
        frame_force=normal(4e4, 3, 2),
        frame_moment=normal(4e4, 3, 2),
    )


def uneven_machines(machine, rng: np.random.Generator, count: int):
    """Batched machine of ``count`` variants with every parameter of the bodies changed by up to 8 %, so that no two
    that happen to be equal can be mixed up unnoticed; variant 0 is ``machine`` itself."""
    names = ("mass", "axle_distance", "cog_offset", "cog_height", "inertia_xx", "inertia_yy", "inertia_zz")
    keys = [f"frame.{half}.{name}" for half in ("front", "rear") for name in names]
    names = ("length", "pivot_lateral", "mass", "motor_mass", "cog_fraction", "inertia_transverse", "inertia_axial")
    keys += [f"arm.{name}" for name in names]
    keys += ["wheel.mass", "wheel.inertia_spin", "wheel.inertia_transverse", "frame.track"]
    factors = rng.uniform(0.92, 1.08, (len(keys), count))
    factors[:, 0] = 1.0
    return machine.scale(dict(zip(keys, factors, strict=True)))


def relative_error(mass_matrix, found, expected):
    """Error (...) of accelerations ``found`` (15, ...) against ``expected``, relative, in the norm of the mass matrix
    (15, 15, ...): √(δᵀMδ / aᵀMa), which weighs metres and radians by the kinetic energy that they carry."""
    error = found - expected
    squared = [np.einsum("i...,ij...,j...->...", a, mass_matrix, a) for a in (error, expected)]
    return np.sqrt(squared[0] / squared[1])


# ------------------------------------------------------------------------------- vectors in the last axis, batch first
def _rotate(matrix, vector):
    return (matrix @ vector[..., None])[..., 0]


def _cross(a, b):
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def _skew(a):
    out = np.zeros((*a.shape, 3))
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = a[..., 0], a[..., 1], a[..., 2]
    out[..., 1, 2], out[..., 2, 0], out[..., 0, 1] = -a[..., 0], -a[..., 1], -a[..., 2]
    return out


def _momentum(x, motion):
    """Spatial inertia times a motion vector (angular, linear), for every body."""
    angular = motion[..., :3]
    linear = x.mass * (motion[..., 3:] + _cross(angular, x.cog))
    return np.concatenate([_rotate(x.inertia, angular) + _cross(x.cog, linear), linear], -1)


def _cross_motion(v, m):
    """v × m for a motion vector m (Featherstone 2008, eq. 2.31)."""
    w, o = v[..., :3], v[..., 3:]
    return np.concatenate([_cross(w, m[..., :3]), _cross(o, m[..., :3]) + _cross(w, m[..., 3:])], -1)


def _cross_force(v, f):
    """v ×* f for a force vector f (Featherstone 2008, eq. 2.32)."""
    w, o = v[..., :3], v[..., 3:]
    return np.concatenate([_cross(w, f[..., :3]) + _cross(o, f[..., 3:]), _cross(w, f[..., 3:])], -1)


def _trailing(a, x, leading=1):
    """Argument with ``leading`` axes before the batch: one without batch axes gets them."""
    a = np.asarray(a, float)
    return a.reshape(a.shape + (1,) * len(x.batch)) if a.ndim == leading else a


def _batch_first(a, x, shape):
    """Argument (*shape, ...) as (size, *shape)."""
    a = np.broadcast_to(_trailing(a, x, len(shape)), shape + x.batch)
    return np.moveaxis(a.reshape(*shape, -1), -1, 0)


def _batch_last(a, x):
    """Result (size, ...) as (..., *batch)."""
    a = np.moveaxis(a, 0, -1)
    return a.reshape(a.shape[:-1] + x.batch)
