"""One made-up diagnosis for each verdict, with all that a real one has."""

import numpy as np

from aoro_gym.diagnosis.result import (
    CALIBRATION,
    PHASES,
    UNKNOWN,
    Cause,
    CredibleInterval,
    Curve,
    Diagnosis,
    Experiment,
    GapClosure,
    Place,
)

SIGNALS = ("joint_angle", "pressure_a", "pressure_b", "pump_pressure")
SPREAD = {"joint_angle": np.radians(0.03), "pressure_a": 0.6e5, "pressure_b": 0.5e5, "pump_pressure": 0.7e5}
MANOEUVRES = ("left_100", "right_075", "reversal")


def curve(manoeuvre: str, signal: str, *, gap: float, left: float, held_out: bool = False) -> Curve:
    """A signal that oscillates at first, whose twin is ``gap`` spreads off before and ``left`` after."""
    time = np.arange(0.0, 5.0, 0.01)
    since = np.clip(time - 0.6, 0.0, None)
    moving = (since > 0.0) & (since < 3.4)
    ringing = np.exp(-3.0 * since) * np.sin(9.0 * since) * moving
    shape = (
        np.radians(-42.0 + 25.0 * np.clip(since - 0.1, 0.0, 3.3))
        if signal == "joint_angle"
        else 30e5 * moving + 60e5 * ringing
    )
    error = SPREAD[signal] * (ringing + 0.15 * moving) * 3.0
    noise = SPREAD[signal] * np.random.default_rng(len(manoeuvre) + len(signal)).normal(size=time.size)
    return Curve(
        manoeuvre, signal, held_out, time, shape + noise, shape - gap * error, shape - left * error,
        np.full(time.size, SPREAD[signal]),
    )  # fmt: skip


def curves(gap: float, left: float) -> tuple[Curve, ...]:
    return tuple(
        curve(manoeuvre, signal, gap=gap / (1 + i + j), left=left / (1 + i + j), held_out=manoeuvre == "reversal")
        for i, manoeuvre in enumerate(MANOEUVRES)
        for j, signal in enumerate(SIGNALS)
    )


def places(component: str, shares: dict[tuple[str, str], float]) -> tuple[Place, ...]:
    """Shares by signal and phase, parted among the manoeuvres."""
    parts = zip(MANOEUVRES, (0.5, 0.3, 0.2), strict=True)
    found = [
        Place(component, phase, signal, manoeuvre, part * share)
        for manoeuvre, part in parts
        for (signal, phase), share in shares.items()
    ]
    return tuple(sorted(found, key=lambda place: -place.share))


def shrinkage(fitted: float, left_out: float, refitted: float) -> tuple[GapClosure, ...]:
    """S of every manoeuvre; errors that belong to it."""
    found = []
    for manoeuvre in MANOEUVRES:
        held_out = manoeuvre == "reversal"
        for i, signal in enumerate(SIGNALS):
            for own in (False, True) if held_out else (True,):
                S = (refitted if own else left_out) if held_out else fitted
                S -= 0.02 * i
                noise = SPREAD[signal]
                before = (4.0 - 0.5 * i) * noise
                after = float(np.sqrt(noise**2 + (1.0 - S) * (before**2 - noise**2)))
                found.append(
                    GapClosure(
                        manoeuvre, signal, S, S - 0.07, min(S + 0.04, 0.999), before, after, noise, held_out, own
                    )
                )
    return tuple(found)


KEY_FIGURES = {
    "left, 100 %": {
        "turn_time_s": {"measured": 2.152, "before": 1.981, "after": 2.148},
        "first_peak_L_per_min": {"measured": 90.4, "before": 97.3, "after": 90.9},
        "first_peak_time_s": {"measured": 0.131, "before": 0.118, "after": 0.132},
        "lowest_undershoot_L_per_min": {"measured": 41.2, "before": 47.7, "after": None},
    }
}
MOVED = (
    {"key": "steering.cylinder.seal_preload", "unit": "N", "before": 210.0, "after": 262.0, "deviations": 1.31},
    {"key": "oil.gas_fraction", "unit": "1", "before": 0.005, "after": 0.0041, "deviations": -0.72},
)
COMMON = {
    "machine": "mine.toml",
    "mode": "commissioned",
    "logs": MANOEUVRES,
    "healthy": ("before_left_100", "before_right_075"),
    "signals": SIGNALS,
    "seconds": 212.4,
}

