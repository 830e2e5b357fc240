"""An echo's audit: silent on what is right, loud on what is wrong or was left out."""

from dataclasses import replace

import numpy as np
import pytest
from references.echoes import scene_of

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, TriMesh
from forest_addon.sensing.audit import held
from forest_addon.sensing.sonar.audit import Pings, parts_of_echoes
from forest_addon.sensing.sonar.ping import ping
from forest_addon.sensing.sonar.station import Equipment, posed
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar

AIR = Air()
SMOOTH = 2e-5  # of Σ max|A|, that splines of the exact disc are smooth to, all in phase
BAT = Sonar(position=(0, 0, 0), shading="none", beam_width_deg=(90, 90))


def targets(count=400):
    rng = stream(2, "audit")
    middle = rng.uniform([2, -1, -1], [4, 1, 1], (count, 1, 3))
    corners = middle + rng.normal(0, 0.03, (count, 3, 3))
    mesh = TriMesh.of_part(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), LEAF)
    return EchoTargets(scene_of(replace(mesh, leaf=np.arange(count, dtype=np.int32))))


def audit(echo, sonar, share=0.3, things=None):
    given = [echo], [echo.pose], things or targets(), sonar, AIR, None, None, Equipment.of(sonar)
    return held(parts_of_echoes(Pings(*given), share), stream(1, "a"), 1.0)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("tolerance", "cull", "model"),
    [(1e-2, 0.0, "exact"), (1e-6, 1e-2, "piston"), (1e-8, 1e-2, "exact"), (1e-8, 0.0, "piston")],
)
def test_what_is_right_is_kept(tolerance, cull, model):
    sonar = BAT.changed(tolerance=tolerance, cull=cull, leaf_model=model)
    found = audit(ping(targets(), sonar, AIR), sonar, share=0.05)
    assert found.kept, str(found)
    least = SMOOTH if model == "exact" else 0.0
    assert spectrum(found).allowed <= max(tolerance, least) + cull + 1e-11
    assert found.checked >= 4


def test_what_was_left_out_without_leave_is_found():
    """An echo that culled a tenth where a ten-thousandth was allowed."""
    sonar = BAT.changed(cull=0.1, beam_width_deg=(20, 20))
    echo = ping(targets(), sonar, AIR)
    assert echo.cull_bound > 1e-3
    assert not audit(echo, sonar.changed(cull=1e-4), share=2.0).kept


def test_a_short_ping_is_not_looked_for_again():
    """Some bins, not the search for all that could be heard."""
    sonar = BAT.changed(cull=1e-3)
    found = spectrum(audit(ping(targets(), sonar, AIR), sonar, share=1e-3))
    assert "everything heard" in found.what
    assert found.allowed <= 1.5 * sonar.tolerance


def spectrum(found):
    """The check of a spectrum."""
    return next(check for check in found.checks if "bins of the spectrum" in check.what)


@pytest.mark.slow
def test_waveforms_of_a_moving_sonar_are_looked_at():
    sonar = BAT.changed(call="fm", doppler=True)
    pose = posed(sonar)
    few = targets(12)
    echo = ping(few, sonar, AIR, pose=replace(pose, velocity=12.0 * pose.frame[0]))
    assert audit(echo, sonar, 0.05, few).kept
    for name in ("waveforms", "called", "responses", "envelopes"):
        louder = {name: 1.01 * getattr(echo, name)}
        assert not audit(replace(echo, **louder), sonar, 0.05, few).kept, name


def test_silence_is_right():
    far = BAT.changed(max_range=1.0)
    assert audit(ping(targets(), far, AIR), far, share=0.0).error == 0


def test_one_facet_far_off_is_heard_to_the_last_digits_of_its_phase():
    """Two float64 sums of an echo of 10⁵ cycles differ by more than 1e-12 of it; more than that is found."""
    corners = np.array([(160, 0, 0), (160, 0.02, 0), (160.007, 0, 0.02)])
    mesh = TriMesh.of_part(corners, np.arange(3)[None], LEAF)
    obj = EchoTargets(scene_of(replace(mesh, leaf=np.zeros(1, dtype=np.int32))))
    sonar = replace(BAT, tolerance=0.0, cull=0.0, max_range=200.0)
    echo = ping(obj, sonar, AIR)
    assert audit(echo, sonar, things=obj).kept
    turned = replace(echo, spectra=echo.spectra * np.exp(1e-9j))
    assert not spectrum(audit(turned, sonar, things=obj)).kept
