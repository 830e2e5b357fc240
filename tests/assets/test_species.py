"""The species that ship: every one loads, cites its source, and grows as its source says."""

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import WOOD
from forest_addon.formats.stl import read_stl
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.lsystem.branching import interpret, skeleton_of, string_of
from forest_addon.growth.mesh.leaves import Leaves
from forest_addon.growth.own_tree.template import TreeTemplate, split_tree
from forest_addon.growth.tree import grow
from forest_addon.sensing.sonar.equipment_files import equip, find, read_route
from forest_addon.spec import Jitter, Scene, Sonar, SpecError

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


# -------------------------------------------------------------------------------------------- scenes
# The scenes that come along: each is read, and names species and surfaces that are there.

SCENES = Path(__file__).resolve().parents[2] / "assets" / "scenes"


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_a_scene_is_whole(path):
    scene = read_settings(path, Scene)
    assert scene.sensors or scene.plantings
    for planting in scene.plantings:
        assert find_species(planting.species, SCENES).is_file()
    for sonar in scene.sensors:
        if isinstance(sonar, Sonar):
            equip(sonar, SCENES)
            assert not sonar.route or read_route(find(sonar.route, SCENES, "route"), sonar.speed)


@pytest.mark.parametrize(
    ("name", "count"), [("100k", 100_000), ("200k", 200_000), ("500k", 500_000)]
)
def test_the_papers_parameters(name, count):
    scene = read_settings(SCENES / f"paper-{name}.toml", Scene)
    (stems,), (reverb,) = scene.stems, scene.sensors
    assert (stems.count, stems.radius.mean, stems.radius.sd) == (count, 0.25, 0)
    assert scene.forest.size == (1000, 1000)
    assert (reverb.ground, reverb.strength, reverb.spreading) == (0.8, 2.0, 0.7)
    assert (reverb.sample_rate, scene.air.speed()) == (24_000, 343)


# ----------------------------------------------------------------------------------------- templates
# The templates that ship: made by their script, and good to grow trees from.

TEMPLATES_ASSETS = Path(__file__).resolve().parents[2] / "assets"
TEMPLATES = TEMPLATES_ASSETS / "templates"


class Shipped(NamedTuple):
    """Facets (T, 3, 3) of a template, and what it is cut into."""

    name: str
    wood: np.ndarray
    leaves: np.ndarray
    tree: TreeTemplate


# first-level branches, leaves on a branch, length of a leaf in metres: each from, to
TEMPLATES_EXPECTED = {
    "maple": (5, (190, 280), (0.10, 0.14)),
    "hazelnut": (6, (150, 200), (0.08, 0.10)),
    "apple": (6, (190, 290), (0.06, 0.08)),
    "spruce": (6, (560, 700), (0.06, 0.09)),
}


@pytest.fixture(scope="module", params=TEMPLATES_EXPECTED)
def shipped(request: pytest.FixtureRequest) -> Shipped:
    wood, leaves = (
        read_stl(TEMPLATES / request.param / f"{part}.stl") for part in ("wood", "leaves")
    )
    return Shipped(request.param, wood, leaves, split_tree(wood, leaves))


@pytest.mark.slow
def test_the_script_makes_the_committed_files(tmp_path: Path) -> None:
    script = TEMPLATES_ASSETS / "make_templates.py"
    subprocess.run([sys.executable, str(script), "--out", str(tmp_path)], check=True)
    made = {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.rglob("*.stl")}
    kept = {path.relative_to(TEMPLATES): path.read_bytes() for path in TEMPLATES.rglob("*.stl")}
    assert made.keys() == kept.keys()
    assert [path for path in kept if made[path] != kept[path]] == []
    assert sum(map(len, kept.values())) < 6e6


@pytest.mark.medium
def test_facets_are_whole_and_turned_outwards_and_to_the_sky(shipped: Shipped) -> None:
    for part, corners in (("wood", shipped.wood), ("leaves", shipped.leaves)):
        assert np.isfinite(corners).all()
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(normal, axis=1)
        assert doubled.min() > 1e-9  # m²; read_stl drops facets that are not finite, so count them
        size = (TEMPLATES / shipped.name / f"{part}.stl").stat().st_size
        assert len(corners) == (size - 84) // 50
    upward = normal[:, 2] / doubled  # of leaves
    assert np.median(upward) > 0.6
    assert np.mean(upward > 0) > 0.95
    a, b, c = shipped.wood.transpose(1, 0, 2)
    assert np.einsum("ti,ti->t", a, np.cross(b, c)).sum() > 0  # six times the volume
    assert len(shipped.wood) + len(shipped.leaves) <= 24_000


@pytest.mark.medium
def test_leaves_touch_neither_each_other_nor_the_wood(shipped: Shipped) -> None:
    wood, leaves = (
        np.unique(part.reshape(-1, 3), axis=0) for part in (shipped.wood, shipped.leaves)
    )
    together = np.unique(np.concatenate([leaves, wood]), axis=0)
    assert len(together) == len(leaves) + len(wood)
    count = sum(len(branch.leaves) for branch in shipped.tree.branches)
    a_leaf = shipped.leaves[: len(shipped.leaves) // count]
    assert len(leaves) == len(np.unique(a_leaf.reshape(-1, 3), axis=0)) * count


@pytest.mark.medium
def test_a_tree_is_cut_into_branches_with_all_leaves(shipped: Shipped) -> None:
    tree, (branches, (fewest, most), (shortest, longest)) = (
        shipped.tree,
        TEMPLATES_EXPECTED[shipped.name],
    )
    assert len(tree.branches) == branches
    for branch in tree.branches:
        assert fewest <= len(branch.leaves) <= most
        assert branch.leaves.branch.max() > 0  # there are twigs
        along = branch.leaves.centre[:, 0]  # the branch runs from 0 to 1 along x
        assert along.max() > 0.95
        assert np.mean(along > 0.4) > 0.6
        assert 0.005 < branch.base_radius / branch.length < 0.02  # stout enough to be scaled
        assert np.count_nonzero(branch.mesh.part == WOOD) > 500
    leaves = Leaves.joined([branch.leaves for branch in tree.branches])
    metres = np.repeat([b.length for b in tree.branches], [len(b.leaves) for b in tree.branches])
    assert shortest <= (leaves.length * metres).min()
    assert (leaves.length * metres).max() <= longest
    assert (leaves.radius * metres).min() > 0.01
    corners = shipped.wood.reshape(-1, 3)
    assert np.abs(corners[corners[:, 2] < 1e-4].mean(axis=0)).max() < 0.01  # stands at the origin
