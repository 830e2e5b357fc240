"""`headless run` of a field in tiles: shares of it, joined later, are the run of one process."""

import numpy as np
import pytest

pytest.importorskip("bpy")

from headless.cli import main

FIELD = """
seed = 3

[forest]
size = [60, 60]

[forest.terrain]
file = "ground.npy"

[tiles]
size = 30
buffer = 10

[[plantings]]
species = "abop-monopodial-a"
variants = 1
expected = 20
exact = true

[[sensors]]
kind = "airborne"
name = "als"
position = [0, 30, 60]
track = 60
pulse_rate = 1000
"""


@pytest.mark.slow
def test_shares_of_which_one_lost_a_piece_are_joined_to_the_same_bytes(
    tmp_path, empty_blender, capsys
):
    field = tmp_path / "field.toml"
    field.write_text(FIELD)
    np.save(tmp_path / "ground.npy", np.full((3, 3), 2.0))

    def run(out, *more):
        assert main(["run", str(field), "--out", str(tmp_path / out), "--quiet", *more]) == 0
        return tmp_path / out

    whole = run("whole")
    parts = run("parts", "--share", "1/2")
    assert not (parts / "als.laz").exists()
    run("parts", "--share", "2/2")
    pieces = sorted((parts / "tiles").glob("*.rows"))
    assert len(pieces) > 1
    pieces[0].unlink()  # as if the process had been killed before it was there
    pieces[0].with_suffix(".json").unlink()
    run("parts", "--resume")
    names = ["als.laz", "leaf_angles.csv", "tiles.csv", "trees.csv"]
    written = sorted(file.name for file in whole.glob("[!.]*.*"))
    assert written == [*names[:2], "run.json", *names[2:]]
    for name in names:
        assert (parts / name).read_bytes() == (whole / name).read_bytes(), name
    before = (whole / "als.laz").stat().st_mtime_ns
    assert main(["run", str(field), "--out", str(whole), "--resume"]) == 0
    assert "ground.npy is an image or array without a place: heights" in str(capsys.readouterr())
    assert (whole / "als.laz").stat().st_mtime_ns == before
