"""Problems: logs of the twin itself are explained down to their noise, and what healthy logs show is taken away."""

import numpy as np
import pytest
from numpy.typing import NDArray

from aoro_gym.diagnosis.arrival import AFTER, AHEAD, NEVER
from aoro_gym.diagnosis.axes import Axis
from aoro_gym.diagnosis.noise import MERGED, ModelError, Noise, whitener
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import (
    FELT,
    KINDS,
    KNOWN,
    START_JITTER,
    SWAY,
    WANDERS,
    ZEROS,
    Problem,
    in_step,
    references_of,
)
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import COARSE, USUAL, Replay, Simulator, Variants
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from tests.diagnosis.manoeuvres import FULL, blank, turn
from tests.diagnosis.synthetic import linear_of, problem_of

MACHINE = Machine.load("aoro")
DAY = Nuisances(MACHINE, "day")
BLANKS = [blank("left", turn(1.0, 1.6), -0.3), blank("right", turn(-0.6, 1.8), 0.3)]
STD = {"joint_angle": np.radians(0.03), **dict.fromkeys(FULL[1:], 0.5e5)}
"""Of white noise [SI]."""
NOISE = {name: Noise(np.r_[std**2, np.zeros(400)]) for name, std in STD.items()}
PERFECT = ModelError(0.0, 0.0)
"""Of a twin that has the machine's own laws."""


def logged(variants: Variants, rng: np.random.Generator, blanks: list[Recording] = BLANKS) -> list[Recording]:
    """What one variant logs, with white noise of :data:`STD`."""
    out = []
    for one, found in zip(blanks, Simulator().run([Replay(variants, one) for one in blanks]), strict=True):
        noisy = {name: rows[:, 0] + STD[name] * rng.standard_normal(len(rows)) for name, rows in found.items()}
        out.append(Recording(one.name, one.commands, noisy, one.rest, one.start_angle))
    return out


def cost(problem: Problem) -> float:
    """Whitened squares at the centre, priors included."""
    own = problem.own(problem.predicted) @ problem.centre[len(problem.felt) :]
    whiteners = problem.whiteners(problem.error, problem.predicted)
    white = problem.white(whiteners, problem.measured - problem.predicted - own)
    return float(white @ white + problem.centre @ problem.centre)


class Learned:
    """A problem that has learned one effect around its machine, and logs of the machine itself."""

    def __init__(self) -> None:
        self.axis = Axis(EFFECTS["spool_lag"], 0)
        recordings = logged(Variants(MACHINE), np.random.default_rng(1), BLANKS[:1])
        effects = {"spool_lag": EFFECTS["spool_lag"]}
        self.problem = Problem(recordings, DAY, effects, error=PERFECT, noise=NOISE)
        self.problem.learn()


@pytest.fixture(scope="module")
def learned():
    return Learned()


@pytest.mark.parametrize(("steps", "off", "missed"), [(USUAL, 0.05, 0.15), (COARSE, 0.1, 0.25)])
def test_slopes_foretell_another_machine(learned, steps, off, missed):
    """Steps of a fifth of a standard deviation in all nuisances at once, to the side on which there is room: slopes are
    differences over half of one at most. If those by coarse steps are a quarter off, a step on them leaves a sixteenth of
    what it could gain."""
    problem: Problem = learned.problem
    felt = len(problem.felt)
    points, h = problem.neighbours(problem.centre)
    simulated = problem.simulate([problem.at(np.vstack([problem.centre, points]))], steps)
    slopes = (simulated[:, 1:] - simulated[:, :1]) / h
    if steps == COARSE:
        np.testing.assert_allclose(slopes, problem.slopes, rtol=1e-6, atol=1e-6 * np.abs(problem.slopes).max())
    room = np.where(DAY.place[problem.felt] + 0.5 * DAY.std[problem.felt] <= 1.0, 1.0, -1.0)
    step = np.zeros((16, len(problem.centre)))
    step[:, :felt] = 0.2 * room * np.abs(np.random.default_rng(2).standard_normal((16, felt)))
    whiteners = problem.whiteners(PERFECT, problem.predicted)
    found = problem.white(whiteners, problem.simulate([problem.at(step)]) - problem.predicted[:, None])
    foretold = problem.white(whiteners, slopes @ step[:, :felt].T)
    assert np.sum(found * foretold) / np.sum(foretold**2) == pytest.approx(1.0, abs=off)
    assert np.linalg.norm(found - foretold) < missed * np.linalg.norm(found)


