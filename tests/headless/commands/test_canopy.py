"""The command ``canopy``: its figures are those of the world, its files those that it names."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.io import wavfile

from forest_addon.formats.ownership import RECORD
from headless.cli import main
from headless.commands.convolve import convolve
from studies.papers.reverb_figures import Study, draw_figures, findings, responses

pytest.importorskip("bpy")

from forest_addon import api
from forest_addon.sensing.canopy import OUTSIDE, SKY
from headless.commands.canopy import look_up_in

SCENE = """
seed = 3
[forest]
size = [8.0, 8.0]
[[plantings]]
species = "hazelnut"
variants = 1
expected = 6
exact = true
"""


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text(SCENE)
    return file


@pytest.mark.slow
def test_effective_and_true_index_and_pictures(scene, tmp_path):
    told = []
    seen = look_up_in(scene, tmp_path / "out", grid=2, height=0.5, say=told.append)
    world = api.build(api.read(scene))
    leaf = world.trees["leaf_area_m2"].sum() / 64
    assert world.leaf_area_index == pytest.approx(leaf)
    assert any(f"true leaf area index       {leaf:8.3f}" in line for line in told)
    assert 0 < seen.effective < 3 * leaf
    with open(tmp_path / "out/gaps.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["gap_fraction"]) for row in rows] == pytest.approx(seen.gap.tolist())
    with np.load(tmp_path / "out/hemispheres.npz") as held:
        pictures, points = held["picture"], held["point"]
    assert points.shape == (4, 3)
    assert (points[:, 2] == 0.5).all()
    shown = pictures[pictures != OUTSIDE]
    assert np.mean(pictures != OUTSIDE) == pytest.approx(np.pi / 4, abs=0.01)
    assert set(np.unique(shown).tolist()) <= {SKY, 0, 1, 2, 3}
    assert {SKY, 1, 2} <= set(np.unique(shown).tolist())
    assert imread(tmp_path / "out/hemispheres.png").std() > 0.05


# ------------------------------------------------------------------------------------------ convolve
# The commands that let one hear a forest, and the findings of the paper's figures.

ROOT = Path(__file__).resolve().parents[3]
CLAP = ROOT / "assets" / "sounds" / "clap.wav"


def test_convolve_from_the_command_line(headless, tmp_path):
    response = tmp_path / "ir.wav"
    wavfile.write(response, 48_000, np.array([[0, 1.0], [0.5, 0]], np.float32))
    headless("convolve", response, CLAP)
    rate, wet = wavfile.read(tmp_path / "ir-clap.wav")
    _, dry = wavfile.read(CLAP)
    assert (rate, wet.dtype) == (48_000, np.float32)
    np.testing.assert_allclose(wet[1:, 0], 0.5 * dry / 32768, atol=1e-7)
    np.testing.assert_allclose(wet[:-1, 1], dry / 32768, atol=1e-7)


def test_levels_above_full_scale_stay_unless_normalised(tmp_path):
    said = []
    wavfile.write(tmp_path / "ir.wav", 24_000, np.array([40.0], np.float32))
    convolve(tmp_path / "ir.wav", CLAP, tmp_path / "new" / "a.wav", None, said.append)
    assert np.abs(wavfile.read(tmp_path / "new" / "a.wav")[1]).max() > 10
    assert "resampled from 48000 to 24000 Hz" in said[0]
    assert "clip" in said[-1]
    convolve(tmp_path / "ir.wav", CLAP, tmp_path / "b.wav", -1.0, said.append)
    peak = np.abs(wavfile.read(tmp_path / "b.wav")[1]).max()
    assert peak == pytest.approx(10 ** (-0.05), rel=1e-5)


@pytest.mark.slow
def test_figures_and_findings(tmp_path, monkeypatch):
    """A tiny study: files, and verdicts that follow the responses they are given."""
    tiny = Study((300, 900), (10.0, 40.0), (1,))
    monkeypatch.setattr("studies.papers.reverb_figures.QUICK", tiny)
    sentences = draw_figures(tmp_path, quick=True, say=lambda _: None)
    assert len(list(tmp_path.glob("figure-*.png"))) == 4
    assert (tmp_path / "findings.txt").read_text(encoding="utf-8").splitlines() == sentences

    found = responses(tiny)
    noise = np.random.default_rng(0).standard_normal(96_000)
    time = np.arange(96_000) / 24e3

    sparse = noise * (np.arange(96_000) % 64 == 0) * 8.0  # of the same energy

    def decaying(number, distance):
        """Noise whose decay takes longer with more trees and with distance; of many, soon sparse."""
        seconds = (0.6 if number == 300 else 1.2) + distance / 40
        heard = np.where((time > 0.7) & (number == 900), sparse, noise)
        zero = np.zeros(96_000)
        return {"direct": zero, "ground": zero, "trees": heard * 10 ** (-3 * time / seconds)}

    made = {key: replace(each, **decaying(*key[:2])) for key, each in found.items()}
    verdicts = [": reproduced" in sentence for sentence in findings(tiny, made)]
    assert verdicts == [False, False, True, True]  # more trees, longer; C50 does not fall


# -------------------------------------------------------------------------------------------- derive
# ``python -m headless derive``: strings as the papers print them, counts, refusals.

S2 = (
    "[I01I01[t+I01I01+I02I02[t+I02I02+F]I02[T-I02F]I02F]I01[T-I01I02I02[t+I02I02+F]I02"
    "[T-I02F]I02F]I01I02I02[t+I02I02+F]I02[T-I02F]I02F]"
)


@pytest.mark.parametrize(
    ("words", "printed"),
    [
        ("apple --generations 2", S2),
        ("apple --generations 3", S2.replace("F", "I03I03[t+I03I03+F]I03[T-I03F]I03F")),
        ("apple --generations 0", "[F]"),
        ("maple --generations 2", "d(d(g)[g)+g)[d(g)[g)+g)+d(g)[g)+g)"),
        ("whorl-8", "d(d)+d)[d(d)+d)"),
        ("apple --generations 2 --count", "75 symbols, 9 branches"),
        ("maple --generations 12 --count", "2,125,762 symbols, 531,440 branches"),
    ],
)
def test_strings_and_counts_as_the_papers_print_them(headless, words, printed):
    assert headless("derive", *words.split()).stdout.strip() == printed


def test_strings_of_chance_follow_their_seed_and_are_counted_by_their_means(headless):
    words = ("derive", "apple-stochastic", "--generations", 3)
    one, again, other = (headless(*words, "--seed", seed).stdout for seed in (1, 1, 2))
    assert one == again != other
    first, _ = headless(*words, "--count").stdout.splitlines()
    assert first.startswith("expected: ")
    assert headless("derive", "apple", "--generations", 900, "--count").stdout.startswith("1e430 ")


# ------------------------------------------------------------------------------------------- species
# The table and the contact sheet of species.


@pytest.mark.slow
def test_the_table_a_sheet_and_small_pictures_for_the_panel(tmp_path, capsys, monkeypatch):
    pytest.importorskip("bpy")
    from PIL import Image

    from headless.report import trees

    monkeypatch.setattr(trees, "ICON", 64)
    folder, sheet = tmp_path / "new" / "pictures", tmp_path / "new" / "species.png"
    words = ["--pictures", str(folder), "--sheet", str(sheet), "--pixels", "150"]
    assert main(["species", "hazelnut", *words]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in ("hazelnut  ", "Wrote 1 pictures"))
    assert imread(sheet).std() > 0.05
    assert {path.name for path in folder.iterdir()} == {RECORD, "hazelnut.jpg"}
    with Image.open(folder / "hazelnut.jpg") as picture:
        assert picture.size == (64, 64)
        grey = np.asarray(picture.convert("L"), float)
    tree = grey < 180  # darker than the paper behind it
    assert 0.02 < tree.mean() < 0.5
    assert tree[:, 24:40].sum() > 0.5 * tree.sum()  # it stands in the middle
