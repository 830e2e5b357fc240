"""Fields that name something offer what there is, and files are named as scene files name them."""

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.blender.read.inputs import read_painted
from forest_addon.ui import properties
from forest_addon.ui.settings import references

FREE = {"name", "crs", "source", "axiom", "engine"}  # texts that name nothing there is


def offered(group, name, typed=""):
    return references.SEARCHES[name](group, bpy.context, typed)


def plane(name):
    data = bpy.data.meshes.new(name)
    data.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0)], [], [(0, 1, 2)])
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def texts():
    """(class, field, param) of every text of the panel that is no choice of a few."""
    for cls in properties.GROUPS:
        for field in properties.fields_of(cls):
            if field.kind is str and field.how == "value" and not field.param.choices:
                yield cls, field.name, field.param


def test_every_text_names_a_file_or_offers_something(props):
    offers = references.SEARCHES.keys() | references.REFERENCES.keys()  # a list, or a thing to pick
    assert {name for _, name, known in texts() if not known.file} - offers <= FREE
    for cls, name, param in texts():
        if param.file and name not in references.SEARCHES:
            known = {p.identifier: p for p in properties.GROUPS[cls].bl_rna.properties}
            assert known[name].subtype == "FILE_PATH", name


@pytest.mark.filterwarnings("ignore:.*blend relative")  # Blender 5 asks nobody for such a path
def test_a_file_beside_the_blend_file_becomes_a_whole_path(props, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "here.blend"))
    raster = bpy.context.scene.forest_sensing.plantings.add().rasters.add()
    raster.file = "//hill.png"
    assert raster.file == str(tmp_path / "hill.png")
    raster.file = "hill.png"  # beside the scene file, as that writes it
    assert raster.file == "hill.png"


def test_every_layer_that_is_offered_can_be_read(small):
    thing = plane("meadow")
    thing.vertex_groups.new(name="weights")
    thing.data.attributes.new("share", "FLOAT", "FACE")
    thing.data.attributes.new("flow", "FLOAT_VECTOR", "POINT")
    thing.data.color_attributes.new("tint", "FLOAT_COLOR", "POINT")
    assert references.layers_of(thing) == ["weights", "tint", "share"]
    bpy.context.view_layer.update()
    for layer in references.layers_of(thing):
        painted = read_painted(f"meadow:{layer}", bpy.context.evaluated_depsgraph_get())
        assert len(painted.weight) == 3


def test_species_are_presets_and_what_is_edited(small):
    bpy.ops.forest.edit_species()
    found = offered(small.plantings[0], "species")
    assert {"maple", "edited/hazelnut.toml"} <= set(found)
    pair = small.forest.distances.add()
    assert offered(pair, "species") == offered(pair, "other") == ["hazelnut"]


def test_an_image_starts_with_the_fields_extent(small):
    small.forest.size, small.forest.origin = (8, 5), (1, 2)
    bpy.ops.forest.add_raster()
    raster = small.plantings[0].rasters[0]
    raster.use_size = raster.use_origin = True
    raster.file = "x.png"
    found = properties.GROUPS[spec.Raster]
    assert isinstance(raster, found)
    assert (tuple(raster.size), tuple(raster.origin)) == ((8, 5), (1, 2))
