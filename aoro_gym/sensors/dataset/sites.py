"""Where pictures are taken: a forest by its seed, or a world that is given, with what stands in it and how it looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.sensors.camera import Appearance
from aoro_gym.sensors.dataset.carrier import carrier
from aoro_gym.sensors.dataset.drives import Drive
from aoro_gym.sensors.dataset.labels import Shapes
from aoro_gym.sensors.dataset.machines import scene_of, standing, with_held_logs, with_machines
from aoro_gym.sensors.dataset.settings import DatasetSettings
from aoro_gym.sensors.raytrace.bodies import IDENTITY
from aoro_gym.terrains.generate.stand import STANDS
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.objects import matrix
from aoro_gym.terrains.world.world import World

Array = NDArray[np.float64]

HELD_OUT = 0.2
"""Share of the forests for ``val`` and for ``test`` each, one at least; the rest is ``train``."""
BRIGHTNESS, TINT = 0.25, 0.06
"""Standard deviations of the logarithms of a class's albedo, and of its red, green and blue, between pictures. (E)"""


class Forest:
    """A forest of a data set, or the world that was given for all of it.

    Args:
        settings: Of the data set.
        index: Of the forest.
        given: The world; None: one is made by the seed.
    """

    def __init__(self, settings: DatasetSettings, index: int, given: World | None):
        self.settings, self.index = settings, index
        rng = np.random.default_rng([settings.seed, index, 1])
        season = str(rng.choice(["spring", "summer", "autumn", "winter"]))
        stand = str(rng.choice(sorted(STANDS)))
        clutter = {"piles": float(rng.uniform(6.0, 25.0)), "stumps": float(rng.uniform(150.0, 600.0))}
        self.season = "summer" if "season" in settings.fixed else season
        self.stand = "given"
        self.split = settings.split
        if given is not None:
            self.world = given
            snowy = given.ground is not None and bool((given.ground == Surface.SNOW).all())
            self.season = "winter" if snowy else "autumn" if self.season == "winter" else self.season
            return
        held_out = max(round(HELD_OUT * settings.worlds), 1)
        left = settings.worlds - 1 - index
        self.split = "test" if left < held_out else "val" if left < 2 * held_out else "train"
        self.stand = "mixed" if "stand" in settings.fixed else stand
        changes: dict[str, Any] = {} if "clutter" in settings.fixed else clutter
        size = (settings.size, settings.size)
        self.world = world(settings.seed + index, stand=self.stand, size=size, snow=self.season == "winter", **changes)


class Site(Forest):
    """A forest with what rays meet, and the drive through it.

    Args:
        settings: Of the data set.
        index: Of the forest.
        given: The world; None: one is made by the seed.
        drive: Through it; None: pictures are taken at free places.
        device: Where rays are cast.
        together: Most of its pictures that are taken together.
    """

    def __init__(
        self,
        settings: DatasetSettings,
        index: int,
        given: World | None,
        drive: Drive | None,
        device: str,
        together: int = 1,
    ):
        super().__init__(settings, index, given)
        self.drive = drive
        rng = np.random.default_rng([settings.seed, index, 4])
        way = None if drive is None else drive.places
        wanted, cranes = settings.machines, settings.cranes
        self.machines = standing(self.world, wanted, rng, way=way, cranes=cranes) if wanted else ()
        self.world, self.held = with_held_logs(self.world, self.machines)
        """With the logs in grapples, whose instances are by the number of the machine that holds each."""
        self.scene = scene_of(self.world, self.machines, device=device, carriers=together)
        self.together = together
        self.shapes = Shapes(self.world, self.machines)
        self._looks: dict[float, Appearance] = {}
        self._poses: Array | None = None

    def appearance(self, drawn: dict[str, Any]) -> Appearance:
        """Its textures, of other albedos in each picture."""
        wet = 1.0 if drawn["weather"][0] == "rain" else 0.0
        if wet not in self._looks:
            self._looks[wet] = Appearance.of_world(self.world, self.season, wetness=wet)
        made = self._looks[wet]
        if drawn["albedo_seed"] is not None:
            rng = np.random.default_rng(drawn["albedo_seed"])
            brighter, tinted = (
                rng.normal(0.0, BRIGHTNESS, (len(made.albedo), 1)),
                rng.normal(0.0, TINT, made.albedo.shape),
            )
            made = replace(made, albedo=np.clip(made.albedo * np.exp(brighter + tinted), 0.0, 1.0))
        return with_machines(made)

    def carry(self, fronts: Sequence[Array], postures: Sequence[Array]) -> list[int]:
        """Put the machines that carry the cameras of pictures where they are; the rays' worlds in which each is.

        Args:
            fronts: (4, 4) each, from the front frame's axes to the world's.
            postures: (9,) each, see :data:`~aoro_gym.sensors.dataset.carrier.POSTURE`.
        """
        bodies, parts = self.scene.bodies, len(carrier())
        assert bodies is not None and len(fronts) <= self.together
        others = (len(bodies) - parts * self.together) // (1 + self.together)
        if self._poses is None:
            self._poses = np.tile(IDENTITY, (len(bodies), 1))
        for k, (front, posture) in enumerate(zip(fronts, postures, strict=True)):
            end = others + (k + 1) * (others + parts)
            self._poses[end - parts : end] = carrier().poses(front, posture)
        bodies.move(self._poses)
        return [k + 1 for k in range(len(fronts))]

    def middles(self, near: str) -> Array:
        """(K, 2) [m] middles in plan of the objects of a kind; ``ValueError`` where there is none."""
        if near == "machine":
            found = [one.position[:2] for one in self.machines]
        else:
            chosen = [one for one in self.world.objects if one.kind.name.lower() == near]
            found = [
                np.add(one.position, 0.5 * getattr(one, "length", 0.0) * matrix(one.rotation)[:, 2])[:2]
                for one in chosen
            ]
        if not found:
            raise ValueError(f"{self.world.name} has no {near}; take larger forests, or no --near {near}")
        return np.array(found)
