"""Surveys of HELIOS++: small ones of our own, whose pulses and ranges have closed forms."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from forest_addon.formats.helios.document import read_document
from forest_addon.formats.helios.scene import read_scene
from forest_addon.formats.helios.survey import read_survey
from forest_addon.sensing.lidar.surveys.leg import SurveyLeg
from forest_addon.spec import SpecError
from headless.surveys import scan_survey

GROUND = """mtllib ground.mtl
v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
usemtl soil
f 1 2 3 4
"""
BLOCK = """v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f -4 -3 -2
f 1//1 3//1 4//1
"""
SCENE = """<document><scene id="s">
<part><filter type="objloader"><param key="filepath" value="parts/ground.obj"/></filter>
<filter type="scale"><param key="scale" value="100"/></filter>
<filter type="translate"><param key="offset" value="0;0;2"/></filter></part>
<part id="block"><filter type="objloader"><param key="filepath" value="parts/block.obj"/></filter>
<filter type="translate"><param key="onGround" value="-1"/><param key="offset" value="10;0;50"/></filter>
<filter type="rotate"><param key="rotation"><rot axis="z" angle_deg="90"/></param></filter>
<filter type="scale"><param key="scale" value="3"/></filter>EXTRA</part>
</scene></document>"""
LIBRARY = """<document>
<platform id="tripod" type="static"><scannerMount z="1.5"/></platform>
<platform id="plane" type="linearpath">
<scannerMount><rot axis="x" angle_deg="-90"/></scannerMount></platform>
<platform id="copter" type="multicopter"/><platform id="hover" type="hovercraft"/>
<scanner id="fan" optics="rotating" scanAngleMax_deg="90" scanAngleEffectiveMax_deg="60"
 pulseFreqs_Hz="1000" rangeMin_m="0.5" pulseLength_ns="4" beamDivergence_rad="0.0003">
<beamOrigin x="0" y="0" z="0.2"/></scanner>
<scanner id="cone" optics="conic" scanAngleMax_deg="20" scanFreqMax_Hz="10" pulseFreqs_Hz="1000"/>
<scanner id="swing" optics="oscillating" scanAngleMax_deg="20"/>
<scanner id="prism" optics="spiral"/>
</document>"""
TRIPOD = """<document><scannerSettings id="t" pulseFreq_hz="1000" scanFreq_hz="10">TEMPLATE</scannerSettings>
<survey name="n" scene="scene.xml#s" platform="library.xml#PLATFORM"
 scanner="library.xml#SCANNER">LEGS</survey>