def test_what_is_not_felt_is_left_alone(learned):
    problem: Problem = learned.problem
    white = problem.white(problem.whiteners(PERFECT, problem.predicted), problem.slopes)
    assert np.all(np.linalg.norm(white, axis=0) > FELT)
    assert problem.slopes.shape == (len(problem.measured), len(problem.felt))


def test_at_the_upper_end_of_a_range_slopes_are_taken_from_below(learned):
    """Nuisances that lie there are felt, too; upwards nothing would change."""
    assert np.any(DAY.place[learned.problem.felt] == 1.0)


def test_shifts_are_what_an_effect_does(learned):
    problem: Problem = learned.problem
    shifts = problem.shifts["spool_lag", 0]
    place = learned.axis.nodes[1]
    machine = EFFECTS["spool_lag"].apply(MACHINE, float(learned.axis.value(place)))
    without, found = problem.simulate([Variants(MACHINE), Variants(machine)], COARSE).T
    np.testing.assert_allclose(shifts[:, 1], found - without, rtol=1e-6, atol=1e-9)
    # what a lag of the spool does first is to delay the angle: the longer, the more
    angle = problem.split(shifts)[problem.blocks.index((0, "joint_angle"))]
    begun = problem.recordings[0].rest + np.arange(10, 30)
    assert np.all(np.diff(angle[begun].mean(axis=0)) < 0.0) and np.all(angle[begun] < 0.0)


def synthetic(name: str = "left", arrival: int = 140, channels: dict | None = None) -> Recording:
    """A ramp into a stop under a command to the left, and a pressure that jumps on arrival."""
    time = np.arange(200)
    found = {
        "joint_angle": 0.5 + 0.006 * np.clip(time - arrival, 60 - arrival, 0),
        "pressure_a": np.where(time < arrival, 50e5, 120e5),
    }
    return Recording(name, turn(1.0, 1.99), channels or found, 60, float(found["joint_angle"][0]))


def centred(recordings: list[Recording], predicted: list[Recording], **options) -> Problem:
    """A problem whose prediction is given."""
    problem = Problem(recordings, DAY, {}, error=PERFECT, noise=NOISE, **options)
    problem.felt = np.empty(0, dtype=np.intp)
    problem.centre = problem.centre[len(DAY.keys) :]
    problem.slopes = np.empty((len(problem.measured), 0))
    problem.predicted = np.concatenate([predicted[k].channels[name] for k, name in problem.blocks])
    problem.given_stops = [arrival != NEVER for arrival in problem.arrivals]
    return problem


def with_residual(recording: Recording, residual: dict[str, np.ndarray]) -> Recording:
    channels = {name: values + residual[name] for name, values in recording.channels.items()}
    return Recording(recording.name, recording.commands, channels, recording.rest, recording.start_angle)


def test_own_shifts_are_those_of_a_clock_and_of_zeros():
    """A log whose clock is ahead by a millisecond shows what a smooth prediction f shows then: f(t + δ) − f(t), to
    δ² |f″| / 2 and the (TICK² / 6) |f‴| δ of central differences."""

    def smooth(ahead: float) -> dict[str, np.ndarray]:
        time = TICK * np.arange(200) + ahead
        return {"joint_angle": 0.3 * np.sin(3.0 * time), "pressure_a": 60e5 * np.cos(2.0 * time)}

    now, then = smooth(0.0), smooth(START_JITTER)
    twice = [synthetic("one", channels=now), synthetic("two", channels=now)]
    problem = centred(twice, twice)
    columns = problem.own(problem.predicted)
    assert columns.shape == (len(problem.measured), 2 + 4)
    inner = slice(1, -1)  # the ends have one-sided differences
    for k in range(2):
        for (index, name), shift in zip(problem.blocks, problem.split(columns[:, k]), strict=True):
            if index != k:
                assert not np.any(shift)
            else:
                size, rate = (0.3, 3.0) if name == "joint_angle" else (60e5, 2.0)
                slack = size * (START_JITTER**2 * rate**2 / 2.0 + START_JITTER * TICK**2 * rate**3 / 6.0)
                np.testing.assert_allclose(shift[inner], (then[name] - now[name])[inner], atol=1.01 * slack)
    for k, (index, name) in enumerate(problem.blocks):
        for block, shift in zip(problem.blocks, problem.split(columns[:, 2 + k]), strict=True):
            np.testing.assert_array_equal(shift, ZEROS[name] if block == (index, name) else 0.0)


