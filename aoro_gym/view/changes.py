"""Sliders that change a machine while it runs: one of its parameters, and an effect of the catalogue."""

from __future__ import annotations

import html
import math
import warnings
from collections.abc import Sequence
from typing import Any

from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import MachineEffect
from aoro_gym.machine import Machine
from aoro_gym.machine.parameters import OutsideRangeWarning

NOTHING = "none"
STEPS = 200
"""Steps of a slider from end to end."""
MOST = 2
"""Magnitudes that an effect may have."""
ON_MACHINE = {name: effect for name, effect in EFFECTS.items() if isinstance(effect, MachineEffect)}


def changed(machine: Machine, key: str, value: float, effect: str, magnitudes: Sequence[float]) -> Machine:
    """``machine`` with another value of a parameter and with an effect.

    Args:
        machine: As it is.
        key: Of the parameter; ``NOTHING``: none.
        value: Of the parameter, in the file's unit.
        effect: Id in the catalogue; ``NOTHING``: none.
        magnitudes: Of the effect, in SI.

    Raises ValueError where there is no such machine.
    """
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", OutsideRangeWarning
        )  # an effect may lead out of a range: that is what it is for
        if key != NOTHING:
            machine = machine.set({key: value})
        return machine if effect == NOTHING else ON_MACHINE[effect].apply(machine, *magnitudes)


class Changes:
    """A panel with which a person changes one of the machines.

    Args:
        gui: Of a server of viser.
        machines: As they are without a change.
        names: Of them.
    """

    def __init__(self, gui: Any, machines: Sequence[Machine], names: Sequence[str]):
        self._machines = machines
        self._asked = False
        keys = [key for key, entry in machines[0].entries.items() if entry.range[0] < entry.range[1]]
        with gui.add_folder("Change the machine", expand_by_default=False):
            numbered = [f"{i + 1}: {name}" for i, name in enumerate(names)]
            self._which = gui.add_dropdown("machine", numbered, initial_value=numbered[-1]) if len(names) > 1 else None
            self._key = gui.add_dropdown("parameter", (NOTHING, *keys), initial_value=NOTHING)
            self._value = _slider(gui, "value")
            self._effect = gui.add_dropdown("effect", (NOTHING, *ON_MACHINE), initial_value=NOTHING)
            self._magnitudes = [_slider(gui, "magnitude") for _ in range(MOST)]
            self._note = gui.add_markdown("")
        self._key.on_update(lambda _: self._offer_value())
        self._effect.on_update(lambda _: self._offer_magnitudes())
        if self._which is not None:
            self._which.on_update(lambda _: self._offer_value())
        for slider in (self._value, *self._magnitudes):
            slider.on_update(lambda event: self._ask() if event.client is not None else None)

    @property
    def index(self) -> int:
        """Which machine is changed."""
        return 0 if self._which is None else int(str(self._which.value).split(":")[0]) - 1

    def _ask(self) -> None:
        self._asked = True

    def _offer_value(self) -> None:
        """The slider of the parameter that was chosen, where the machine has it."""
        key = str(self._key.value)
        self._value.visible = key != NOTHING
        if key != NOTHING:
            entry = self._machines[self.index].entries[key]
            _offer(self._value, f"[{entry.unit}]", *entry.range, float(entry.value))
        self._ask()

    def _offer_magnitudes(self) -> None:
        """The sliders of the effect that was chosen, where it is absent."""
        effect = ON_MACHINE.get(str(self._effect.value))
        magnitudes = () if effect is None else effect.magnitudes
        for i, slider in enumerate(self._magnitudes):
            slider.visible = i < len(magnitudes)
            if i < len(magnitudes):
                one = magnitudes[i]
                _offer(slider, f"{one.name} [{one.unit}]", one.low, one.high, one.none)
        self._ask()

    def take(self) -> tuple[int, Machine] | None:
        """Which machine a person has changed since the last time, and into what; None if nobody has, or into none."""
        if not self._asked:
            return None
        self._asked = False
        effect = str(self._effect.value)
        count = 0 if effect == NOTHING else len(ON_MACHINE[effect].magnitudes)
        sizes = [float(slider.value) for slider in self._magnitudes[:count]]
        index = self.index
        try:
            machine = changed(self._machines[index], str(self._key.value), float(self._value.value), effect, sizes)
        except ValueError as error:
            self.say(str(error))
            return None
        self.say("")
        return index, machine

    def say(self, text: str) -> None:
        """A line below the sliders."""
        self._note.content = html.escape(text)


def _slider(gui: Any, label: str) -> Any:
    return gui.add_slider(label, min=0.0, max=1.0, step=1.0 / STEPS, initial_value=0.0, visible=False)


def _offer(slider: Any, label: str, low: float, high: float, value: float) -> None:
    """Give a slider another meaning; its value lies within its ends at every moment."""
    slider.min, slider.max = min(low, float(slider.min)), max(high, float(slider.max))
    slider.step = (high - low) / STEPS
    slider.precision = max(0, math.ceil(-math.log10(slider.step)))
    slider.label, slider.value = label, min(max(value, low), high)
    slider.min, slider.max = low, high
