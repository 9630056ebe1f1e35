"""GPS solutions as NMEA 0183 sentences (IEC 61162-1): GGA, RMC, VTG and HDT, by pynmeagps."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from aoro_gym.cosimulation.server.geodesy import Geodesy
from aoro_gym.execution.array_api import Array
from aoro_gym.sensors.gps import FIXED, FLOAT, NONE, RATE
from aoro_gym.units import KNOT

TALKER = "GN"
"""Several satellite systems in one solution."""
QUALITY = {NONE: 0, FLOAT: 5, FIXED: 4}
"""Quality in GGA: 4 is RTK with fixed ambiguities, 5 with floating ones."""
MODE = {NONE: "N", FLOAT: "F", FIXED: "R"}
"""The same in RMC and VTG."""
SATELLITES, DILUTION = 20, 0.7
"""Number and horizontal dilution of precision that a solution claims; not simulated. (E)"""
SPEED_SAMPLES = 5
"""Solutions whose line gives speed and course: receivers have Doppler shifts, which are not simulated; with the typical
noise this is 0.04 m/s."""
KILOMETRES_PER_HOUR = 3.6
STARTS = datetime(2026, 6, 1, 12, tzinfo=UTC)
"""UTC at simulated time 0, but for what the receiver's clock is late: the same every run."""


@dataclass(frozen=True)
class Solution:
    """What a receiver puts out once."""

    utc: datetime
    """Of the instant that it shows."""
    position: Array
    """Of the main antenna [m] (3,), in the local frame."""
    heading: float
    """Of the front frame [rad], by the line between the antennas."""
    quality: int
    """``NONE``, ``FLOAT`` or ``FIXED``."""


class Sentences:
    """Writes solutions that follow each other as sentences.

    Args:
        geodesy: Where the local frame lies.
    """

    def __init__(self, geodesy: Geodesy):
        try:
            from pynmeagps import NMEAMessage
        except ImportError:
            raise ValueError("GPS sentences need pynmeagps: pip install 'aoro-gym[cosimulation]'") from None
        self._message: Any = NMEAMessage
        self._geodesy = geodesy
        self._plan: deque[Array] = deque(maxlen=SPEED_SAMPLES)  # last places [m] (2,)
        rows = np.arange(SPEED_SAMPLES) - 0.5 * (SPEED_SAMPLES - 1)
        self._weights = rows * RATE / np.sum(rows**2)  # [1/s] of the slope through them

    def write(self, solution: Solution) -> bytes:
        """GGA, RMC, VTG and HDT, each with its checksum and ended by CR LF; empty fields where nothing is known."""
        time, known = solution.utc.time(), solution.quality != NONE
        mode = MODE[solution.quality]
        if not known:
            self._plan.clear()
            return b"".join(
                (
                    self._sentence("GGA", time=time, quality=0, numSV=0),
                    self._sentence("RMC", time=time, status="V", date=solution.utc.date(), posMode=mode),
                    self._sentence("VTG", cogtUnit="T", cogmUnit="M", sognUnit="N", sogkUnit="K", posMode=mode),
                    self._sentence("HDT", headingTu="T"),
                )
            )
        x, y, z = (float(value) for value in solution.position)
        latitude, longitude, height = self._geodesy.place(x, y, z)
        place = {"time": time, "lat": latitude, "lon": longitude}
        speed, course = self._velocity(solution)
        course_deg = round(self._geodesy.azimuth(x, y, course), 2) % 360.0
        knots = round(speed / KNOT, 3)
        fix = {"quality": QUALITY[solution.quality], "numSV": SATELLITES, "HDOP": DILUTION}
        heights = {"alt": round(height, 3), "altUnit": "M", "sep": 0.0, "sepUnit": "M"}
        course_units = {"cogtUnit": "T", "cogmUnit": "M", "sognUnit": "N", "sogkUnit": "K"}
        return b"".join(
            (
                self._sentence("GGA", **place, **fix, **heights),
                self._sentence(
                    "RMC", **place, status="A", spd=knots, cog=course_deg, date=solution.utc.date(), posMode=mode
                ),
                self._sentence(
                    "VTG",
                    cogt=course_deg,
                    sogn=knots,
                    sogk=round(speed * KILOMETRES_PER_HOUR, 3),
                    **course_units,
                    posMode=mode,
                ),
                self._sentence("HDT", headingT=round(self._geodesy.azimuth(x, y, solution.heading), 3), headingTu="T"),
            )
        )

    def _velocity(self, solution: Solution) -> tuple[float, float]:
        """Speed [m/s] and course [rad], by the last solutions; along the heading as long as they are too few."""
        self._plan.append(solution.position[:2])
        if len(self._plan) < SPEED_SAMPLES:
            return 0.0, solution.heading
        vx, vy = self._weights @ np.stack(list(self._plan))
        return float(np.hypot(vx, vy)), float(np.arctan2(vy, vx))

    def _sentence(self, kind: str, **fields: Any) -> bytes:
        return self._message(TALKER, kind, 0, hpnmeamode=1, **fields).serialize()


def utc_of(seconds: float) -> datetime:
    """UTC [to the microsecond] that is ``seconds`` [s] after the start."""
    return STARTS + timedelta(seconds=seconds)


def second_of_day(utc: datetime) -> float:
    """[s] since midnight."""
    return (utc - utc.replace(hour=0, minute=0, second=0, microsecond=0)).total_seconds()
