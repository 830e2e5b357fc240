"""An echo's audit: silent on what is right, loud on what is wrong or was left out."""

from dataclasses import replace

import numpy as np
import pytest
from references.echo_scenes import scene_of

from forest_addon.growth.mesh.trimesh import LEAF, TriMesh
from forest_addon.rng import stream
from forest_addon.sensing.sonar.audit import audit_echoes
from forest_addon.sensing.sonar.ping import ping
from forest_addon.sensing.sonar.station import Equipment
from forest_addon.sensing.sonar.targets import Targets
from forest_addon.spec import Air, Sonar

AIR = Air()
BAT = Sonar(position=(0, 0, 0), shading="none", beam_width_deg=(90, 90))


def targets(count=400):
    rng = stream(2, "audit")
    middle = rng.uniform([2, -1, -1], [4, 1, 1], (count, 1, 3))
    corners = middle + rng.normal(0, 0.03, (count, 3, 3))
    mesh = TriMesh.of_part(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), LEAF)
    return Targets(scene_of(replace(mesh, leaf=np.arange(count, dtype=np.int32))))


def audit(echo, sonar, share=2.0):
    equipment = Equipment.of(sonar)
    return audit_echoes(
        [echo], targets(), sonar, AIR, None, None, equipment, stream(1, "a"), 1.0, share
    )


@pytest.mark.parametrize("tolerance", [1e-2, 1e-6, 1e-8])
@pytest.mark.parametrize("cull", [0.0, 1e-2])
@pytest.mark.parametrize("model", ["exact", "piston"])
def test_what_is_right_is_kept(tolerance, cull, model):
    sonar = BAT.changed(tolerance=tolerance, cull=cull, leaf_model=model)
    found = audit(ping(targets(), sonar, AIR), sonar, share=0.05)
    assert found.kept, str(found)
    if (
        model == "piston"
    ):  # the exact disc's table may reach less than is asked, and the echo says so
        assert found.allowed <= tolerance + cull + 1e-11
    assert found.checked >= 4


@pytest.mark.slow
def test_a_wrong_echo_is_found():
    echo = ping(targets(), BAT, AIR)
    assert not audit(replace(echo, spectra=1.001 * echo.spectra), BAT).kept


@pytest.mark.slow
def test_what_was_left_out_without_leave_is_found():
    """An echo that culled a tenth, and says that it culled nothing."""
    sonar = BAT.changed(cull=0.1, beam_width_deg=(20, 20))
    echo = ping(targets(), sonar, AIR)
    assert echo.cull_bound > 1e-3
    assert not audit(replace(echo, cull_bound=0.0), sonar).kept


def test_silence_is_right():
    far = BAT.changed(max_range=1.0)
    assert audit(ping(targets(), far, AIR), far, share=0.0).error == 0
