"""What the view draws of a cloud: every point, in the colours that its menu gives."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.blender.scene.layout import CLOUD_KEY, COLOUR_BY
from forest_addon.blender.scene.nodes import drawn_input, has_input, set_input
from forest_addon.blender.show.cloud import COLOUR_OF_ORGAN
from forest_addon.ui.results.points import GAMMA, positions_and_colours


@pytest.fixture
def cloud(small):
    bpy.ops.forest.build()
    bpy.ops.forest.run(sensor="cloud")
    return next(thing for thing in bpy.data.objects if CLOUD_KEY in thing)


def drawn(cloud):
    return positions_and_colours(cloud.evaluated_get(bpy.context.evaluated_depsgraph_get()))


def test_every_point_has_the_colour_of_its_organ(cloud):
    position, colour = drawn(cloud)
    given = np.empty(3 * len(cloud.data.vertices), np.float32)
    cloud.data.attributes["position"].data.foreach_get("vector", given)
    np.testing.assert_array_equal(position, given.reshape(-1, 3))
    organ = np.empty(len(position), np.int32)
    cloud.data.attributes["organ"].data.foreach_get("value", organ)
    for code in (LEAF, WOOD):
        expected = np.array(COLOUR_OF_ORGAN[code][:3]) ** GAMMA
        assert (organ == code).any()
        np.testing.assert_allclose(colour[organ == code, :3], np.tile(
            expected, (np.count_nonzero(organ == code), 1)), atol=1e-5)  # fmt: skip


def test_the_menu_changes_the_colours(cloud):
    (modifier,) = cloud.modifiers
    assert has_input(modifier, COLOUR_BY)
    by_organ = drawn(cloud)[1]
    holder, name = drawn_input(modifier, COLOUR_BY)
    if not name.startswith("["):
        choices = [item.identifier for item in holder.bl_rna.properties[name].enum_items]
        assert len(choices) > 5
        set_input(modifier, COLOUR_BY, choices[-1])
    else:
        set_input(modifier, COLOUR_BY, modifier[name[2:-2]] + 1)
    assert np.abs(drawn(cloud)[1] - by_organ).max() > 0.1


def test_points_without_their_modifier_are_not_drawn(cloud):
    cloud.modifiers.clear()
    position, colour = drawn(cloud)
    assert (len(position), len(colour)) == (0, 0)