LEAKAGE = Cause(
    ("cylinder_leakage",),
    0.953,
    {"cylinder_leakage": (CredibleInterval(4.1e-5, 3.3e-5, 4.8e-5, "m^3/s", "leakage past both pistons at 100 bar"),)},
    {"cylinder_leakage": (4.1e-5,)},
    ("cylinders",),
    "machine_1.toml",
)
CROSS_PORT = Cause(
    ("cross_port_leakage",),
    0.031,
    {
        "cross_port_leakage": (
            CredibleInterval(3.6e-5, 2.6e-5, 4.4e-5, "m^3/s", "leakage from port to port at 100 bar"),
        )
    },
    {"cross_port_leakage": (3.6e-5,)},
    ("valve",),
    "machine_2.toml",
)
BOTH = Cause(
    ("entrained_air", "command_delay"),
    0.009,
    {
        "entrained_air": (
            CredibleInterval(-6.3e8, -8.1e8, -4.2e8, "Pa", "bulk modulus of the oil with its air at 10 bar"),
            CredibleInterval(-1.1e8, -1.6e8, -0.7e8, "Pa", "bulk modulus of the oil with its air at 100 bar"),
        ),
        "command_delay": (CredibleInterval(0.0113, 0.0094, 0.0131, "s", "dead time from command to spool"),),
    },
    {"entrained_air": (0.012,), "command_delay": (0.0113,)},
    ("oil_and_hoses", "valve"),
    "machine_3.toml",
)
PULSE = Experiment(
    "hold_at_the_stop",
    "Full signal to the left for 2 s after the joint has reached its stop.",
    0.83,
    (("cylinder_leakage", "cross_port_leakage"), ("cylinder_leakage", "entrained_air + command_delay")),
)
PAUSE = Experiment("pause", "Half signal, 1 s without, half signal again.", 0.21, (("cylinder_leakage", "nothing"),))
STEADY = {("pressure_a", "steady"): 0.41, ("pressure_b", "steady"): 0.22, ("joint_angle", "steady"): 0.19}
STEADY |= {("pressure_a", "first_peak"): 0.11, ("pump_pressure", "onset"): 0.04, ("joint_angle", "stop"): 0.003}

