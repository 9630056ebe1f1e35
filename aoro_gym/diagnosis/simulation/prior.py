"""What simulated machines, days and effects are drawn from: the specification of what a diagnosis expects of the world.

Nothing in it is taken from machines or plants that a diagnosis is judged on. Widths are estimates (E) unless a source is
named: they are meant to be wider than what a reader would find, as a network that has seen too much hesitates, and one that
has seen too little errs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from aoro_gym.units import BAR

KINDS = ("none", "single", "pair", "outside")
"""What may be wrong on a later day: nothing, one effect of the catalogue, two of them, or something that it lacks."""


@dataclass(frozen=True)
class Prior:
    """Machines, days and effects.

    Attributes:
        families: Share of the machines whose laws are those of one family; every law of the others is drawn on its own.
        spreads: How far parameters lie from the machine that they are drawn around, as shares of the way to either end of
            their ranges, equally often: a calibrated machine, a machine of the kind, any that the ranges allow.
        baseline: Share of the healthy machines that have something of what effects bring: air, play, leaks, ...
        baselines: Largest baseline by key, in the machine file's unit; drawn evenly from zero, or from its negative where
            ``signed``.
        signed: Keys of :attr:`baselines` that may be negative.
        day: Half of what holds 95 % of a nuisance from day to day, as a share of its range.
        day_factor: Ends of a factor on all that changes from day to day, one a machine, logarithmically even: some machines
            are kept in a hall, others stand outside.
        day_shares: Standard deviation of the logarithm from day to day, by keys that move together: friction, air and
            inflation change by shares of what they are, not of their ranges.
        share_factor: Ends of a factor on each of :attr:`day_shares`, one a machine, logarithmically even: one machine's
            seals change more from day to day, and another's ground or air (E: the best kept part changes by half of what is
            usual, the worst by two and a half times).
        temperature: Standard deviation [K] of the oil's temperature from day to day.
        slope: The same of the ground's slope [rad], of either component.
        load: The same of what lies on the front frame [kg]; no less than nothing.
        own_form: Share of the effects that have the catalogue's form; the others have :mod:`.forms` of other laws.
        mixed_form: Share of these that mix all forms.
        varied_form: Standard deviation of the logarithm of a factor on each parameter that these move together.
        weights: How often a later day is of each of :data:`KINDS`.
        weakest: Least size of an effect as a share of its range's end.
        strongest: Largest one, of what is no factor; between them sizes are logarithmically even.
    """

    families: float = 0.4
    spreads: tuple[float, ...] = (0.1, 0.4, 0.8)
    baseline: float = 0.5
    baselines: Mapping[str, float] = field(
        default_factory=lambda: {
            "oil.gas_fraction": 0.01, "steering.valve.overlap": 0.03, "steering.valve.cross_port_leakage": 0.5,
            "steering.tank_line.throttle_drop": 2.0, "joint.backlash": 5e-4, "joint.compliance": 5e-8,
            "tire.scrub_radius": 0.05, "engine.droop": 0.02,
        }
    )  # fmt: skip
    signed: tuple[str, ...] = ("steering.valve.overlap",)
    day: float = 0.02
    day_factor: tuple[float, float] = (0.3, 3.0)
    day_shares: Mapping[str, float] = field(
        default_factory=lambda: {
            "tire.friction_coulomb tire.friction_static": 0.03, "tire.stiffness": 0.02,
            "tire.scrub_radius tire.bore_radius": 0.05, "joint.friction_torque": 0.05,
            "steering.cylinder.seal_preload steering.cylinder.seal_pressure_coefficient": 0.06,
            "driveline.brake.disc_torque": 0.05, "oil.gas_fraction": 0.15, "steering.hose_bulk_modulus": 0.02,
            "steering.tank_line.back_pressure": 0.03, "steering.tank_line.throttle_drop": 0.05,
            "steering.valve.hysteresis": 0.05,
        }
    )  # fmt: skip
    share_factor: tuple[float, float] = (0.5, 2.5)
    temperature: float = 2.0
    slope: float = 0.003
    load: float = 30.0
    own_form: float = 0.4
    mixed_form: float = 0.5
    varied_form: float = 0.25
    weights: tuple[float, ...] = (0.25, 0.35, 0.24, 0.16)
    weakest: float = 0.1
    strongest: float = 1.6


@dataclass(frozen=True)
class SensorPrior:
    """What sensors and loggers add, SI; drawn anew for every log unless said. Pairs are ends of a logarithmically even draw.

    Attributes:
        line_scale: Factor on the published spectral lines of the angle, one a machine.
        angle_white: [rad] rms, one a machine.
        angle_step: [rad] of the quantiser, one a machine.
        angle_zero: Standard deviation [rad] of the angle's zero from day to day.
        pressure_white: [Pa] rms, one a machine.
        pressure_step: [Pa] of the quantiser, one a machine.
        pressure_zero: Standard deviation [Pa] of a pressure's zero from day to day.
        pressure_gain: Standard deviation of a pressure's gain from day to day.
        delay: Longest delay [s] of the angle while nothing is wrong, one a machine.
        lag: Longest time constant [s] of the angle while nothing is wrong, one a machine.
        smoothing: Longest smoothing [s] of a whole log while nothing is wrong, of :attr:`smooth` of the machines.
        smooth: Share of machines whose logs are smoothed.
        clock: Largest offset [s] of a log's clock against its command, as loggers sample at instants of their own.
        law_error: Ends of the size of what no simulated law has, as a share of a signal's range: a random filter across
            channels, mildly nonlinear, the same on all days of a machine.
        change_error: The same of what parts a day from the first: laws that differ by little in what they do differ by more
            in what changes when something is wrong (median cosine 0.92 between families of laws of the slow course).
        chain_forms: How often a measuring chain smooths without phase, lags as an input filter of first order does, and
            delays the log as a logger does whose stamps come late; all signals alike.
        law_error_time: Longest time constant [s] of these filters.
    """

    line_scale: tuple[float, float] = (0.2, 2.0)
    angle_white: tuple[float, float] = (5e-5, 8e-4)
    angle_step: tuple[float, float] = (4e-4, 3e-3)
    angle_zero: float = 8e-4
    pressure_white: tuple[float, float] = (0.03 * BAR, 0.6 * BAR)
    pressure_step: tuple[float, float] = (0.02 * BAR, 0.2 * BAR)
    pressure_zero: float = 0.8 * BAR
    pressure_gain: float = 3e-3
    delay: float = 0.012
    lag: float = 0.008
    smoothing: float = 0.03
    smooth: float = 0.3
    clock: float = 0.005
    law_error: tuple[float, float] = (0.003, 0.036)
    change_error: tuple[float, float] = (0.02, 0.3)
    chain_forms: tuple[float, ...] = (0.4, 0.4, 0.2)
    law_error_time: float = 0.15
