"""What the view draws of a cloud: every point, in the colours that its menu gives."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.blender.scene.layout import CLOUD_KEY, COLOUR_BY, FAR_POINTS, RADIUS
from forest_addon.blender.scene.nodes import drawn_inputs, has_input, set_input
from forest_addon.blender.show.cloud import COLOUR_OF_ORGAN
from forest_addon.blender.show.cloud_nodes import QUIET, SIZES
from forest_addon.ui.overlay import GAMMA, seen_points


@pytest.fixture
def cloud(small):
    bpy.ops.forest.build()
    bpy.ops.forest.run(sensor="cloud")
    return next(thing for thing in bpy.data.objects if CLOUD_KEY in thing)


def drawn(cloud):
    return seen_points(cloud.evaluated_get(bpy.context.evaluated_depsgraph_get()))[:2]


@pytest.mark.medium
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


@pytest.mark.medium
def test_the_menu_changes_the_colours(cloud):
    (modifier,) = cloud.modifiers
    assert has_input(modifier, COLOUR_BY)
    by_organ = drawn(cloud)[1]
    holder, name = drawn_inputs(modifier)[COLOUR_BY]
    if not name.startswith("["):
        choices = [item.identifier for item in holder.bl_rna.properties[name].enum_items]
        assert len(choices) > 5
        set_input(modifier, COLOUR_BY, choices[-1])
    else:
        set_input(modifier, COLOUR_BY, modifier[name[2:-2]] + 1)
    assert np.abs(drawn(cloud)[1] - by_organ).max() > 0.1


@pytest.mark.medium
def test_points_without_their_modifier_are_not_drawn(cloud):
    cloud.modifiers.clear()
    position, colour = drawn(cloud)
    assert (len(position), len(colour)) == (0, 0)


@pytest.mark.slow
def test_loud_points_are_larger_and_those_of_a_scan_alike(cloud):
    bpy.ops.forest.run(sensor="echo")
    echo = next(t for t in bpy.data.objects if t.get(CLOUD_KEY) == "echo")
    set_input(echo.modifiers[0], RADIUS, 0.04)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    level = np.empty(len(echo.data.vertices), np.float32)
    echo.data.attributes["level"].data.foreach_get("value", level)
    expected = np.interp(level, (QUIET, 0.0), SIZES)
    np.testing.assert_allclose(seen_points(echo.evaluated_get(depsgraph))[2], expected, rtol=1e-4)
    assert np.ptp(expected) > 0.5
    bpy.ops.forest.run(sensor="cloud")
    depsgraph.update()
    np.testing.assert_allclose(seen_points(cloud.evaluated_get(depsgraph))[2], 1.0)


@pytest.mark.medium
def test_points_beyond_the_ground_that_views_show_are_counted_and_left_out(small):
    small.forest.margin = 400.0  # a horizon, of which views show 1.5 m around the field
    bpy.ops.forest.build()
    bpy.ops.forest.run(sensor="cloud")
    cloud = next(thing for thing in bpy.data.objects if CLOUD_KEY in thing)
    every = np.empty(3 * len(cloud.data.vertices), np.float32)
    cloud.data.attributes["position"].data.foreach_get("vector", every)
    flat = every.reshape(-1, 3)[:, :2]
    near = ((flat >= -1.5) & (flat <= 7.5)).all(axis=1)
    assert 0 < np.count_nonzero(near) < len(near)
    assert len(drawn(cloud)[0]) == np.count_nonzero(near)
    told = small.results["cloud"].figures["Far Points"].value
    assert told == f"{np.count_nonzero(~near):,} not shown"
    set_input(cloud.modifiers[0], FAR_POINTS, True)
    bpy.context.view_layer.update()
    assert len(drawn(cloud)[0]) == len(near)


@pytest.mark.medium
def test_one_result_is_shown_at_a_time_unless_more_are_asked_for(cloud):
    def seen():
        return {t[CLOUD_KEY] for t in bpy.data.objects if CLOUD_KEY in t and t.visible_get()}

    assert seen() == {"cloud"}
    bpy.ops.forest.run(sensor="echo")
    assert seen() == {"echo"}
    bpy.ops.forest.show_result(result="cloud", more=True)
    assert seen() == {"cloud", "echo"}
    bpy.ops.forest.show_result(result="echo")  # it is shown: hidden
    assert seen() == {"cloud"}
    bpy.ops.forest.show_result(result="echo")
    assert seen() == {"echo"}
    with pytest.raises(RuntimeError, match="no points"):
        bpy.ops.forest.show_result(result="forest")
