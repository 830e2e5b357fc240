"""Echoes to tell something from: is there a passage in a hedge, is there a pole among leaves?

Every echo is of leaves that no other hears: a box of them at random, pinged once from a place and direction
that vary a little (after Wang & Müller 2021, Bioinspir. Biomim., doi 10.1088/1748-3190/ac2aff), and heard
behind a filter that is matched to the call. ``Listener`` has four ways to tell, which others are measured
against:

- energy: of the whole echo.
- first crossing: the times at which each band first crosses a threshold.
- template: the cochleagram held against a template.
- network: eight units on its first principal components.

The first three are linear discriminants of these features (Fisher 1936), the height of the threshold chosen
among ``THRESHOLDS``; all are fitted to echoes, and asked about others.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import fft
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import rankdata

from ..base.rng import stream
from ..sensing.sonar.leaves import LeafDiscs
from ..sensing.sonar.ping import ping
from ..sensing.sonar.receiver import EchoReceiver, receive
from ..sensing.sonar.station import Equipment, SonarPose
from ..sensing.trajectory import frame_of
from ..spec import Air, Sonar, SonarReceiver, SpecError, unknown
from .senses import band_power, levels
from .stems import StemWorld

WIDTHS = {"passage": 0.5, "pole": 0.04}  # metres: of the passage, and of the pole's diameter
FARTHEST = 2.2  # metres to the leaves, which the sonar still hears
SIZE = (3.0, 1.6, 0.4)  # metres across, up, deep, of the box of leaves
DENSITY = 400.0  # leaves/m³
LEAF = (0.025, 0.006)  # metres, radius and its spread
SHIFT = (0.005, 0.03, 0.03)  # metres, spreads of where it pings: ahead, across, up
TURN = 2.0  # degrees, of its direction
ASIDE = 0.1  # metres, spread of where the pole stands
MIDDLE = 1.5  # metres up the pole that the sonar is
SONAR = Sonar(
    band=(30e3, 80e3),
    sample_rate=200e3,
    call="fm",
    call_duration=0.002,
    beam_width_deg=(50.0, 50.0),
    wood=False,
    facets=False,
    shading="none",
    leaf_model="piston",
    max_range=3.0,
    record=0.0165,
    cull=0.02,
    tolerance=1e-4,
)
# Of the median echo's largest envelope in a band, where nothing is there.
THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
LISTENERS = ("energy", "first crossing", "template", "network")
COMPONENTS, UNITS, DECAY = 24, 8, 0.01  # of the network: inputs, hidden units, weights' cost
SOURCE_LEVEL = 110.0  # dB re 20 µPa at 0.1 m, of the call in noise
KNOWN = 16  # echoes that say how loud a task is


@dataclass(frozen=True)
class EchoTask:
    """A box of leaves ahead, with or without what is to be told.

    what : "passage" or "pole". distance : metres to the leaves. width : metres, of the passage or the pole;
    None: that of ``WIDTHS``.

    Raises
    ------
    SpecError : another word, a distance or width that is out of range.
    """

    what: str = "passage"
    distance: float = 1.4
    width: float | None = None

    def __post_init__(self) -> None:
        if self.what not in WIDTHS:
            raise unknown("what", self.what, tuple(WIDTHS))
        if self.width is None:
            object.__setattr__(self, "width", WIDTHS[self.what])
        for name, most in (("distance", FARTHEST), ("width", SIZE[0])):
            if not 0 < (metres := getattr(self, name)) <= most:
                raise SpecError(
                    name, f"{metres} is out of range; use more than 0, at most {most} m"
                )

    def heard(self, seed: int, number: int, is_there: bool) -> np.ndarray:
        """(1, S) the echo of one ping re the call at 1 m, with no noise."""
        rng = stream(seed, "hedge", round(1000 * self.distance), number)
        leaves = self._leaves(rng, is_there and self.what == "passage")
        off = rng.normal(0.0, SHIFT, 3)
        turn = np.deg2rad(rng.normal(0.0, TURN, 2))
        frame = frame_of(float(turn[0]), float(turn[1]))
        given = {"equipment": _equipment(), "pose": SonarPose(off, frame, np.zeros(3))}
        sound = ping(leaves, SONAR, Air(), **given).waveforms
        if is_there and self.what == "pole":  # which hides nothing: echoes add up
            place = np.array([[self.distance + SIZE[2] / 2, rng.normal(0.0, ASIDE)]])
            pole = StemWorld(place, np.array([self.width / 2]), np.zeros(2), np.zeros(2)).targets
            given["pose"] = SonarPose(off + np.array([0.0, 0.0, MIDDLE]), frame, np.zeros(3))
            sound = sound + ping(pole, SONAR.changed(wood=True), Air(), **given).waveforms
        return sound

    def loudness(self) -> float:
        """The median peak of echoes where nothing is there, which noise is measured against."""
        return _loudness(self)

    def _leaves(self, rng: np.random.Generator, has_passage: bool) -> LeafDiscs:
        across, up, deep = SIZE
        count = rng.poisson(DENSITY * np.prod(SIZE))
        centre = rng.uniform((0, -across / 2, -up / 2), (deep, across / 2, up / 2), (count, 3))
        centre[:, 0] += self.distance
        normal = rng.standard_normal((count, 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        radius = np.clip(rng.normal(*LEAF, count), 0.008, 0.05)
        kept = np.flatnonzero(np.abs(centre[:, 1]) > (self.width / 2 if has_passage else 0.0))
        nothing = np.zeros(len(kept), dtype=np.int64)
        return LeafDiscs(centre[kept], normal[kept], radius[kept], nothing, kept, nothing - 1)


@cache
def _equipment() -> Equipment:
    return Equipment.of(SONAR)


@cache
def _loudness(task: EchoTask) -> float:
    heard = [np.abs(task.heard(0, number, False)).max() for number in range(KNOWN)]
    return float(np.median(heard))


@cache
def _receiver(loudness: float, snr_db: float) -> EchoReceiver:
    """A receiver with white noise of its own that the peak of a loud echo is above."""
    settings = SonarReceiver(source_level_db=SOURCE_LEVEL)
    silent = EchoReceiver(SONAR.changed(receiver=settings))
    level = silent.self_noise_for(loudness * silent.pressure, snr_db)
    return EchoReceiver(SONAR.changed(receiver=settings.changed(self_noise_db=level)))


def noisy(sound: np.ndarray, snr_db: float, loudness: float, seed: int, number: int) -> np.ndarray:
    """An echo (1, S) as a receiver hears it whose noise in the band is ``snr_db`` below a peak of
    ``loudness``, re the call at 1 m."""
    receiver = _receiver(loudness, snr_db)
    received = receive(receiver, sound, np.zeros((1, 3)), Air().speed(), seed, "listen", number)
    return received.recorded / received.pressure


def sensed(sound: np.ndarray) -> np.ndarray:
    """(B, S) squared envelopes of an echo (1, S) in bands, behind a filter that is matched to the call: a
    copy of the call keeps its peak there."""
    call = _equipment().call.samples  # type: ignore[union-attr]  # it has one
    length = fft.next_fast_len(sound.shape[-1] + len(call), real=True)
    held = np.conj(fft.rfft(call, length)) / (call @ call)
    compressed = fft.irfft(fft.rfft(sound, length) * held, length)[..., : sound.shape[-1]]
    return band_power(compressed, SONAR)[0].astype(np.float32)


class Listener:
    """A way to tell, by its name (``LISTENERS``)."""

    def __init__(self, name: str) -> None:
        if name not in LISTENERS:
            raise unknown("listener", name, LISTENERS)
        self.name = name
        self.level = THRESHOLDS[0]

    def fit(self, power: np.ndarray, is_there: np.ndarray, seed: int = 1) -> Listener:
        """Learn from echoes.

        power : (M, B, S) of echoes, see ``sensed``. is_there : (M,) bool. seed : of where
        the network starts.
        """
        if self.name == "first crossing":
            self._largest = np.median(power[~is_there].max(axis=2), axis=0)
            some = np.arange(len(power)) // 2 % 2 == 0
            worth = []
            for level in THRESHOLDS:  # fitted by one half, it tells the other
                first = crossings(power, level**2 * self._largest)
                weights = discriminant(first[some], is_there[some])
                worth.append(area_under_curve(first[~some] @ weights[:-1], is_there[~some]))
            self.level = THRESHOLDS[int(np.argmax(worth))]
        features = self._features(power)
        if self.name == "network":
            self._mean = features.mean(axis=0)
            _, size, axes = np.linalg.svd(features - self._mean, full_matrices=False)
            scale = np.maximum(size[:COMPONENTS] / np.sqrt(len(features)), 1e-12)
            self._axes = axes[:COMPONENTS].T / scale
            inputs = (features - self._mean) @ self._axes
            self._weights = network(inputs, is_there, stream(seed, "listen", "network"))
        else:
            self._weights = discriminant(features, is_there)
        return self

    def score(self, power: np.ndarray) -> np.ndarray:
        """(M,) how much echoes (M, B, S) sound as if it were there; above 0: yes."""
        features = self._features(power)
        if self.name == "network":
            return _layers(self._weights, (features - self._mean) @ self._axes)[1]
        return np.asarray(features @ self._weights[:-1] + self._weights[-1])

    def _features(self, power: np.ndarray) -> np.ndarray:
        """(M, F)."""
        if self.name == "energy":
            return np.log(power.sum(axis=(1, 2), dtype=np.float64) + 1e-30)[:, None]
        if self.name == "first crossing":
            return crossings(power, self.level**2 * self._largest)
        return levels(power).reshape(len(power), -1)


def crossings(power: np.ndarray, level: np.ndarray) -> np.ndarray:
    """(M, B) milliseconds after which each band's squared envelope (M, B, S) is above its level (B,) first;
    the end of the record where it never is.
    """
    above = power > level[:, None]
    first = above.argmax(axis=2).astype(float)
    first[~above.any(axis=2)] = power.shape[2]
    return first * 1e3 / SONAR.sample_rate


def discriminant(features: np.ndarray, is_it: np.ndarray, ridge: float = 0.1) -> np.ndarray:
    """(F + 1,) weights and offset of Fisher's linear discriminant (1936) of features (M, F).

    ridge : share of the mean variance that is added to each, so that few samples do for many features.
    """
    yes, no = features[is_it], features[~is_it]
    spread = np.atleast_2d(np.cov(yes, rowvar=False) + np.cov(no, rowvar=False)) / 2
    spread = spread + np.eye(len(spread)) * (ridge * np.trace(spread) / len(spread) + 1e-12)
    weights = np.linalg.solve(spread, yes.mean(axis=0) - no.mean(axis=0))
    middle = (yes.mean(axis=0) + no.mean(axis=0)) / 2
    return np.append(weights, -weights @ middle)


def network(inputs: np.ndarray, is_it: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Weights of a network of one hidden layer that tells inputs (M, F) apart: the least cross-entropy, with
    ``DECAY`` times half of their squares, from where ``rng`` starts it."""
    count = inputs.shape[1]

    def cost(weights: np.ndarray) -> tuple[float, np.ndarray]:
        inner, out = _layers(weights, inputs)
        value = np.mean(np.logaddexp(0.0, out) - is_it * out) + DECAY / 2 * weights @ weights
        wrong = (expit(out) - is_it) / len(out)
        back = wrong[:, None] * weights[-UNITS - 1 : -1] * (1.0 - inner**2)
        first = np.column_stack([back.T @ inputs, back.sum(axis=0)])
        slope = np.concatenate([first.ravel(), inner.T @ wrong, [wrong.sum()]])
        return float(value), slope + DECAY * weights

    start = 0.3 * rng.standard_normal(UNITS * (count + 1) + UNITS + 1)
    return np.asarray(minimize(cost, start, jac=True, method="L-BFGS-B").x)


def _layers(weights: np.ndarray, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, UNITS) what the hidden units say of inputs (M, F), and (M,) what comes out."""
    first = weights[: -UNITS - 1].reshape(UNITS, -1)
    inner = np.tanh(inputs @ first[:, :-1].T + first[:, -1])
    return inner, inner @ weights[-UNITS - 1 : -1] + weights[-1]


def area_under_curve(score: np.ndarray, is_it: np.ndarray) -> float:
    """Chance that one that is it (M,) bool scores higher than one that is not, ties counted half: the area
    under the ROC curve (Mann & Whitney 1947).
    """
    yes, no = int(is_it.sum()), int((~is_it).sum())
    if not yes or not no:
        return 0.5
    return float((rankdata(score)[is_it].sum() - yes * (yes + 1) / 2.0) / (yes * no))
