"""Panels drawn onto a layout that notes what it is given: every property and operator exists.

Whether it looks well is seen in the real application only; these tests keep drawing from failing there.
"""

import dataclasses
import logging
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import blf
from references.scenes import add_mesh
from ui.pressing import (
    facts,
    next_uid,
    press,
    run,
    settings_of,
)

from forest_addon import spec, ui
from forest_addon.blender.jobs import Job
from forest_addon.blender.read.inputs import read_painted
from forest_addon.blender.sensors import objects as sensors
from forest_addon.sensing.kinds import KINDS
from forest_addon.spec.base import Settings, param_of
from forest_addon.spec.choices import ADVANCED, APPLIES, GIVEN, LEFT_OUT, applies
from forest_addon.ui import overlay, properties
from forest_addon.ui.forest import hand, panels as forest_panels
from forest_addon.ui.results.finding import OF_TREES
from forest_addon.ui.sensors import panels as sensor_panels
from forest_addon.ui.sensors.panels import _sensor_data
from forest_addon.ui.sensors.run import MENUS, draw_menu, forest as run_forest
from forest_addon.ui.settings import drawing, exchange, references
from forest_addon.ui.settings.groups import fields_of
from forest_addon.ui.shell import running
from forest_addon.ui.species import edit as species_panel
from forest_addon.ui.species.edit import SPREADS


def canvas(kind, layout):
    """Stands for a panel or menu that Blender has made of a class, with what that says of itself."""
    said = {n: getattr(kind, n) for n in ("names", "which", "starts") if hasattr(kind, n)}
    return SimpleNamespace(layout=layout, **said)


class Layout:
    """Stands for Blender's: checks names, and keeps what would be shown."""

    def __init__(self, seen):
        self.seen = seen

    def _inner(self, heading="", **_):
        self.seen.append(heading)
        return Layout(self.seen)

    row = column = box = split = grid_flow = _inner

    def panel(self, name, default_closed=False):
        return Layout(self.seen), Layout(self.seen)

    def panel_prop(self, group, name):
        assert group.bl_rna.properties[name].type == "BOOLEAN"
        return Layout(self.seen), Layout(self.seen) if getattr(group, name) else None

    def prop(self, group, name, index=-1, text=None, placeholder="", icon="NONE", **style):
        assert style.keys() <= {"emboss", "toggle", "expand"}
        self._known_icon(icon)
        if name.startswith("["):
            assert group.path_resolve(name) is not None
            self.seen.append(text)
            return
        known = group.bl_rna.properties[name]
        assert index < 0 or known.is_array
        self.seen.append(known.name if text is None else text)

    def operator(self, name, text=None, icon="NONE", emboss=True, icon_value=0):
        room, _, verb = name.partition(".")
        label = getattr(getattr(bpy.ops, room), verb).get_rna_type().name
        self._known_icon(icon)
        self.seen.append(label if text is None else text)
        return SimpleNamespace()

    def menu(self, name, text="", icon="NONE"):
        self._known_icon(icon)
        kind = getattr(bpy.types, name)
        kind.draw(canvas(kind, self), bpy.context)

    def operator_menu_enum(self, name, choice, text="", icon="NONE"):
        self.operator(name, text, icon)

    def label(self, text="", icon="NONE", icon_value=0):
        self._known_icon(icon)
        self.seen.append(text)

    def template_list(self, kind, name, owner, items, active_owner, active, rows):
        assert hasattr(bpy.types, kind)
        assert active in active_owner.bl_rna.properties
        shown = next(cls for cls in ui._classes() if cls.__name__ == kind)
        for item in getattr(owner, items):
            if kind == "FOREST_UL_sensors" and not sensors.kind_of(item):
                continue
            shown.draw_item(None, None, self, owner, item, 0, active_owner, active)

    def template_icon(self, icon_value, scale):
        assert scale > 0  # icons have numbers only where there is a window

    def template_icon_view(self, group, name, show_labels, scale, scale_popup):
        assert group.bl_rna.properties[name].type == "ENUM"

    def progress(self, factor, text):
        self.seen.append(f"[{factor:.0%}] {text}")

    def popover(self, panel, text="", icon="NONE"):
        assert hasattr(bpy.types, panel)
        self._known_icon(icon)

    def separator(self):
        pass

    def _known_icon(self, icon):
        icons = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
        assert icon in icons