</document>"""
LEG = """<leg><platformSettings x="0" y="0" z="9" onGround="true"/><scannerSettings template="t"
 headRotatePerSec_deg="20" headRotateStart_deg="-90" headRotateStop_deg="-50"
 verticalAngleMin_deg="-44" verticalAngleMax_deg="-30"/></leg>"""
FLIGHT = """<leg><platformSettings x="0" y="-10" z="52" movePerSec_m="20"/>
<scannerSettings template="t" scanAngle_deg="20"/></leg>
<leg><platformSettings x="0" y="10" z="52"/><scannerSettings active="false"/></leg>"""


def written(
    folder: Path,
    legs: str = LEG,
    platform: str = "tripod",
    scanner: str = "fan",
    extra: str = "",
    template: str = "",
) -> Path:
    (folder / "parts").mkdir(exist_ok=True)
    (folder / "parts/ground.obj").write_text(GROUND)
    (folder / "parts/ground.mtl").write_text("newmtl soil\nhelios_isGround true\n")
    (folder / "parts/block.obj").write_text(BLOCK)
    (folder / "scene.xml").write_text(SCENE.replace("EXTRA", extra))
    (folder / "library.xml").write_text(LIBRARY)
    text = TRIPOD.replace("LEGS", legs).replace("PLATFORM", platform).replace("SCANNER", scanner)
    text = text.replace("TEMPLATE", template)
    (folder / "survey.xml").write_text(text)
    return folder / "survey.xml"


def test_part_is_scaled_turned_moved_and_set_on_the_ground(tmp_path: Path) -> None:
    survey = written(tmp_path)
    (ground, block), unread = read_scene("scene.xml#s", survey)
    assert unread == []
    assert ground.mesh.ground.all()
    corners = block.corners.reshape(-1, 3)
    # 3 m along x and y, turned by 90 degrees to -3..0 by 0..3, moved by 10; its face on the ground at 2 m
    np.testing.assert_allclose(corners.min(axis=0), [7, 0, 2], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [10, 3, 2], atol=1e-12)


def test_a_part_whose_material_file_is_lost_is_told_among_the_notes(tmp_path: Path) -> None:
    file = written(tmp_path)
    (tmp_path / "parts/block.obj").write_text(f"mtllib gone.mtl\n{BLOCK}")
    (note,) = read_survey(file).notes
    assert note.startswith("block.obj: its material file gone.mtl is not there")


def test_tripod_sends_the_pulses_of_its_window(tmp_path: Path) -> None:
    survey = read_survey(written(tmp_path))
    pattern = SurveyLeg(survey, survey.legs[0])
    pulses = pattern.pulses(np.arange(pattern.count))
    np.testing.assert_allclose(pulses.origin, np.tile([0, 0, 2 + 1.5 + 0.2], (pattern.count, 1)))
    elevation = np.rad2deg(np.arcsin(pulses.direction[:, 2]))
    # 10 lines of 180 degrees a second are 1.8 degrees a pulse: -43.2 to -30.6 of each line of 2 s
    np.testing.assert_allclose(elevation[:8], -43.2 + 1.8 * np.arange(8), atol=1e-9)
    assert pattern.count == 20 * 8
    azimuth = np.rad2deg(np.arctan2(pulses.direction[:, 1], pulses.direction[:, 0]))
    np.testing.assert_allclose(azimuth, 0 + 20 * pulses.time, atol=1e-9)  # forward is +Y


def test_cone_meets_the_ground_on_a_circle_that_flies(tmp_path: Path) -> None:
    survey = read_survey(written(tmp_path, FLIGHT, "plane", "cone"))
    (leg,) = survey.legs
    pattern = SurveyLeg(survey, leg)
    assert pattern.count == 1000  # 20 m at 20 m/s
    pulses = pattern.pulses(np.arange(pattern.count))
    np.testing.assert_allclose(pulses.direction[:, 2], -np.cos(np.deg2rad(20)), atol=1e-12)
    np.testing.assert_allclose(pulses.origin[:, 1], -10 + 20 * pulses.time, atol=1e-9)
    assert abs(pulses.direction[:, :2].mean(axis=0)).max() < 1e-9  # ten whole turns


def test_survey_runs_into_a_file_a_leg_and_meets_the_plane(tmp_path: Path) -> None:
    target = tmp_path / "out/cloud.npz"
    (leg,) = scan_survey(written(tmp_path), target, quiet=True)
    points = np.load(tmp_path / "out/cloud-leg000.npz")
    assert leg.points == len(points["x"]) == leg.pulses > 100
    np.testing.assert_allclose(
        points["z"], 2.0, atol=1e-3
    )  # all looks down at the ground or the block


def test_counts_stand_beside_those_of_a_reference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    counts = {"points": 100, "pulses_with_returns": 100, "returns_per_pulse": {"1": 100}}
    reference = tmp_path / "reference.json"
    reference.write_text(json.dumps({"legs": {"leg000": {**counts, "mean_xyz": [0, 0, 2]}}}))
    (leg,) = scan_survey(written(tmp_path), tmp_path / "c.npz", reference=reference)
    assert f"{100 * (leg.points / 100 - 1):+.2f}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extra": '<filter type="detailedvoxels"/>'}, "detailedvoxels"),
        ({"platform": "hover"}, "hovercraft"),
        ({"scanner": "prism"}, "spiral"),
        ({"legs": LEG.replace('z="9"', 'z="9" yaw_deg="3"')}, "yaw_deg"),
        ({"legs": LEG.replace('template="t"', 'template="u"')}, '"u"'),
        ({"legs": "<detectorOverrides/>" + LEG}, "detectorOverrides"),
        ({"legs": LEG.replace("<scanner", "<wind/><scanner", 1)}, 'leg holds "wind"'),
        ({"legs": LEG.replace("<scanner", "<platformSettings/><scanner", 1)}, "platformSettings 2"),
        ({"extra": "<material/>"}, 'holds "material"'),
        ({"template": "<swap/>"}, 'scannerSettings t holds "swap"'),
        ({"extra": '<filter type="scale"><points/></filter>'}, 'filter holds "points"'),
    ],
)
def test_what_is_not_supported_is_refused_by_name(
    tmp_path: Path, change: dict[str, str], words: str
) -> None:
    with pytest.raises(SpecError, match=words):
        read_survey(written(tmp_path, **change))


def test_words_that_are_not_known_are_told(tmp_path: Path) -> None:
    extra = (
        '<filter type="scale"><param key="scale" value="2"/><param key="axis" value="z"/></filter>'
    )
    legs = LEG.replace("<leg>", '<leg pilot="me">', 1)
    notes = read_survey(written(tmp_path, legs, extra=extra)).notes
    assert [note.split(",")[0] for note in notes] == [
        'leg says "pilot"',
        'filter "scale" says "axis"',
    ]


def test_document_types_and_entities_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "bomb.xml"
    file.write_text('<!DOCTYPE d [<!ENTITY a "aaaa">]><d>&a;</d>')
    with pytest.raises(SpecError, match="DTD"):
        read_document(file)


def test_missing_part_is_named(tmp_path: Path) -> None:
    survey = written(tmp_path)
    (tmp_path / "parts/block.obj").unlink()
    with pytest.raises(SpecError, match=r"block\.obj"):
        read_survey(survey)
