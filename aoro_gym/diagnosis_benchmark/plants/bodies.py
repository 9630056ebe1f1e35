"""The plants' bodies: two frames on an upright hinge, standing with held arms on four tires. As in the twin the
contact with the ground is a point of the unloaded tread, so that a wheel rolls on its unloaded radius.

Seven velocities u = (ẋ, ẏ, ψ̇_f, ψ̇_r, ż, α̇, β̇): the hinge at ground height in the plane of the ground, the headings of the
front and the rear frame, and heave, roll and pitch of the whole machine about the hinge's foot, small angles about the
axes x and y of the ground's plane. Wheels spin on their own. Axes x forward (uphill where the ground rises ahead), y left,
z along the ground's normal.
"""

from __future__ import annotations

import numpy as np

from aoro_gym.diagnosis_benchmark.plants.fluid import Array, Constants, Oil
from aoro_gym.diagnosis_benchmark.plants.linkage import Linkage

GRAVITY = 9.81
"""[m/s²]"""

PAYLOAD_HEIGHT = 1.5
"""[m] of the payload over the ground, over the front axle."""

ARM_PRESSURE = 90e5
"""Pressure [Pa] in an arm's cylinder that carries 24.5 kN, at which its oil's stiffness is taken."""

DISC_BLEND = 2e-3
"""Depth [m] by which discs of a tire differ that share the contact."""

X, Y, FRONT, REAR, Z, ROLL, PITCH = range(7)
SIDES = np.array([1.0, -1.0, 1.0, -1.0])[:, None]
"""+1 left, −1 right, by wheel."""


class Half:
    """One frame with its two corners as one body; everything (R,), in the axes of the frame, from the hinge's foot."""

    def __init__(self, parts: list[tuple[Array, Array, Array, Array, Array, Array]]):
        """Parts: (mass, x, lateral distance of a mirrored pair or 0, height, and inertias (xx, yy, zz) about own centre)."""
        self.mass = sum((m for m, *_ in parts), np.zeros(()))
        self.reach = sum((m * x for m, x, *_ in parts), np.zeros(())) / self.mass
        self.height = sum((m * z for m, _, _, z, *_ in parts), np.zeros(())) / self.mass
        self.roll = self.pitch = self.yaw = self.product = np.zeros(())
        for m, x, y, z, _, own in parts:
            dx, dz = x - self.reach, z - self.height
            self.roll = self.roll + own[0] + m * (y**2 + dz**2)
            self.pitch = self.pitch + own[1] + m * (dx**2 + dz**2)
            self.yaw = self.yaw + own[2] + m * (dx**2 + y**2)
            self.product = self.product - m * dx * dz