def test_what_healthy_logs_show_is_taken_away():
    """Two healthy recordings with residuals ± around a common one, which is slow: the mean is subtracted, and nothing but
    the change and the noise of three recordings is left."""
    rng = np.random.default_rng(3)
    twin = synthetic()
    apart, change = ({name: size * rng.standard_normal(200) for name, size in STD.items()} for _ in range(2))
    slow = 2.0 * np.pi * 0.3 * TICK  # a tick: of which the window lets exp(-(slow SWAY)² / 2) pass as slow
    common = {name: 20.0 * size * np.sin(slow * np.arange(200)) for name, size in STD.items()}
    pair = [with_residual(twin, {n: common[n] + sign * apart[n] for n in common}) for sign in (-1.0, 1.0)]
    references = references_of(centred(pair, [twin, twin]))
    assert {name for _, name in references} == {"joint_angle", "pressure_a"}
    assert all(reference.repeats == 2 for reference in references.values())

    later = with_residual(twin, {n: common[n] + change[n] for n in common})
    problem = centred([later], [twin], references=references)
    for (_, name), left in zip(problem.blocks, problem.split(problem.measured - problem.predicted), strict=True):
        inner, fast = slice(3 * SWAY, -3 * SWAY), 1.0 - np.exp(-0.5 * (slow * SWAY) ** 2)
        np.testing.assert_allclose(left[inner], change[name][inner], atol=20.0 * STD[name] * fast)
    for (_, name), white in zip(problem.blocks, problem.whiteners(PERFECT, problem.predicted), strict=True):
        np.testing.assert_allclose(np.diag(white.factor) ** 2, STD[name] ** 2 * (1.0 + 0.5) / 2.0)

    other = Recording("other", 0.9 * later.commands, later.channels, later.rest, later.start_angle)
    untouched = centred([other], [twin], references=references)
    np.testing.assert_array_equal(untouched.split(untouched.measured)[0], later.channels[untouched.blocks[0][1]])


@pytest.mark.parametrize(("factor", "expected"), [(1.0, 1.0), (0.5, 0.5), (2.0, 0.5), (-1.0, 0.0)])
def test_sway_is_in_step(factor, expected):
    """Two sines of one phase: the ratio of their amplitudes; two of opposite phase have nothing in common."""
    time = TICK * np.arange(300)
    one = 5e5 * time + 1e6 * np.sin(2.0 * np.pi * 3.0 * time)
    other = -2e5 * time + factor * 1e6 * np.sin(2.0 * np.pi * 3.0 * time)
    inner = slice(4 * SWAY, -4 * SWAY)
    # 1.6 % of a sway of 3 Hz passes as slow, and as much of twice the frequency is left in its square
    np.testing.assert_allclose(in_step(one, other, 1e4)[inner], expected, atol=0.02)


def test_noise_is_in_step():
    rng = np.random.default_rng(1)
    one, other = 1e4 * rng.standard_normal((2, 3000))
    assert np.mean(in_step(one, other, 1e4)) > 0.85


def compared(problem: Problem, recording: Recording) -> NDArray[np.bool_]:
    """All samples (F,) but those of the bounce at the stop."""
    (arrival,) = problem.arrivals
    counts = np.ones(recording.ticks + 1, dtype=bool)
    counts[arrival - AHEAD : arrival + AFTER] = False
    return counts


def test_a_reference_takes_away_most_of_the_twin_s_error():
    """The share KNOWN of its kind is left, also of a channel that is of no kind."""
    revolutions = {"engine_speed": 160.0 - 0.02 * np.arange(200)}
    twin, error = synthetic(channels=synthetic().channels | revolutions), ModelError(0.02, 0.03, 0.1)
    references = references_of(centred([twin], [twin]))
    problem = centred([twin], [twin], references=references)
    problem.error = error
    for (_, name), found in zip(problem.blocks, problem.whiteners(error, problem.predicted), strict=True):
        share = KNOWN[KINDS.get(name, "")]
        left = ModelError(share * 0.02, share * 0.03, share * 0.1)
        noise, counts = problem.noise[name], compared(problem, twin)
        expected = whitener(noise, name, twin.channels[name], left, repeats=1, counts=counts)
        np.testing.assert_allclose(found.factor, expected.factor, rtol=1e-9, atol=1e-12 * expected.factor[0, 0])


