"""The machine as solids, posed: frames with their equipment, arms, wheels and steering cylinders."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine import Machine
from aoro_gym.machine.solid import Points, Solid
from aoro_gym.machine.solids import CHROME, IRON, first_value, front_frame, rear_frame, wheel
from aoro_gym.sensors.attitude import in_world


class SolidMachine:
    """The machine as solids, posed by its outputs."""

    def __init__(self, machine: Machine):
        frame, arm, tire = machine.frame, machine.arm, machine.tire
        self._bodies = {False: front_frame(machine), True: rear_frame(machine)}
        self.half_width = first_value(tire.disc_offset_outer) + 0.025
        self._wheel = wheel(first_value(tire.radius), 2.0 * self.half_width)
        self._arm_length, self._pivot_height = first_value(arm.length), first_value(arm.pivot_height)
        self._pivot_lateral, self.half_track = first_value(arm.pivot_lateral), 0.5 * first_value(frame.track)
        self.axles = (first_value(frame.front.axle_distance), -first_value(frame.rear.axle_distance))
        self._packed = {key: solid.packed() for key, solid in (*self._bodies.items(), ("wheel", self._wheel))}
        linkage = machine.steering.cylinder.linkage
        self._pins = (first_value(linkage.a), first_value(linkage.b), 0.5 * first_value(linkage.g0))

    def posed(
        self,
        origin: Points,
        roll: float,
        pitch: float,
        yaw: float,
        joint: float,
        arms: Sequence[float],
        wheels: Sequence[float],
    ) -> tuple[Points, NDArray[np.intp], Points, list[Points]]:
        """Points (V, 3), beginnings of the faces (F + 1), their colours (F, 3), and the convex pieces, in the world.

        Args:
            origin: Hinge (3,) [m] in the world.
            roll: Of the front frame [rad].
            pitch: Of the front frame [rad].
            yaw: Its heading [rad].
            joint: Joint angle [rad].
            arms: Arm angles (4,) [rad].
            wheels: Wheel angles (4,) [rad].
        """
        points, starts, colours, hulls, total = [], [np.array([0])], [], [], 0

        def place(local: Points, rear: bool) -> Points:
            if rear:
                s, c = math.sin(-joint), math.cos(-joint)
                local = np.stack(
                    [c * local[:, 0] - s * local[:, 1], s * local[:, 0] + c * local[:, 1], local[:, 2]], axis=1
                )
            return origin + in_world(roll, pitch, yaw, local)

        def add(packed: tuple[Points, NDArray[np.intp], Points], solid: Solid, local: Any, rear: bool) -> None:
            nonlocal total
            points.append(place(local(packed[0]), rear))
            starts.append(packed[1][1:] + total)
            colours.append(packed[2])
            hulls.extend(place(local(hull), rear) for hull in solid.hulls)
            total += len(packed[0])

        for rear in (False, True):
            add(self._packed[rear], self._bodies[rear], lambda p: p, rear)
        for i, (angle, turned) in enumerate(zip(arms, wheels, strict=True)):
            rear, side = i >= 2, 1.0 if i % 2 == 0 else -1.0
            direction = -1.0 if rear else 1.0
            pivot_x = self.axles[int(rear)] - direction * self._arm_length
            x = pivot_x + direction * self._arm_length * math.cos(angle)
            z = self._pivot_height + self._arm_length * math.sin(angle)
            bars = Solid()
            hub = (x, side * (self.half_track - self.half_width), z)
            bars.bar((pivot_x, side * self._pivot_lateral, self._pivot_height), hub, 0.13, IRON)
            bars.bar(
                (pivot_x, side * (self._pivot_lateral - 0.05), self._pivot_height + 0.42),
                np.array([pivot_x + 0.55 * (x - pivot_x), 0.9 * hub[1], 0.45 * self._pivot_height + 0.55 * z]),
                0.06, CHROME, sides=6,
            )  # fmt: skip
            add(bars.packed(), bars, lambda p: p, rear)
            s, c = math.sin(turned), math.cos(turned)

            def rolled(p: Points, x: float = x, side: float = side, z: float = z, s: float = s, c: float = c) -> Points:
                # positive rotation about y brings the top forward
                return np.stack(
                    [x + c * p[:, 0] + s * p[:, 2], side * self.half_track + p[:, 1], z + c * p[:, 2] - s * p[:, 0]],
                    axis=1,
                )

            add(self._packed["wheel"], self._wheel, rolled, rear)
        steering = Solid()
        a, b, half = self._pins
        for side in (1.0, -1.0):
            back = np.array([-a * math.sin(half), side * a * math.cos(half)])
            s, c = math.sin(-joint), math.cos(-joint)
            back = np.array([c * back[0] - s * back[1], s * back[0] + c * back[1]])
            front = np.array([b * math.sin(half), side * b * math.cos(half)])
            steering.bar((*back, 0.78), (*front, 0.78), 0.045, CHROME, sides=6)
        add(steering.packed(), steering, lambda p: p, False)
        return np.concatenate(points), np.concatenate(starts), np.concatenate(colours), hulls
