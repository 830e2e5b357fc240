"""Several sources and receivers: where they are, what they are called, that each is as if it were alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.ends import ends_of
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Place, Reverb, SpecError

AIR = Air(sound_speed=343.0)


def test_one_of_each() -> None:
    ends = ends_of(Reverb())
    assert ends.channels == ("source to receiver",)
    np.testing.assert_array_equal(ends.pairs[0], [(5, 10, 1.5), (15, 10, 1.5)])


def test_names_and_places() -> None:
    reverb = Reverb(
        sources=(Place(position=(1.0, 2.0, 3.0)),),
        receivers=(Place(position=(4.0, 5.0, 6.0)),),
        receiver_objects="Ear, Camera ,",
    )
    ends = ends_of(reverb, {"Ear": (7.0, 8.0, 9.0), "Camera": (1.0, 1.0, 1.0)})
    assert ends.source_names == ("source", "source 2")
    assert ends.receiver_names == ("receiver", "receiver 2", "Ear", "Camera")
    assert ends.channels[4] == "source 2 to receiver"
    np.testing.assert_array_equal(ends.receivers[2], (7, 8, 9))


def test_a_pair_of_ears_and_a_slanted_row() -> None:
    ears = ends_of(Reverb(array=2, array_spacing=0.2)).receivers
    np.testing.assert_allclose(ears, [(15, 9.9, 1.5), (15, 10.1, 1.5)], atol=1e-12)
    row = ends_of(
        Reverb(array=5, array_spacing=0.5, array_azimuth_deg=30, array_elevation_deg=40)
    ).receivers
    np.testing.assert_allclose(row.mean(axis=0), (15, 10, 1.5))
    step = np.diff(row, axis=0)
    np.testing.assert_allclose(np.linalg.norm(step, axis=1), 0.5)
    np.testing.assert_allclose(np.arctan2(step[:, 1], step[:, 0]), math.pi / 6)
    np.testing.assert_allclose(step[:, 2], 0.5 * math.sin(math.radians(40)))


def test_refused_in_words() -> None:
    with pytest.raises(SpecError, match='"Ear" in the scene; it has Mouth'):
        ends_of(Reverb(receiver_objects="Ear"), {"Mouth": (0.0, 0.0, 1.0)})
    with pytest.raises(SpecError, match="above the ground"):
        ends_of(Reverb(source_objects="Mouth"), {"Mouth": (0.0, 0.0, 0.0)})
    with pytest.raises(SpecError, match="below the ground"):
        ends_of(Reverb(array=9, array_spacing=1.0, array_elevation_deg=90))
    with pytest.raises(SpecError, match="above the ground"):
        Place(position=(0.0, 0.0, -1.0))


@pytest.mark.medium
def test_each_channel_is_as_if_alone() -> None:
    rng = np.random.default_rng(0)
    trunks = Trunks(rng.uniform(-15, 35, (70, 2)), np.full(70, 0.2), np.arange(70))
    reverb = Reverb(
        sources=(Place(position=(0.0, 0.0, 2.0)),), array=2, duration=0.3, sample_rate=8000.0
    )
    found = impulse_response(trunks, reverb, AIR)
    assert [channel.channel for channel in found.channels] == list(ends_of(reverb).channels)
    for (source, receiver), channel in zip(ends_of(reverb).pairs, found.channels, strict=True):
        alone = Reverb(
            source=tuple(source), receiver=tuple(receiver), duration=0.3, sample_rate=8000.0
        )
        np.testing.assert_allclose(
            channel.samples,
            impulse_response(trunks, alone, AIR).samples,
            atol=1e-12,
        )
    assert not np.array_equal(found.samples, found.further[0].samples)


def test_all_channels_stand_in_the_same_forest() -> None:
    """Two receivers at one place hear the same, also of what goes on beyond the field."""
    rng = np.random.default_rng(0)
    trunks = Trunks(rng.uniform(0, 20, (40, 2)), np.full(40, 0.1), np.arange(40))
    reverb = Reverb(continue_to=80.0, duration=0.3, sample_rate=4000.0)
    twice = replace(reverb, receivers=(Place(position=reverb.receiver),))
    found = impulse_response(
        trunks, twice, AIR, rng=stream(1, "beyond"), field=((0.0, 0.0), (20.0, 20.0))
    )
    assert found.continued > 100
    np.testing.assert_array_equal(found.samples, found.further[0].samples)


def test_progress_runs_on_over_channels() -> None:
    trunks = Trunks(np.array([[9.0, 9.0]]), np.array([0.1]), np.zeros(1, np.int64))
    steps: list[tuple[int, int]] = []
    impulse_response(
        trunks,
        Reverb(array=3, duration=0.1, sample_rate=4000.0),
        AIR,
        progress=lambda done, total: steps.append((done, total)),
    )
    assert steps == [(1, 3), (2, 3), (3, 3)]