class Bodies:
    """Frames, wheel loads and mass matrix of R runs; ``position`` (7, R) belongs to u."""

    def __init__(self, constants: Constants, oil: Oil):
        p = constants
        self.radius, self.stiffness = p["tire.radius"], p["tire.stiffness"]
        length, rest = p["arm.length"], p["arm.rest_angle"]
        zero = np.zeros_like(length)
        mass, offset = {}, {}
        for half in ("front", "rear"):
            mass[half] = p[f"frame.{half}.mass"]
            offset[half] = p[f"frame.{half}.axle_distance"] - p[f"frame.{half}.cog_offset"]
        corner = p["arm.mass"] + p["arm.motor_mass"] + p["wheel.mass"]
        out = (p["arm.mass"] * p["arm.cog_fraction"] + p["arm.motor_mass"] + p["wheel.mass"]) * length / corner
        pivot = {half: p[f"frame.{half}.axle_distance"] - length for half in mass}
        design = p["tire.design_stiffness"]
        angle = {"front": rest, "rear": rest}
        for _ in range(50):  # the rear arms' angle with which the frames lie level; a few rounds suffice
            axle = {half: pivot[half] + length * np.cos(angle[half]) for half in mass}
            centre = {half: pivot[half] + out * np.cos(angle[half]) for half in mass}
            moment = (
                mass["front"] * offset["front"]
                - mass["rear"] * offset["rear"]
                + 2.0 * corner * (centre["front"] - centre["rear"])
            )
            total = mass["front"] + mass["rear"] + 4.0 * corner
            front = 0.5 * GRAVITY * (moment + total * axle["rear"]) / (axle["front"] + axle["rear"])
            load = {"front": front, "rear": 0.5 * GRAVITY * total - front}
            height = self.radius - load["front"] / design - length * np.sin(rest)
            angle["rear"] = np.arcsin((self.radius - load["rear"] / design - height) / length)
        self.centre = np.stack([self.radius - load[half] / design for half in ("front", "front", "rear", "rear")])
        self.axle = np.stack([axle["front"], axle["front"], -axle["rear"], -axle["rear"]])
        self.half_track = 0.5 * p["frame.track"]

        halves = []
        for half, sign in (("front", 1.0), ("rear", -1.0)):
            cosine, sine = np.cos(angle[half]), np.sin(angle[half])
            share, pair = p["arm.cog_fraction"], 2.0 * np.ones_like(length)
            axial, transverse, wheel = (
                p["arm.inertia_axial"],
                p["arm.inertia_transverse"],
                p["wheel.inertia_transverse"],
            )
            frame = tuple(p[f"frame.{half}.inertia_{axes}"] for axes in ("xx", "yy", "zz"))
            parts = [
                (mass[half], sign * offset[half], zero, p[f"frame.{half}.cog_height"], zero, frame),
                (
                    pair * p["arm.mass"],
                    sign * (pivot[half] + share * length * cosine),
                    0.5 * (p["arm.pivot_lateral"] + self.half_track),
                    height + share * length * sine,
                    zero,
                    (pair * axial, pair * transverse, pair * transverse),
                ),
                (
                    pair * (p["arm.motor_mass"] + p["wheel.mass"]),
                    sign * axle[half],
                    self.half_track,
                    height + length * sine,
                    zero,
                    (pair * wheel, zero, pair * wheel),  # about its axle a wheel spins on its own
                ),
            ]
            if half == "front":
                own = (zero, zero, zero)
                parts.append((p["payload.mass"], axle[half], zero, zero + PAYLOAD_HEIGHT, zero, own))
            halves.append(Half(parts))
        self.front, self.rear = halves
        self.spring = 1.0 / (1.0 / self.stiffness + 1.0 / self._arm_stiffness(p, oil, angle))
        self.damper = p["tire.damping"]
        slope_x, slope_y = np.tan(p["ground.slope_ahead"]), np.tan(p["ground.slope_left"])
        upright = 1.0 / np.sqrt(1.0 + slope_x**2 + slope_y**2)
        self.gravity = -GRAVITY * np.stack([slope_x * upright, slope_y * upright, upright])
        # the tires' depth at the design pose carries the design load; all else is a deviation from it
        self.design_depth = np.stack([load[half] / self.spring for half in ("front", "front", "rear", "rear")])
        self.position = np.zeros((7, len(self.radius)))
        inner, outer = p["tire.disc_offset_inner"], p["tire.disc_offset_outer"]
        low, lowest = p["tire.disc_drop_inner"], p["tire.disc_drop_outer"]
        self._across = np.stack([zero, -inner, inner, -outer, outer])[:, None]
        self._drop = np.stack([zero, low, low, lowest, lowest])[:, None]
        self.across = self.half_track * SIDES
        self.bulge = np.zeros_like(self.across)

    def lean_on_tires(self) -> None:
        """Let leaning wheels find where across their tires they touch the ground.

        The tire's crown is five discs that share the contact by their depths, as exp(depth / 2 mm); a lean of 1 mrad moves
        the contact by some 3 mm, which stiffens the machine in roll by a seventh. Sets ``across`` [m], the contacts'
        lateral places (4, R), and ``bulge`` [m], by which they lie deeper.
        """
        cosine, sine = (np.repeat(part, 2, axis=0) for part in self.directions())
        lean = self.position[ROLL] * cosine + self.position[PITCH] * sine
        level = np.exp(-self._drop / DISC_BLEND)
        weight = level * np.exp(-self._across * lean / DISC_BLEND)
        total = weight.sum(axis=0)
        self.across = SIDES * self.half_track + (self._across * weight).sum(axis=0) / total
        self.bulge = DISC_BLEND * np.log(total / level.sum(axis=0))

    @staticmethod
    def _arm_stiffness(p: Constants, oil: Oil, angle: dict[str, Array]) -> Array:
        """Stiffness [N/m] at a wheel of the oil that holds its arm, the mean of front and rear."""
        part = "arm.cylinder."
        bore = 0.25 * np.pi * p[part + "bore"] ** 2
        rod = bore - 0.25 * np.pi * p[part + "rod"] ** 2
        link = Linkage(p[part + "dead_length"], p[part + "stroke"], p[part + "mount_ratio"], p["arm.swing"])
        fixed = p["arm.hose_volume"] + p[part + "dead_volume"]
        wall = p["arm.hose_volume"] / p["arm.hose_bulk_modulus"]
        total = np.zeros(())
        for at in angle.values():
            reach, lever, _ = link.levers(-at)
            extended = reach - link.closed
            loaded = (fixed + bore * extended) * oil.compressibility(np.full_like(fixed, ARM_PRESSURE)) + wall
            other = (fixed + rod * (link.stroke - extended)) * oil.compressibility(p["arm.rod_rest_pressure"]) + wall
            stiffness = lever**2 * (bore**2 / loaded + rod**2 / other)
            total = total + 0.5 * stiffness / (p["arm.length"] * np.cos(at)) ** 2
        return total

    # -------------------------------------------------------------------------------------------------------- kinematics
    def stand(self, joint_angle: Array) -> None:
        """Stand still at ``joint_angle`` [rad] with the front frame at heading 0, on tires that bear their loads."""
        self.position[:] = 0.0
        self.position[REAR] = -joint_angle
        for _ in range(12):  # the tires' springs alone are the slope: what gravity and crowns add is a fifth of them
            self.lean_on_tires()
            force = self.weight() + self.lift(self.loads(np.zeros_like(self.position)))
            wheel_x, wheel_y = self.wheel_places()
            raised = np.stack([np.ones_like(wheel_x), wheel_y, -wheel_x])  # (3, 4, R) of a wheel by heave, roll, pitch
            stiffness = np.einsum("iwr,jwr,r->rij", raised, raised, self.spring)
            change = np.linalg.solve(stiffness, force[Z:].T[..., None])[..., 0].T
            self.position[Z:] += change

    def directions(self) -> tuple[Array, Array]:
        """Cosine and sine (2, R) of the frames' headings."""
        headings = self.position[FRONT : REAR + 1]
        return np.cos(headings), np.sin(headings)

    def wheel_places(self) -> tuple[Array, Array]:
        """Places (4, R) of the wheels' contacts [m] from the hinge, in the ground's axes."""
        cosine, sine = (np.repeat(part, 2, axis=0) for part in self.directions())
        return self.axle * cosine - self.across * sine, self.axle * sine + self.across * cosine

    def contact_velocities(self, u: Array, spin: Array) -> tuple[Array, Array, Array]:
        """Longitudinal and lateral slip [m/s] and yaw rate [rad/s] of the tires (4, R); ``spin`` [rad/s] is absolute."""
        cosine, sine = (np.repeat(part, 2, axis=0) for part in self.directions())
        turn = np.repeat(u[FRONT : REAR + 1], 2, axis=0)
        tip = -u[ROLL] * sine + u[PITCH] * cosine  # pitch rate about the axle
        ahead = u[X] * cosine + u[Y] * sine - self.across * turn
        aside = -u[X] * sine + u[Y] * cosine + self.axle * turn
        lean = u[ROLL] * cosine + u[PITCH] * sine  # roll rate about the frame's own axis
        # a wheel's centre moves by its height × pitch rate, the tread under it by −radius × spin; it lies below the ground
        return ahead + self.centre * tip - self.radius * spin, aside + (self.radius - self.centre) * lean, turn

    def relative_spin(self, u: Array, spin: Array) -> Array:
        """Spin [rad/s] of the wheels relative to their arms (4, R), which the motors see."""
        cosine, sine = (np.repeat(part, 2, axis=0) for part in self.directions())
        return spin - (-u[ROLL] * sine + u[PITCH] * cosine)

    # ------------------------------------------------------------------------------------------------------------ forces
    def loads(self, u: Array) -> Array:
        """Normal loads of the tires [N] (4, R)."""
        x, y = self.wheel_places()
        q = self.position
        raised = q[Z] + y * q[ROLL] - x * q[PITCH]
        turn = np.repeat(u[FRONT : REAR + 1], 2, axis=0)
        rising = u[Z] + y * u[ROLL] - x * u[PITCH] + turn * self._uphill(x, y)
        return np.maximum(self.spring * (self.design_depth + self.bulge - raised) - self.damper * rising, 0.0)

    def _uphill(self, x: Array, y: Array) -> Array:
        """Rise [m/rad] of a point at (x, y) as its frame turns about the leaning hinge."""
        return x * self.position[ROLL] + y * self.position[PITCH]

    def lift(self, load: Array) -> Array:
        """Generalised force (7, R) of the tires' normal loads."""
        x, y = self.wheel_places()
        force = np.zeros_like(self.position)
        force[Z], force[ROLL], force[PITCH] = load.sum(axis=0), (load * y).sum(axis=0), -(load * x).sum(axis=0)
        uphill = load * self._uphill(x, y)
        force[FRONT], force[REAR] = uphill[0] + uphill[1], uphill[2] + uphill[3]
        return force

    def weight(self) -> Array:
        """Generalised force (7, R) of gravity, to first order in the tilts."""
        force = np.zeros_like(self.position)
        g = self.gravity
        for half, row in ((self.front, FRONT), (self.rear, REAR)):
            x, y = half.reach * np.cos(self.position[row]), half.reach * np.sin(self.position[row])
            m, h = half.mass, half.height
            force[X] += m * g[0]
            force[Y] += m * g[1]
            force[row] += m * (x * g[1] - y * g[0] + g[2] * self._uphill(x, y))
            force[Z] += m * g[2]
            force[ROLL] += m * (y * g[2] - h * g[1] - h * g[2] * self.position[ROLL])
            force[PITCH] += m * (h * g[0] - x * g[2] - h * g[2] * self.position[PITCH])
        return force

    def turning(self, u: Array) -> Array:
        """Generalised force (7, R) of the frames' centrifugal accelerations."""
        force = np.zeros_like(self.position)
        for half, row in ((self.front, FRONT), (self.rear, REAR)):
            outward = half.mass * u[row] ** 2 * half.reach
            x, y = outward * np.cos(self.position[row]), outward * np.sin(self.position[row])
            force[X] += x
            force[Y] += y
            force[ROLL] -= half.height * y
            force[PITCH] += half.height * x
        return force

    def ground(self, ahead: Array, aside: Array, torque: Array, shaft: Array) -> Array:
        """Generalised force (7, R) of tire forces [N] and swivel torques [N m] (4, R), and of the reaction to the torques
        ``shaft`` [N m] (4, R) that arms exert on their wheels."""
        cosine, sine = (np.repeat(part, 2, axis=0) for part in self.directions())
        force = np.zeros_like(self.position)
        force[X] = (ahead * cosine - aside * sine).sum(axis=0)
        force[Y] = (ahead * sine + aside * cosine).sum(axis=0)
        turned = self.axle * aside - self.across * ahead + torque
        force[FRONT], force[REAR] = turned[0] + turned[1], turned[2] + turned[3]
        tipped = self.centre * ahead - shaft
        leaned = (self.radius - self.centre) * aside
        force[ROLL] = (leaned * cosine - tipped * sine).sum(axis=0)
        force[PITCH] = (leaned * sine + tipped * cosine).sum(axis=0)
        return force

    # ------------------------------------------------------------------------------------------------------ mass matrix
    def mass_factor(self) -> Array:
        """Cholesky factor (7, 7, R), lower, of the mass matrix at the present headings."""
        runs = self.position.shape[1]
        m = np.zeros((7, 7, runs))
        for half, row in ((self.front, FRONT), (self.rear, REAR)):
            cosine, sine = np.cos(self.position[row]), np.sin(self.position[row])
            mass, h = half.mass, half.height
            x, y = half.reach * cosine, half.reach * sine
            m[X, X] += mass
            m[row, X] = -mass * y
            m[row, Y] = mass * x
            m[row, row] = mass * half.reach**2 + half.yaw
            uphill = mass * self._uphill(x, y)
            m[Z, row] = uphill
            m[Z, Z] += mass
            m[ROLL, Y] -= mass * h
            m[ROLL, row] = -mass * h * x + half.product * cosine + y * uphill
            m[ROLL, Z] += mass * y
            m[ROLL, ROLL] += mass * (h**2 + y**2) + half.roll * cosine**2 + half.pitch * sine**2
            m[PITCH, X] += mass * h
            m[PITCH, row] = -mass * h * y + half.product * sine - x * uphill
            m[PITCH, Z] -= mass * x
            m[PITCH, ROLL] += -mass * x * y + (half.roll - half.pitch) * cosine * sine
            m[PITCH, PITCH] += mass * (h**2 + x**2) + half.roll * sine**2 + half.pitch * cosine**2
        m[Y, Y] = m[X, X]
        factor = np.zeros_like(m)
        for j in range(7):
            below = m[j:, j] - np.einsum("ikr,kr->ir", factor[j:, :j], factor[j, :j])
            factor[j:, j] = below / np.sqrt(below[0])
        return factor

    @staticmethod
    def solve(factor: Array, force: Array) -> Array:
        """Accelerations (7, R) under the generalised ``force`` (7, R)."""
        x = force.copy()
        for i in range(7):
            x[i] = (x[i] - (factor[i, :i] * x[:i]).sum(axis=0)) / factor[i, i]
        for i in range(6, -1, -1):
            x[i] = (x[i] - (factor[i + 1 :, i] * x[i + 1 :]).sum(axis=0)) / factor[i, i]
        return x