def test_where_a_healthy_machine_sways_more_than_its_twin_that_counts():
    """In the later recordings by the references, in the healthy ones themselves where nothing is wrong with them."""
    twin, error = synthetic(), ModelError(0.0, 0.0, 0.1, 0.0, 0.002)
    sway = {"joint_angle": np.zeros(twin.ticks + 1), "pressure_a": 5e5 * np.sin(0.4 * np.arange(twin.ticks + 1))}
    healthy = with_residual(twin, sway)
    references = references_of(centred([healthy], [twin]))
    for problem, shares in (
        (centred([twin], [twin], references=references), KNOWN),
        (centred([healthy], [twin], sound=True), {"angle": 1.0, "pressure": 1.0}),
        (centred([healthy], [twin]), None),
    ):
        found = dict(
            zip((name for _, name in problem.blocks), problem.whiteners(error, problem.predicted), strict=True)
        )
        for name in sway:
            repeats = 1 if problem.references else np.inf
            left = error if shares is None else error.scaled(shares[KINDS[name]])
            expected = whitener(
                NOISE[name], name, twin.channels[name], left, since=problem._since[0], counts=compared(problem, twin),
                healthy=None if shares is None else healthy.channels[name], repeats=repeats,
            )  # fmt: skip
            np.testing.assert_allclose(
                found[name].factor, expected.factor, rtol=1e-9, atol=1e-9 * expected.factor[0, 0]
            )


def test_a_healthy_recording_s_own_clock_and_zeros_are_no_reference():
    twin = synthetic()
    zero = {
        "joint_angle": np.full(200, 0.5 * ZEROS["joint_angle"]),
        "pressure_a": np.full(200, -2.0 * ZEROS["pressure_a"]),
    }
    problem = centred([with_residual(twin, zero)], [twin])
    names = [name for _, name in problem.blocks]
    problem.centre = np.array([0.0, *(0.5 if name == "joint_angle" else -2.0 for name in names)])
    for (_, name), reference in references_of(problem).items():
        np.testing.assert_allclose(reference.residual, 0.0, atol=1e-9 * np.max(np.abs(twin.channels[name])))


@pytest.mark.parametrize("later", [130, 140, 147])
def test_a_reference_follows_the_arrival(later):
    """What the healthy machine showed a while after its arrival is expected that long after the later machine's."""
    at = np.arange(200)

    def residual(arrival: int) -> dict[str, np.ndarray]:
        return {
            "joint_angle": np.where(at < arrival, 1e-3, 2e-3),
            "pressure_a": np.where(at < arrival, 0.0, 7e5),
        }

    healthy = with_residual(synthetic(), residual(140))
    references = references_of(centred([healthy], [synthetic()]))
    log = with_residual(synthetic(arrival=later), residual(later))
    problem = centred([log], [synthetic(arrival=later)], references=references)
    slow = np.abs(at - later) > 4 * SWAY  # of the jump itself, as much as both sway alike is taken away
    for (_, name), left in zip(problem.blocks, problem.split(problem.measured - problem.predicted), strict=True):
        jump = np.ptp(residual(later)[name])
        np.testing.assert_allclose(left[slow], 0.0, atol=1e-3 * jump)
        np.testing.assert_allclose(left, 0.0, atol=0.5 * jump)


