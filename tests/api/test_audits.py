"""Audits look at all that was returned: an error planted in any field is seen, and right results pass.

What is derived or computed again whole is seen however few values it is in. What is drawn is wrong throughout
here, or over a tenth of the result, as an error of a model or of a batch is. Not seen: errors of ``errors``,
the octaves' estimates that a fast sum gives of itself.
"""

from dataclasses import fields, replace

import numpy as np
import pytest

import forest_addon.api as forest
from forest_addon.base.rng import stream
from forest_addon.sensing.audit import held
from forest_addon.sensing.kind import Observation
from forest_addon.sensing.kinds import kind_of
from forest_addon.sensing.lidar import cloud as clouds
from forest_addon.sensing.lidar.audit import parts_of_scan
from forest_addon.sensing.lidar.cloud import Cloud, Returns
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.sensing.lidar.tractor import TractorScan
from forest_addon.sensing.lidar.waveform import Waveforms
from forest_addon.sensing.reverb.channels import ImpulseResponse
from forest_addon.sensing.sonar.echo import Contributions, Echo
from forest_addon.sensing.sonar.receiver import Reception
from forest_addon.sensing.sonar.station import SonarPose
from forest_addon.spec import (
    Accuracy,
    Beam,
    Forest,
    Planting,
    Receiver,
    Reverb,
    Scene,
    Sonar,
    SonarReceiver,
    Terrestrial,
    Tractor,
)

BEAM = Beam(divergence_mrad=(2.0, 2.0), subrays=3, max_returns=5)
TRIPOD = Terrestrial(name="cloud", position=(6, 6, 1.6), angle_step_deg=1.6, beam=BEAM)
WAVES = TRIPOD.changed(
    name="waves",
    angle_step_deg=3.0,
    faintest=0.01,
    receiver=Receiver(sample_ns=1.0, threshold_snr=3.0),
)
ROWS = Tractor(name="rows", position=(-2, 0, 1), track=8.0, step=0.05, angle_step_deg=0.5, splits=1)
BAT = Sonar(
    name="bat",
    position=(6, -2, 2),
    azimuth_deg=90,
    max_range=4.0,
    call="fm",
    tolerance=1e-6,
    cull=0.0,
)
EAR = BAT.changed(
    name="ear",
    receiver=SonarReceiver(
        source_level_db=110.0, self_noise_db=0.0, overload_db=90.0, bits=12, threshold_db=6.0
    ),
)
CLAP = Reverb(
    name="clap", source=(2, 2, 1.5), receiver=(9, 9, 1.5), sample_rate=8000, tolerance=1e-3,
    duration=0.2, continue_to=40.0, model="paper",
)  # fmt: skip
STAND = CLAP.changed(name="stand", model="forest", continue_to=20.0)
SENSORS = {each.name: each for each in (TRIPOD, WAVES, ROWS, BAT, EAR, CLAP, STAND)}
SEEDS = 3

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def world():
    planting = Planting(species="hazelnut", variants=2, expected=5, exact=True)
    asked = Scene(
        seed=7,
        forest=Forest(size=(12.0, 12.0)),
        plantings=(planting,),
        accuracy=Accuracy(audit=0.0),
    )
    return forest.build(asked)


@pytest.fixture(scope="module")
def right(world):
    return {name: world.look(each).found for name, each in SENSORS.items()}


def check(world, name, found, seed=0):
    settings = world.scene.changed(accuracy=Accuracy(audit=0.05))
    job = Observation(SENSORS[name], world.observer, settings)
    return held(kind_of(SENSORS[name]).audit(job, found), stream(seed, "audits"), 1.0)


def off(value, rows):
    """A value that is wrong; of an array some rows, by a twentieth and a ten-thousandth of the largest."""
    if not isinstance(value, np.ndarray):
        if value is None:
            return np.ones(1)
        if isinstance(value, str):
            return value + "?"
        if isinstance(value, tuple):
            return tuple(off(one, rows) for one in value) or ("?",)
        if isinstance(value, bool):
            return not value
        return 1.01 * value + 1 if np.isfinite(value) else 0.5
    flat = value.ravel().copy()
    some = flat[rows]
    if flat.dtype.kind in "iu":
        flat[rows] = some + 1
    elif flat.dtype.kind == "U":
        flat[rows] = np.where(some == "leaf", "wood", "leaf")
    else:
        size = np.abs(flat).max(initial=0.0, where=np.isfinite(flat))
        flat[rows] = np.where(np.isfinite(some), 1.05 * some + 1e-4 * (size or 1.0), 0.5)
    return flat.reshape(value.shape)


def planted(found, name, where=0.9):
    """A result with an error in a field, arrays from a share of their length on."""
    table, _, column = name.rpartition(".")
    of = getattr(found, table) if table else found
    value = getattr(of, column)
    rows = slice(int(where * value.size) if isinstance(value, np.ndarray) else 0, None)
    wrong = replace(of, **{column: off(value, rows)})
    if table == "heard":
        return replace(found, list_heard=lambda: wrong)
    return replace(found, **{table: wrong}) if table else wrong


def names(table, but=(), within=""):
    return [within + each.name for each in fields(table) if each.name not in but]


LATER = {
    "returns",
    "lost",
    "velocity",
    "rest",
    "bounce",
    "waves",
}  # a table, and what a still scene has not
SUMS = {"groups", "list_heard", "pose"}
PARTS = {"errors", "further", "plain", "component", "model_error", "stand", "tail", "joint"}
FIELDS = {
    "cloud": names(Cloud, LATER) + names(Returns, within="returns."),
    "waves": names(Waveforms, within="waves."),
    "rows": names(TractorScan, {"returns"}) + names(Returns, within="returns."),
    "bat": names(Echo, SUMS)
    + names(SonarPose, {"width"}, "pose.")
    + names(Contributions, {"velocity", "rest"}, "heard."),
    "ear": names(Reception, within="received."),
    "clap": names(ImpulseResponse, PARTS),
    "stand": [*names(ImpulseResponse, PARTS), "tail", "joint"],
}