def drawn(context=None):
    """All texts of all panels that Blender would draw now; to draw makes nothing."""
    context = context or bpy.context
    seen, first = [], next_uid()
    for panel in (cls for cls in ui._classes() if issubclass(cls, bpy.types.Panel)):
        if panel.bl_region_type == "HEADER":  # Blender draws the files of presets
            continue
        if not hasattr(panel, "poll") or panel.poll(context):
            for part in ("draw_header_preset", "draw"):
                if hasattr(panel, part):
                    getattr(panel, part)(canvas(panel, Layout(seen)), context)
    assert next_uid() == first + 1, "drawing makes blocks, which Blender forbids"
    return seen


def test_a_newcomer_sees_two_doors_and_a_way_to_open_a_file(props):
    seen = drawn()
    assert {"Grow Forest", "Scan This Scene", "Open"} <= set(seen)
    assert {"Seed", "Air"}.isdisjoint(seen)


def test_who_scans_a_scene_of_his_own_is_asked_for_no_forest(props):
    assert bpy.ops.forest.scan_here() == {"FINISHED"}
    props.point_size, props.advanced, props.show_points = 4.0, True, True  # how it is looked at
    seen = drawn()
    assert {"Grow Forest", "Run Tripod LiDAR"} <= set(seen)
    assert {"Seed", "Plantings"}.isdisjoint(seen)


def test_every_setting_has_its_place(small, sensor):
    small.advanced = True
    small.plantings[0].gaussians.add()
    small.plantings[0].rasters.add()
    small.forest.distances.add()
    small.stems.add()
    bpy.ops.forest.edit_species()
    sensor("mobile", poses=(spec.Pose(),))
    sensor("airborne")
    seen = []
    for obj in sensors.sensors_of(bpy.context.scene):
        bpy.context.view_layer.objects.active = obj
        seen += drawn()
    posed = {name for names in KINDS.values() for name in names.posed} | {"name"}
    in_a_line = set(SPREADS)  # distributions: under the label of what is drawn
    for group in properties.GROUPS.values():
        if group.__name__ in in_a_line:
            continue
        kind = group.__name__.removeprefix("FOREST_PG_")
        ruled = {name for name in group.shown if {name, f"{kind}.{name}"} & APPLIES.keys()}
        for name in set(group.shown) - posed - ruled:
            prop = {p.identifier: p for p in group.bl_rna.properties}[name]
            label = prop.name.partition(" (")[0]
            assert any(text.startswith(label) for text in seen), f"{group.__name__}.{name}"


def test_basic_hides_the_papers_symbols(small):
    """Of what is drawn, not of what counts: a hidden setting keeps its value."""
    bpy.context.view_layer.objects.active = bpy.data.objects["reverb"]
    bpy.data.objects["reverb"].forest_sensor.reverb.model = "forest"  # else none of them applies
    basic = set(drawn())
    small.advanced = True
    more = set(drawn())
    assert basic < more
    assert any(text.startswith("Turbul") for text in more - basic)
    assert exchange.sensor_of(bpy.data.objects["reverb"]).strength == spec.Reverb().strength


def test_a_reverb_is_not_a_wall_of_fields(small):
    """At most ten without *Advanced*, with where it stands, whatever is chosen in one of them."""
    obj = bpy.data.objects["reverb"]
    group = obj.forest_sensor.reverb
    hidden = {"name", *KINDS["reverb"].posed, *references.HEARD_TYPES}
    for prop in group.bl_rna.properties:
        values = [item.identifier for item in prop.enum_items] if prop.type == "ENUM" else []
        for value in values or [None]:
            usual = getattr(group, prop.identifier)
            if value is not None:
                setattr(group, prop.identifier, value)
            shown = [n for n in drawing._by_depth(type(group))[1] if applies(group, n)]
            fields = [n for n in shown if n not in hidden]
            fields += ["location", "receiver", "rotation"]
            assert len(fields) <= 10, (prop.identifier, value, fields)
            if value is not None:
                setattr(group, prop.identifier, usual)


def test_growing_and_running_are_found_by_a_search(props):
    """Blender's search looks through the menus of the view."""
    seen = []
    run_forest.draw(SimpleNamespace(layout=Layout(seen)), bpy.context)
    assert {"Grow Forest", "Run Sensor", "Run Frame Range"} <= set(seen)
    assert any(menu == "VIEW3D_MT_object" and draw is draw_menu for menu, draw in MENUS)