def test_a_prediction_is_read_on_the_clock_of_the_log():
    """A machine whose valve gives more arrives earlier: its pressure jumps when that of the log does, and until then its
    angle runs ahead of the log's, as if there were no stop."""
    (recording,) = logged(Variants(MACHINE), np.random.default_rng(4), [blank("left", turn(1.0, 2.8), -0.3)])
    problem = Problem([recording], DAY, {}, error=PERFECT, noise=NOISE)
    wide = Variants(EFFECTS["valve_gain"].apply(MACHINE, EFFECTS["valve_gain"].magnitudes[0].high))
    (plain,) = Simulator().run([Replay(wide, recording)])
    read = dict(zip([name for _, name in problem.blocks], problem.split(problem.simulate([wide])), strict=True))

    def drop(pressure: np.ndarray) -> int:
        """Sample at which the pressure behind a piston that comes to rest first is next to none, 10 bar on its way."""
        return 120 + int(np.argmax(pressure[120:] < 4e5))

    own, log = drop(plain["pressure_b"][:, 0]), drop(recording.channels["pressure_b"])
    assert own < log - 5
    assert abs(drop(read["pressure_b"][:, 0]) - log) <= 1
    before = own - 10
    np.testing.assert_array_equal(read["joint_angle"][:before], plain["joint_angle"][:before])
    ahead = read["joint_angle"][before : log - 10, 0] - recording.channels["joint_angle"][before : log - 10]
    assert np.all(ahead > 0.9 * ahead[0])


def test_what_only_one_of_the_two_comes_to_is_not_compared():
    """Pressures of a log whose joint comes to its stop count until then where the given twin's does not; its angle counts
    but for the bounce, as all does where both stop."""
    problem = centred([synthetic()], [synthetic()])
    (arrival,) = problem.arrivals
    assert arrival != NEVER
    rows = {}
    for stops in (True, False):
        problem.given_stops = [stops]
        whiteners = problem.whiteners(PERFECT, problem.predicted)
        rows[stops] = {
            name: MERGED * np.flatnonzero(w.counts) for (_, name), w in zip(problem.blocks, whiteners, strict=True)
        }
    np.testing.assert_array_equal(rows[True]["joint_angle"], rows[False]["joint_angle"])
    assert not np.any((rows[True]["pressure_a"] >= arrival - AHEAD) & (rows[True]["pressure_a"] < arrival + AFTER))
    assert np.max(rows[True]["pressure_a"]) >= arrival + AFTER > arrival > np.max(rows[False]["pressure_a"])


@pytest.mark.parametrize("share", [0.0, 0.2, 0.6])
@pytest.mark.parametrize("factor", [0.06, 1.0])
def test_a_wandering_zero_is_found_beside_the_twins_own_error(share: float, factor: float):
    """Angles of many turns drawn from white noise, a zero that wanders by a ``share`` of it, and ``factor`` times the twin's
    error. Turns of 2 s hold 0.8 of an independent value of a zero with a memory of 1.2 s, 32 in all, so that its size is
    known to 1 in eight: the likeliest of :data:`WANDERS` is the true one or its neighbour; residuals are then white."""
    error, rng, count = ModelError(rate=0.003, pressure=0.0), np.random.default_rng(7), 40
    course = np.concatenate([np.zeros(60), np.linspace(0.0, 0.6, 100), np.full(41, 0.6)])
    problem = problem_of({f"turn {k}": {"joint_angle": course} for k in range(count)}, std={"joint_angle": 1e-3})
    problem.error = error
    linear_of(problem, np.zeros((len(problem.measured), 1)))
    problem.predicted = problem.measured.copy()
    vars(problem)["given"], vars(problem)["given_stops"] = problem.predicted, [False] * count
    quiet = problem.noise["joint_angle"]
    problem.noise = {"joint_angle": quiet.wandering(share * quiet.std)}
    drawn = np.zeros((count, len(course)))
    for w, row in zip(problem.whiteners(error.scaled(factor), problem.predicted), drawn, strict=True):
        means = np.repeat(w.factor @ rng.standard_normal(len(w.factor)), MERGED)
        row[: len(w.counts) * MERGED][np.repeat(w.counts, MERGED)] = means
    vars(problem)["measured"] = problem.predicted + drawn.ravel()
    problem.noise = {"joint_angle": quiet}
    found = problem.wander()["joint_angle"] / quiet.std
    places = [min(range(len(WANDERS)), key=lambda k: abs(WANDERS[k] - one)) for one in (found, share)]
    assert abs(places[0] - places[1]) <= 1
    problem.noise = {"joint_angle": quiet.wandering(found * quiet.std)}
    problem.be_found(problem.misfits())
    assert problem.misfits() == problem.misfit  # of the error as it is assumed, whatever was found before
    white = problem.white(problem.whiteners(error, problem.predicted), drawn.ravel())
    assert np.mean(white**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / len(white)))