def cut(cloud, keep):
    return cloud.select(np.flatnonzero(keep))


def moved(cloud, rows, metres):
    position = cloud.position.copy()
    position[rows] += metres
    return replace(cloud, position=position)


def told(cloud, **columns):
    return replace(cloud, returns=replace(cloud.returns, **columns))


def swapped(column):
    return np.select([column == 1, column == 2], [2, 1], column)


def lost(scan):
    distance = scan.returns.distance.copy()
    distance[::100] = np.inf
    return told(scan, distance=distance)


OTHERS = {
    "cloud": {
        "28 points moved": lambda c: moved(c, slice(100, 128), 0.01),
        "all moved by a micrometre": lambda c: moved(c, slice(None), 1e-6),
        "the first 20 pulses lost": lambda c: cut(c, c.pulse >= c.pulse[0] + 20),
        "one point in a thousand dropped": lambda c: cut(c, np.arange(len(c)) % 1000 != 7),
        "one pulse in two hundred dropped": lambda c: cut(c, c.pulse % 200 != 100),
        "half of the points": lambda c: cut(c, np.arange(len(c)) < len(c) // 2),
        "one return too many": lambda c: clouds.join(
            [replace(c, pulses=c.pulses), replace(c.select(np.array([5])), pulses=0)]
        ),
        "normals that are no numbers": lambda c: told(c, normal=np.nan * c.returns.normal),
        "trees 1 and 2 swapped": lambda c: told(c, tree=swapped(c.returns.tree)),
        "wood and leaves swapped": lambda c: told(c, organ=swapped(c.returns.organ)),
    },
    "rows": {
        "mirrored": lambda f: replace(
            f, returns=f.returns.select(np.arange(len(f.returns.leaf))[::-1])
        ),
        "one beam in a hundred lost": lost,
    },
    "bat": {
        "times in milliseconds": lambda e: replace(e, time=1e3 * e.time),
        "a millisecond late": lambda e: replace(e, time=e.time + 1e-3),
        "waveforms a sample late": lambda e: replace(e, waveforms=np.roll(e.waveforms, 1, axis=1)),
        "spectra turned in phase": lambda e: replace(e, spectra=1j * e.spectra),
        "all of it one per cent louder": lambda e: replace(
            e,
            **{
                name: 1.01 * getattr(e, name)
                for name in ("spectra", "called", "responses", "envelopes", "waveforms")
            },
        ),
    },
    "clap": {
        "ground left out": lambda r: replace(r, ground=0.0 * r.ground),
        "trunks a sample late": lambda r: replace(r, trees=np.roll(r.trees, 1)),
        "the last tenth a fifth louder": lambda r: replace(
            r, trees=r.trees * np.where(np.arange(len(r.trees)) > 0.9 * len(r.trees), 1.2, 1.0)
        ),
        "3 dB more at 31 Hz": lambda r: replace(r, trees=louder_at(r.trees, 22.0, 44.0)),
        "one trunk in ten dropped": lambda r: replace(r, trunks=r.trunks - r.trunks // 10),
    },
}


def louder_at(samples, low, high):
    spectrum = np.fft.rfft(samples)
    frequency = np.fft.rfftfreq(len(samples), 1 / CLAP.sample_rate)
    spectrum[(frequency > low) & (frequency < high)] *= 2**0.5
    return np.fft.irfft(spectrum, len(samples))


@pytest.mark.parametrize(("name", "field"), [(n, f) for n, some in FIELDS.items() for f in some])
def test_an_error_in_any_field_is_seen(world, right, name, field):
    found = check(world, name, planted(right[name], field))
    assert not found.kept, str(found)


@pytest.mark.parametrize(("name", "error"), [(n, e) for n, some in OTHERS.items() for e in some])
def test_other_errors_are_seen(world, right, name, error):
    found = check(world, name, OTHERS[name][error](right[name]))
    assert not found.kept, str(found)


def test_an_engine_that_lost_a_mesh_is_seen(world):
    from forest_addon.blender.rays.casters import make_caster

    whole = world.observer.geometry
    mesh = int(whole.mesh_index[np.flatnonzero(whole.tree >= 0)[0]])
    nothing = whole.meshes[mesh].select(np.zeros(len(whole.meshes[mesh].triangles), dtype=bool))
    meshes = tuple(nothing if n == mesh else m for n, m in enumerate(whole.meshes))
    blind = Scan(TRIPOD, make_caster(replace(whole, meshes=meshes), world.scene.rays))
    cloud = clouds.join([piece for _, piece in blind.chunks()])
    assert not held(parts_of_scan(blind, cloud, 0.05, whole), stream(1, "a"), 1.0).kept


@pytest.mark.parametrize("name", SENSORS)
def test_no_false_alarm_and_the_same_again(world, right, name):
    for seed in range(SEEDS):
        found = check(world, name, right[name], seed)
        assert found.kept, (seed, str(found))
    assert check(world, name, right[name], seed).checks == found.checks


def test_what_is_not_looked_at_whole_says_what_it_sees(world, right):
    found = check(world, "cloud", right["cloud"])
    assert all(0 < check.share <= 1 for check in found.checks)
    drawn = [check for check in found.checks if check.checked < check.of]
    assert drawn
    for each in drawn:
        assert (1 - each.sees) ** each.checked == pytest.approx(0.05)
    assert "sees errors in" in str(found)
    written = found.record()["checks"]
    assert [each["sees"] for each in written] == [check.sees for check in found.checks]
