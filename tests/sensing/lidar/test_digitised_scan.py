"""Echoes as HELIOS++ finds them: the same wherever a scan is cut."""

import numpy as np
import pytest
from references.lidar_scenes import ground, scene_with, wall
from references.rays_brute import BruteCaster

from forest_addon.formats.helios.device import Digitiser
from forest_addon.sensing.lidar.surveys.digitised import SurveyScan
from forest_addon.spec import Beam, Noise, Terrestrial

BEAM = Beam(divergence_mrad=(2.0, 2.0), subrays=19, pulse_ns=4.0, max_returns=9)


def survey(**settings):
    scanner = Terrestrial(
        position=(0.0, 0.0, 1.7),
        azimuth_deg=(-60.0, 60.0),
        elevation_deg=(-20.0, 12.0),
        angle_step_deg=1.5,
        beam=BEAM,
        noise=Noise(),
        **{"min_range": 0.5, "max_range": 300.0} | settings,
    )
    caster = BruteCaster(scene_with(ground(200.0), wall(15.0, 6.0), wall(30.0, 30.0)))
    return SurveyScan(scanner, caster, 3).sampled(Digitiser(3, 0.25, 1.0))


@pytest.mark.medium
def test_echoes_do_not_know_where_a_scan_is_cut():
    scan = survey()
    whole = scan.look(0, scan.pulses)
    for at_once in (190, 700):
        pieces = [cloud for _, cloud in scan.chunks(at_once=at_once)]
        for name in ("position", "width", "intensity"):
            found = np.concatenate([getattr(piece, name) for piece in pieces])
            np.testing.assert_allclose(found, getattr(whole, name), rtol=0, atol=1e-9)