def test_every_rule_names_settings_that_there_are(props):
    fields = {
        kind: {field.name: field.param for field in fields_of(kind)} for kind in properties.GROUPS
    }
    lower = {kind.__name__.lower(): names for kind, names in fields.items()}
    for settings, names in ADVANCED.items():
        assert names <= lower[settings].keys()
    every = {
        kind: {f.name: param_of(f) for f in dataclasses.fields(kind)} for kind in kinds(Settings)
    }
    for place, (other, values) in APPLIES.items():
        settings, _, name = place.rpartition(".")
        holders = [
            kind
            for kind, names in every.items()
            if name in names
            and (other in names or hasattr(kind, other))
            and settings in ("", kind.__name__.lower())
        ]
        assert holders, name
        for kind in holders:
            known = every[kind].get(other)
            fixed = known and [value for value in values if value not in (GIVEN, LEFT_OUT)]
            assert not fixed or not known.choices or set(fixed) <= set(known.choices)


def kinds(of):
    """All classes of settings that there are."""
    return [one for kind in of.__subclasses__() for one in (kind, *kinds(kind))]


@pytest.mark.parametrize(
    ("name", "other", "value"), [("ear_spacing", "ears", 2), ("beam_file", "beam", "file")]
)
def test_what_does_not_apply_now_is_hidden(small, name, other, value):
    small.advanced = True
    bpy.context.view_layer.objects.active = bpy.data.objects["echo"]
    settings = settings_of("echo")
    label = settings.bl_rna.properties[name].name.partition(" (")[0]
    assert not any(text.startswith(label) for text in drawn())
    setattr(settings, other, value)
    assert any(text.startswith(label) for text in drawn())


def test_labels_fit_beside_their_values(small):
    """At Blender's standard width of the sidebar; measured on photographs of it."""
    small.plantings[0].gaussians.add()
    small.plantings[0].rasters.add()
    small.forest.distances.add()
    small.stems.add()
    assert [text for text in drawn() if len(text) > 28] == []
    for group in properties.GROUPS.values():
        for name in group.shown:
            label = {p.identifier: p for p in group.bl_rna.properties}[name].name
            assert len(label) <= 15, f"{group.__name__}.{name}: {label}"


@pytest.mark.slow
def test_results_are_shown(ran):
    assert [result.opened for result in ran.results] == [True, False, False, False, False]
    for result in ran.results:
        result.opened = True
    seen = drawn()
    assert {"Trees", "Points", "Leaves Heard", "Trunks Heard"} <= set(seen)
    assert seen.count("Time") == 5
    assert any(text.endswith(" ms, 80 dB") for text in seen)


def test_an_empty_list_says_so(small):
    small.plantings.clear()
    assert any("No trees" in text for text in drawn())


def test_what_is_missing_is_said_with_what_to_do(props, monkeypatch):
    monkeypatch.setattr(running, "missing", lambda: ("scipy",))
    seen = drawn()
    assert "scipy is missing in this Blender" in seen
    assert any("Install from Disk" in text for text in seen)


def test_the_tab_is_three_blocks(registered):
    """Every other panel of the sidebar is within one of them."""
    every = [cls for cls in ui._classes() if issubclass(cls, bpy.types.Panel)]
    tab = [cls for cls in every if cls.bl_space_type == "VIEW_3D"]
    tops = sorted((c for c in tab if not hasattr(c, "bl_parent_id")), key=lambda c: c.bl_order)
    assert [cls.bl_label for cls in tops] == ["Species and Forest", "Sensors", "Results"]
    titles = [cls.bl_label for cls in tab]
    assert len(titles) == len(set(titles))  # no name means two things


def test_no_list_is_drawn_twice(small, monkeypatch):
    """Nor does one name mean two things: a scan has an intensity, a forest a density."""
    lists = []

    def noted(self, kind, name, owner, items, *_, **__):
        lists.append((kind, items))

    monkeypatch.setattr(Layout, "template_list", noted)
    small.plantings.add().species = "maple"
    seen = drawn()
    assert ("FOREST_UL_plantings", "plantings") in lists
    assert len(lists) == len(set(lists))
    assert "Intensity" not in seen