CAUSE = Diagnosis(
    **COMMON,
    verdict="cause",
    where=places("cylinders", STEADY),
    where_p=2e-9,
    components={"cylinders": 0.955, "valve": 0.04, "oil_and_hoses": 0.009},
    causes=(LEAKAGE, CROSS_PORT, BOTH),
    declared_set=("cylinder_leakage",),
    fit_test_p=0.41,
    shrinkage=shrinkage(0.96, 0.93, 0.97),
    controls={"cause": 0.90, "wrong_cause": 0.31, "black_box": None},
    key_figures=KEY_FIGURES,
    next_experiments=(PULSE, PAUSE),
    calibration=MOVED,
    alike=(("cylinder_leakage", "cross_port_leakage"),),
    limitations=("reversal: pump_pressure stays at exactly 200 bar for 0.31 s: saturated sensor?",),
    curves=curves(14.0, 0.3),
)
AMBIGUOUS = Diagnosis(
    **COMMON,
    verdict="ambiguous",
    where=places("", STEADY),
    where_p=3e-4,
    components={"cylinders": 0.52, "valve": 0.43},
    causes=(
        Cause(LEAKAGE.effects, 0.52, LEAKAGE.magnitudes, LEAKAGE.settings, LEAKAGE.components, "machine_1.toml"),
        Cause(CROSS_PORT.effects, 0.38, CROSS_PORT.magnitudes, CROSS_PORT.settings, ("valve",), "machine_2.toml"),
        Cause((CALIBRATION,), 0.06, machine_file="machine_3.toml"),
        BOTH,
    ),
    declared_set=("cylinder_leakage", "cross_port_leakage"),
    fit_test_p=0.12,
    shrinkage=shrinkage(0.94, 0.9, 0.95),
    controls={"cause": 0.87, "wrong_cause": 0.85, "black_box": -0.2},
    key_figures=KEY_FIGURES,
    next_experiments=(PULSE,),
    calibration=MOVED,
    alike=(("cylinder_leakage", "cross_port_leakage"),),
    curves=curves(8.0, 0.4),
)
RECALIBRATED = Diagnosis(
    **COMMON,
    verdict="calibration",
    where=places("", {("joint_angle", "steady"): 0.5, ("pressure_a", "first_peak"): 0.3}),
    where_p=0.34,
    causes=(
        Cause((CALIBRATION,), 0.91, machine_file="machine_1.toml"),
        Cause(LEAKAGE.effects, 0.05, LEAKAGE.magnitudes, {}, ("cylinders",), "machine_2.toml"),
    ),
    fit_test_p=0.66,
    shrinkage=shrinkage(0.97, 0.95, 0.96),
    controls={"cause": 0.92, "wrong_cause": None, "black_box": 0.4},
    key_figures=KEY_FIGURES,
    calibration=MOVED,
    curves=curves(6.0, 0.3),
)
NO_GAP = Diagnosis(
    **COMMON,
    verdict="no_gap",
    where=places("", {("joint_angle", "steady"): 0.5, ("pressure_a", "first_peak"): 0.3}),
    where_p=0.63,
    causes=(Cause((), 0.94), Cause(LEAKAGE.effects, 0.02, LEAKAGE.magnitudes, {}, ("cylinders",))),
    fit_test_p=0.63,
    curves=curves(0.1, 0.1),
)
OUTSIDE = Diagnosis(
    **{**COMMON, "mode": "day-one", "healthy": (), "signals": ("joint_angle",)},
    verdict="unknown",
    where=places("", STEADY),
    where_p=1e-12,
    causes=(Cause((UNKNOWN,), 0.984), Cause(BOTH.effects, 0.013, BOTH.magnitudes, {}, BOTH.components)),
    fit_test_p=2e-6,
    shrinkage=shrinkage(0.61, -0.14, 0.2),
    controls={"cause": -0.17, "wrong_cause": -0.2, "black_box": -1.3},
    key_figures=KEY_FIGURES,
    calibration=MOVED,
    limitations=("Only the joint angle was logged.",),
    curves=curves(14.0, 7.0),
)
INCONCLUSIVE = Diagnosis(
    **{**COMMON, "logs": ("short",), "healthy": (), "mode": "day-one", "signals": ("joint_angle",)},
    verdict="inconclusive",
    where=places("", {("joint_angle", "onset"): 0.6}),
    where_p=0.04,
    causes=(Cause((), 0.38), Cause(LEAKAGE.effects, 0.21, LEAKAGE.magnitudes, {}, ("cylinders",))),
    limitations=(
        "short: 1.6 s of motion, where a turn needs 2 s.",
        "short: noise of 0.4°, forty times that of the machine's sensor <unfiltered>.",
    ),
    curves=curves(2.0, 1.8)[:1],
)

DIAGNOSES = {one.verdict: one for one in (NO_GAP, RECALIBRATED, CAUSE, AMBIGUOUS, OUTSIDE, INCONCLUSIVE)}
"""By verdict."""

BARE = {
    verdict: Diagnosis(
        machine="aoro", mode="day-one", logs=("a",), healthy=(), signals=("joint_angle",), verdict=verdict
    )
    for verdict in DIAGNOSES
}
"""The same with nothing but what there must be."""

assert {place.phase for one in DIAGNOSES.values() for place in one.where} <= set(PHASES)
