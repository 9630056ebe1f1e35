"""Packets that come late, unevenly or not at all: what a network and a dynamometer do to set-points and measurements."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aoro_gym.checks import check_integer, check_range


class DelayLine:
    """The way of packets from one side to the other, for many machines at once; a packet a period.

    A packet of machine i is on its way for ``delay[i]`` whole periods, and up to ``jitter[i]`` more, drawn evenly for each
    packet; or it is lost. Who receives holds the newest packet that has arrived: one that was overtaken is dropped, as
    sequence numbers have it.

    Args:
        delay: Whole periods, scalar or (N,).
        jitter: Whole periods, scalar or (N,).
        loss: Probability in [0, 1), scalar or (N,).
        num_machines: N.
        seed: Of all that is drawn; two lines of one coupling take two seeds.
    """

    def __init__(
        self,
        delay: npt.ArrayLike = 0,
        jitter: npt.ArrayLike = 0,
        loss: npt.ArrayLike = 0.0,
        *,
        num_machines: int = 1,
        seed: int = 0,
    ):
        check_integer("num_machines", num_machines)
        check_range("delay", delay, " periods", ge=0)
        check_range("jitter", jitter, " periods", ge=0)
        check_range("loss", loss, ge=0.0, lt=1.0)
        n = int(num_machines)
        self.delay = np.broadcast_to(np.asarray(delay, dtype=np.int64), (n,))
        self.jitter = np.broadcast_to(np.asarray(jitter, dtype=np.int64), (n,))
        self.loss = np.broadcast_to(np.asarray(loss, dtype=float), (n,))
        self._draws = np.random.default_rng(seed)
        self._kept = int(np.max(self.delay + self.jitter)) + 1
        self._tick = 0
        self._due = np.full((self._kept, n), np.iinfo(np.int64).max)  # period of arrival, by period of sending
        self._packets: npt.NDArray[np.float32] | None = None
        self._held: npt.NDArray[np.float32] | None = None
        self._newest = np.full(n, -1)  # period at which what is held was sent

    def pass_on(self, packet: npt.NDArray[np.float32], rest: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Send one packet, and return what the other side holds then.

        Args:
            packet: (quantities, N).
            rest: (quantities, N): held until a first packet arrives.

        Returns:
            (quantities, N).
        """
        if self._packets is None or self._held is None:
            self._packets, self._held = np.zeros((self._kept, *packet.shape), dtype=np.float32), rest.copy()
        n, tick = len(self.delay), self._tick
        place = tick % self._kept
        late = np.floor(self._draws.random(n) * (self.jitter + 1)).astype(np.int64)
        lost = self._draws.random(n) < self.loss
        self._packets[place] = packet
        self._due[place] = np.where(lost, np.iinfo(np.int64).max, tick + self.delay + late)
        sent = tick - (tick - np.arange(self._kept)) % self._kept  # period of sending, by place
        arrived = np.where((self._due <= tick) & (sent[:, None] >= 0), sent[:, None], -1)
        best = np.argmax(arrived, axis=0)
        newer = arrived[best, np.arange(n)] > self._newest
        self._held[:, newer] = self._packets[best[newer], :, np.flatnonzero(newer)].T
        self._newest = np.where(newer, arrived[best, np.arange(n)], self._newest)
        self._tick += 1
        return self._held.copy()