def _own_scene():
    """A ground and a box of one's own; nothing of it was grown."""
    bpy.ops.mesh.primitive_plane_add(size=20)
    bpy.ops.mesh.primitive_cube_add(size=2, location=(4, 0, 1))
    bpy.context.scene.cursor.location = (0, 0, 0)


def _figures(props, name):
    return {figure.name for figure in props.results[name].figures}


@pytest.mark.medium
@pytest.mark.parametrize(
    ("kind", "name", "told", "too"),
    [
        ("terrestrial", "Tripod LiDAR", "Points", set()),
        ("sonar", "Bat Sonar", "Glints Heard", {"Behind Wood"}),  # a box hides too
        ("reverb", "Reverb", "Direct Path", {"Behind Wood"}),
    ],
)
def test_what_is_found_without_a_forest_tells_nothing_of_trees(props, kind, name, told, too):
    _own_scene()
    assert bpy.ops.forest.add_sensor(kind=kind) == {"FINISHED"}
    bpy.data.objects[name].forest_sensor.terrestrial.angle_step_deg = 6  # quick, where it counts
    assert bpy.ops.forest.run(sensor=name) == {"FINISHED"}
    assert told in _figures(props, name)
    assert (OF_TREES - too).isdisjoint(_figures(props, name))
    assert "Tree Density" not in drawn()


@pytest.mark.slow
def test_a_tree_of_ones_own_is_seen_without_a_forest(props):
    """Added as a mesh, it has wood and leaves: what was met is told."""
    _own_scene()
    assert bpy.ops.forest.add_tree() == {"FINISHED"}
    bpy.context.scene.cursor.location = (6, 6, 0)
    assert bpy.ops.forest.scan_here() == {"FINISHED"}
    bpy.data.objects["Tripod LiDAR"].forest_sensor.terrestrial.angle_step_deg = 1
    assert bpy.ops.forest.run(sensor="Tripod LiDAR") == {"FINISHED"}
    assert {"Wood", "Leaves"} <= _figures(props, "Tripod LiDAR")


@pytest.mark.medium
def test_what_a_sensor_found_is_told_beside_run(ran):
    """It is seen there without going down to the results, and says when it is of the forest before."""
    bpy.context.view_layer.objects.active = bpy.data.objects["cloud"]
    result = ran.results["cloud"]
    told = f"{result.figures['Points'].value} points"
    seen = drawn()
    assert seen.index("Run cloud") < seen.index(told) < seen.index("cloud", seen.index(told))
    result.stale = True
    assert f"{told} (before)" in drawn()
    bpy.context.view_layer.objects.active = bpy.data.objects["echo"]
    assert told not in drawn()  # it is another sensor's
    bpy.context.view_layer.objects.active = bpy.data.objects["cloud"]
    result.summary.value = result.summary.made_of = ""  # as in a file of an earlier version
    assert "cloud (before)" in drawn()


def test_a_list_that_has_lost_its_sensors_says_that_one_can_be_added(small):
    """The collection stays where sensors were deleted, with what belonged to them."""
    assert "No sensor yet: add one" not in drawn()
    for obj in sensors.sensors_of(bpy.context.scene):
        bpy.data.objects.remove(obj)
    assert "No sensor yet: add one" in drawn()


def test_narrow_panels_name_all_that_wide_ones_name(built, monkeypatch):
    built.advanced = True
    wide = set(drawn())
    for room in (drawing, forest_panels, sensor_panels, species_panel, overlay):
        monkeypatch.setattr(room, "is_narrow", lambda: True)
    left = " ".join(map(str, drawn()))
    assert {name for name in wide if str(name).partition(" ")[0] not in left} == set()


def test_names_of_settings_fit_within_180_pixels(registered):
    """Blender cuts the middle out of what does not: 180 less tabs, edges, frames and a number of 30."""
    blf.size(0, 11)  # as interfaces have it
    groups = [cls for cls in ui._classes() if hasattr(cls, "shown")]
    names = {drawing._way(cls, name)[2] for cls in groups for name in cls.shown}
    assert len(names) > 200
    assert [name for name in names if blf.dimensions(0, name)[0] > 95] == []


# --------------------------------------------------------------------------------------------- lists
# Lists of the panel: their buttons add and remove.


