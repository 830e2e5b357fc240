"""The contact sheet: a tile shows the slice with most trees, of as many clouds as it takes."""

import numpy as np
from matplotlib.figure import Figure

from headless.dataset.card import SLICE, _draw_clouds

SCENE = "[forest]\nsize = [40.0, 40.0]\n"
TREES = "tree,y_m\n0,3.0\n1,30.0\n2,31.0\n3,29.0\n"


def test_a_tile_shows_where_trees_stand_by_all_clouds_it_needs(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "trees.csv").write_text(TREES)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-20.0, 60.0), np.arange(40.0)))
    for name, height in (("tls", 1.0), ("uav", 9.0)):
        organ = np.full(len(x), 2, np.int8)
        np.savez(tmp_path / f"{name}-points.npz", x=x, y=y, z=np.full(len(x), height), organ=organ)
    axes = Figure().add_subplot()
    _draw_clouds(axes, tmp_path, {"tls": len(x), "uav": len(x)})
    (drawn,) = axes.collections
    places = np.asarray(drawn.get_offsets())
    assert set(places[:, 1].tolist()) == {1.0, 9.0}
    assert places[:, 0].min() > -4
    assert places[:, 0].max() < 44
    wanted = ((np.abs(y - 30.0) < SLICE / 2) & (x > -3) & (x < 43)).sum()
    assert len(places) == 2 * wanted
