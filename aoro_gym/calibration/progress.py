"""How far a calibration is, as a share that only grows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

Progress = Callable[[str, float], None]
"""Called with a sentence and the share in [0, 1] that is done."""

LINEAR = 0.8
"""Share of a phase's expected work up to which progress is the work done; beyond, it slows: the phase may be longer."""


class Work:
    """Phases of work and how much of them is done.

    What is left is shared among the phases to come by their expected work, anew whenever one begins: a phase that is
    skipped, or was shorter or longer than expected, never lets the share fall.

    Args:
        tell: Called whenever there is news.
        phases: Expected work of each phase in their order, in any one unit, such as machines that are tried.
    """

    def __init__(self, tell: Progress = lambda sentence, share: None, phases: Mapping[str, float] | None = None):
        self._tell = tell
        self._remaining = dict(phases or {})
        self._sentence = ""
        self._begin, self._width, self._expected, self._done = 0.0, 0.0, 1.0, 0.0

    @property
    def share(self) -> float:
        """Share in [0, 1] that is done."""
        x = self._done / self._expected
        slowed = x if x <= LINEAR else 1.0 - (1.0 - LINEAR) * math.exp(-(x - LINEAR) / (1.0 - LINEAR))
        return self._begin + self._width * slowed

    def expect(self, phases: Mapping[str, float]) -> None:
        """Correct what is expected of phases that have not begun."""
        self._remaining |= {name: work for name, work in phases.items() if name in self._remaining}

    def begin(self, phase: str, sentence: str) -> None:
        """Begin a phase; those before it are over. One that was not announced takes no share."""
        names = list(self._remaining)
        if phase in self._remaining:
            self._begin = self.share
            remaining = {name: self._remaining[name] for name in names[names.index(phase) :]}
            self._width = (1.0 - self._begin) * remaining[phase] / max(sum(remaining.values()), 1e-300)
            self._expected, self._done = max(remaining.pop(phase), 1e-300), 0.0
            self._remaining = remaining
        self.say(sentence)

    def say(self, sentence: str) -> None:
        """Say what is being done."""
        self._sentence = sentence
        self._tell(sentence, self.share)

    def did(self, work: float) -> None:
        """Count work that was done in the phase that runs."""
        self._done += work
        self._tell(self._sentence, self.share)

    def end(self) -> None:
        """All is done."""
        self._begin, self._width = 1.0, 0.0
        self.say("done")