def test_plantings_and_hills_are_added_and_removed(props):
    for name in ("add_planting", "add_gaussian", "add_gaussian"):
        assert press(name) == {"FINISHED"}
    planting = exchange.to_spec(bpy.context.scene).plantings[0]
    assert planting.species == "maple"
    assert planting.gaussians[0].centre == (15.0, 15.0)
    assert press("remove_gaussian") == {"FINISHED"}
    assert len(props.plantings[0].gaussians) == 1
    assert press("remove_planting") == {"FINISHED"}
    assert len(props.plantings) == 0
    assert not bpy.ops.forest.remove_planting.poll()
    assert not bpy.ops.forest.add_gaussian.poll()


def test_whoever_changes_a_list_has_panels_drawn_anew(props, monkeypatch):
    """Buttons that are drawn point to where items were: a mouse over one would end Blender."""
    drawn = []
    for room in (running, exchange, hand):
        monkeypatch.setattr(room, "redraw_panels", lambda: drawn.append(1))
    for change in (
        lambda: press("add_planting"),
        lambda: hand.add_tree(props.plantings[0], (1.0, 2.0), 0.0, 1.0, 0),
        lambda: hand.remove_tree(props.plantings[0], (1.0, 2.0)),
        lambda: exchange.fill(props, "plantings", ()),
    ):
        drawn.clear()
        change()
        assert drawn


@pytest.mark.slow
def test_a_scanner_travels_along_poses(built, sensor):
    bpy.context.view_layer.objects.active = sensor("mobile")
    track = bpy.data.objects["track"].forest_sensor.mobile
    for x in (-2.0, 4.0):
        assert press("add_pose") == {"FINISHED"}
        track.poses[-1].position = (x, 3, 2)
    track.pulse_rate, track.line_rate = 200, 2
    track.field_deg = (-180, 180)
    assert track.poses[1].time == 10
    assert run("track") == {"FINISHED"}
    assert int(facts(built, "track")["Points"].replace(",", "")) > 500
    assert press("remove_pose") == {"FINISHED"}
    assert len(track.poses) == 1


@pytest.mark.slow
def test_a_reverb_has_further_ends(built):
    bpy.context.view_layer.objects.active = bpy.data.objects["reverb"]
    for end in ("source", "receiver", "receiver"):
        assert press(f"add_{end}") == {"FINISHED"}
    settings = settings_of("reverb")
    assert tuple(settings.sources[0].position) == (3, 3, 1.5)
    settings.receivers[0].position = (5, 1, 1)
    assert run("reverb") == {"FINISHED"}
    found = exchange.sensor_of(bpy.data.objects["reverb"])
    assert [tuple(place.position) for place in found.receivers] == [(5, 1, 1), (3, 3, 1.5)]
    assert press("remove_receiver") == {"FINISHED"}
    assert len(settings.receivers) == 1


@pytest.mark.medium
def test_a_planting_shows_what_stands(built):
    (planting,) = built.plantings
    standing = len([obj for obj in bpy.data.objects if "forest_tree" in obj])
    assert planting.standing == standing
    meant = round(planting.expected)
    ways = (f"{standing} trees", f"{standing} of {meant} trees", "1 tree")
    assert forest_panels._planting_row(planting)[2] in ways
    fresh = built.plantings.add()
    fresh.species, fresh.use_expected, fresh.expected = "maple", True, 7
    assert forest_panels._planting_row(fresh)[2] == "7 trees"


# -------------------------------------------------------------------------------------------- offers
# Fields that name something offer what there is, and files are named as scene files name them.

FREE = {"name", "crs", "source", "axiom", "engine"}  # texts that name nothing there is


def offered(group, name, typed=""):
    return references.SEARCHES[name](group, bpy.context, typed)


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
    obj = add_mesh("meadow", [(0, 0, 0), (1, 0, 0), (1, 1, 0)], (0, 1, 2))
    obj.vertex_groups.new(name="weights")
    obj.data.attributes.new("share", "FLOAT", "FACE")
    obj.data.attributes.new("flow", "FLOAT_VECTOR", "POINT")
    obj.data.color_attributes.new("tint", "FLOAT_COLOR", "POINT")
    assert references.layers_of(obj) == ["weights", "tint", "share"]
    bpy.context.view_layer.update()
    for layer in references.layers_of(obj):
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
    assert (tuple(raster.size), tuple(raster.origin)) == ((8, 5), (1, 2))


