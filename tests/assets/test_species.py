"""The species that ship: every one loads, cites its source, and grows as its source says."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.lsystem.branching import interpret, skeleton_of, string_of
from forest_addon.growth.tree import grow
from forest_addon.spec import Jitter, SpecError

FILES = sorted((ASSETS / "species").glob("*.toml"))
STILL = Jitter(length=0, angle_deg=0, twist_deg=0, raise_ratio=0, lean_deg=0)
# height in metres, leaves: each from, to
EXPECTED = {
    "apple": ((2.5, 4.5), (500, 5_000)),
    "apple-leafless": ((2.5, 4.5), (0, 0)),
    "apple-stochastic": ((2.0, 4.5), (1_000, 20_000)),
    "ginkgo": ((6, 12), (20_000, 30_000)),
    "honda-birch": ((6, 14), (8_000, 80_000)),
    "honda-broadleaf": ((6, 14), (5_000, 80_000)),
    "honda-conifer": ((9, 17), (15_000, 60_000)),
    "honda-willow": ((5, 11), (10_000, 80_000)),
}


def loaded(name):
    return load_species(find_species(name, Path()))


@pytest.mark.medium
@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_species_is_named_sourced_and_grows(path):
    species, template = load_species(path)
    assert species.name == path.stem
    assert any(
        source in species.source
        for source in ("Tanveer", "Wahed", "Méndez", "ABOP", "Runions", "Callaham")
    )
    if template is not None:
        return  # grafted trees have tests of their own
    skeleton, leaves = skeleton_of(species, stream(1, "preset"))
    assert np.isfinite(skeleton.end).all()
    assert skeleton.radius.min() > 0
    assert (skeleton.parent < np.arange(len(skeleton))).all()
    again, _ = skeleton_of(species, stream(1, "preset"))
    assert (again.end == skeleton.end).all()
    if leaves:
        assert leaves.length.min() > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPECTED)
def test_trees_have_natural_sizes_and_stay_above_the_ground(name):
    species, _ = loaded(name)
    (lowest, highest), (fewest, most) = EXPECTED[name]
    for seed in range(4):
        skeleton, leaves = skeleton_of(species, stream(seed, "preset"))
        assert lowest <= skeleton.end[:, 2].max() <= highest
        assert skeleton.end[:, 2].min() > -0.25  # a willow's twigs may sweep the ground
        assert fewest <= len(leaves) <= most


@pytest.mark.slow
@pytest.mark.parametrize("branches", [8, 12, 16])
def test_whorls_have_as_many_first_level_branches_as_the_paper_draws(branches):
    species, template = loaded(f"whorl-{branches}")
    symbols = string_of(species.grammar)
    assert symbols.tobytes().count(b"d") == branches * 3 // 4  # 6, 9 and 12, as in its strings
    skeleton = interpret(symbols, species.grammar, STILL, stream(0, "whorl"))
    firsts = np.flatnonzero(skeleton.order == 1)
    assert len(firsts) * species.grammar.copies == branches
    assert (skeleton.order <= 1).all()
    assert len(np.unique(np.round(skeleton.start[firsts, 2], 9))) == branches // 4
    tree = grow(species, template, stream(1, "whorl"))
    assert len(np.unique(tree.leaves.branch)) == branches + 1  # and a leader
    assert 2.5 < tree.height < 12


def test_ginkgo_without_jitter_has_the_papers_measures():
    species, _ = loaded("ginkgo")
    skeleton = interpret(string_of(species.grammar), species.grammar, STILL, stream(0, "g"))
    assert skeleton.end[0].tolist() == [0, 0, 2.0]
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    ratio = np.round((length / length[np.maximum(skeleton.parent, 0)])[1:], 6)
    assert set(ratio.tolist()) == {0.62, 0.826}
    assert skeleton.radius[0, 0] == 0.04
    _, leaves = skeleton_of(species, stream(1, "g"))
    # 4 x 4 leaves at 3^6 tips and at their copies; the tip of the trunk is not copied
    assert len(leaves) == 16 * (2 * 3**6 - 1)
    assert leaves.length.mean() / 2 == pytest.approx(0.025, abs=5 * 0.005 / np.sqrt(len(leaves)))


def test_a_users_species_in_any_folder(tmp_path):
    (tmp_path / "mine.toml").write_text(
        'name = "mine"\n[rules]\naxiom = "F"\nproductions = ["F -> F[+F]"]\n'
    )
    species, template = load_species(find_species("mine.toml", tmp_path))
    assert template is None
    assert len(skeleton_of(species, stream(0))[0]) == 2**5
    (tmp_path / "bad.toml").write_text(
        'name = "bad"\n[rules]\naxiom = "F"\nproductions = ["F -> F(lenght)"]\n'
    )
    with pytest.raises(SpecError, match=r'bad.toml: rules: production "F -> F\(lenght\)"'):
        load_species(tmp_path / "bad.toml")