# ------------------------------------------------------------------------------------------ progress
# Bars of a running job wherever it can be stopped, and views that are drawn once while work goes on.


@pytest.fixture
def job(monkeypatch):
    """A job that runs, half done."""
    job = Job("Run Sensor", (None for _ in ()))
    job.label, job.share = "cloud", 0.5
    monkeypatch.setattr(running, "_current", job)
    return job


def test_run_row_grow_row_properties_and_status_bar_show_the_job(built, job):
    seen = drawn()
    assert seen.count("[50%] cloud 50%") == 2
    assert "All" not in seen
    obj = bpy.data.objects["cloud"]
    place = SimpleNamespace(object=obj, scene=bpy.context.scene)
    seen = []
    _sensor_data.draw(SimpleNamespace(layout=Layout(seen)), place)
    assert "[50%] cloud 50%" in seen
    shown = []
    workspace = SimpleNamespace(status_text_set=shown.append)
    running.show_job(SimpleNamespace(workspace=workspace), job)
    seen = []
    shown[0](SimpleNamespace(layout=Layout(seen)), bpy.context)
    assert [text for text in seen if text] == ["Run Sensor", "[50%] cloud 50%", "Esc: cancel"]
    job.over = True
    assert running.how_far(job) == "Run Sensor is stopping"


# ------------------------------------------------------------------------------------------- overlay
# Drawings over the view: one that breaks takes no other along, and is tried again when something changes.


class Sheet:
    """A drawing that counts how often it was drawn; a broken one fails."""

    def __init__(self, broken=False):
        self.broken, self.drawn = broken, 0

    def draw(self, _context):
        if self.broken:
            raise ValueError("no vertices")
        self.drawn += 1


def test_a_broken_drawing_takes_no_other_along(registered, caplog):
    sheets = [Sheet(), Sheet(broken=True), Sheet()]
    drawings = [sheet.draw for sheet in sheets]
    for _ in range(3):
        overlay.draw(drawings, bpy.context)
    assert [sheet.drawn for sheet in sheets] == [3, 0, 3]
    assert len(caplog.records) == 1  # not at every redraw
    sheets[1].broken = False
    overlay.forget()
    overlay.draw(drawings, bpy.context)
    assert [sheet.drawn for sheet in sheets] == [4, 1, 4]


def test_a_scanner_that_follows_a_curve_has_no_lines_and_others_keep_theirs(props, sensor):
    sensor("mobile", follow="track")
    sensor("mobile", name="one", poses=(spec.Pose(),))
    sensor("sonar")
    sensor("terrestrial")
    bpy.context.view_layer.update()
    found = list(overlay.lines(bpy.context.scene))
    assert [sensors.kind_of(obj) for obj, _ in found] == ["terrestrial", "sonar"]
    assert all(len(ends) for _, ends in found)


def test_a_sensor_whose_lines_cannot_be_made_takes_no_other_along(
    props, sensor, monkeypatch, caplog
):
    def broken(_sonar):
        raise ZeroDivisionError

    monkeypatch.setitem(KINDS, "sonar", replace(KINDS["sonar"], outline=broken))
    for kind in spec.SENSORS:
        sensor(kind)
    bpy.context.view_layer.update()
    with caplog.at_level(logging.ERROR):
        found = {sensors.kind_of(obj) for obj, _ in overlay.lines(bpy.context.scene)}
    assert found == set(spec.SENSORS) - {"sonar", "mobile"}  # which has no poses yet
    assert "where echo looks" in caplog.text


@pytest.mark.medium
@pytest.mark.parametrize("kind", spec.SENSORS)
@pytest.mark.parametrize("place", [(0, 0, 0), (1e6, -1e6, 1e-6), (0, 0, 1e4), (0, 0, -5)])
def test_lines_are_finite_wherever_a_sensor_is_put(props, sensor, kind, place):
    obj = sensor(kind)
    obj.location = place
    bpy.context.view_layer.update()
    for _, ends in overlay.lines(bpy.context.scene):
        assert np.isfinite(ends).all()
        assert len(ends) > 0


def test_the_chosen_sensor_is_drawn_strong_and_others_faint():
    for colour in (kind.colour for kind in KINDS.values()):
        (*_, strong), wide = overlay.strength(colour, True)
        (*_, faint), narrow = overlay.strength(colour, False)
        assert strong > 2 * faint
        assert wide > narrow
