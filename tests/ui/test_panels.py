"""Panels drawn onto a layout that notes what it is given: every property and operator exists.

Whether it looks well is seen in the real application only; these tests keep drawing from failing there.
"""

import dataclasses
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

import blf

from forest_addon import spec, ui
from forest_addon.blender.sensors import objects as sensors
from forest_addon.sensing.kinds import KINDS
from forest_addon.spec.base import Settings, param_of
from forest_addon.spec.choices import ADVANCED, APPLIES, GIVEN, LEFT_OUT
from forest_addon.ui import overlay, properties
from forest_addon.ui.forest import panels as forest_panels
from forest_addon.ui.results.finding import OF_TREES
from forest_addon.ui.sensors import panels as sensor_panels
from forest_addon.ui.sensors.run import MENUS, FOREST_MT_forest, draw_menu
from forest_addon.ui.settings import drawing, exchange, references
from forest_addon.ui.settings.groups import fields_of
from forest_addon.ui.shell import running
from forest_addon.ui.species import panel as species_panel
from forest_addon.ui.species.panel import SPREADS

from .pressing import next_uid


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
    for thing in sensors.sensors_of(bpy.context.scene):
        bpy.context.view_layer.objects.active = thing
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
    thing = bpy.data.objects["reverb"]
    group = thing.forest_sensor.reverb
    hidden = {"name", *KINDS["reverb"].posed, *references.HEARD_TYPES}
    for prop in group.bl_rna.properties:
        values = [item.identifier for item in prop.enum_items] if prop.type == "ENUM" else []
        for value in values or [None]:
            usual = getattr(group, prop.identifier)
            if value is not None:
                setattr(group, prop.identifier, value)
            fields = [n for n in group.shown if n not in hidden and drawing.is_shown(group, n)]
            fields += ["location", "receiver", "rotation"]
            assert len(fields) <= 10, (prop.identifier, value, fields)
            if value is not None:
                setattr(group, prop.identifier, usual)


def test_growing_and_running_are_found_by_a_search(props):
    """Blender's search looks through the menus of the view."""
    seen = []
    FOREST_MT_forest.draw(SimpleNamespace(layout=Layout(seen)), bpy.context)
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


def test_what_does_not_apply_now_is_hidden(small):
    small.advanced = True
    thing = bpy.data.objects["echo"]
    bpy.context.view_layer.objects.active = thing
    settings = thing.forest_sensor.sonar
    names = {p.identifier: p.name.partition(" (")[0] for p in settings.bl_rna.properties}

    def shown(name):
        return any(text.startswith(names[name]) for text in drawn())

    assert not shown("ear_spacing")
    settings.ears = 2
    assert shown("ear_spacing")
    assert not shown("beam_file")
    settings.beam = "file"
    assert shown("beam_file")


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
def test_results_are_shown(small):
    bpy.ops.forest.build()
    bpy.ops.forest.run()
    results = bpy.context.scene.forest_sensing.results
    assert [result.opened for result in results] == [True, *[False] * (len(results) - 1)]
    for result in results:
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
def test_a_scan_without_a_forest_is_told_nothing_of_trees(props):
    _own_scene()
    assert bpy.ops.forest.scan_here() == {"FINISHED"}
    bpy.data.objects["Tripod LiDAR"].forest_sensor.terrestrial.angle_step_deg = 6
    assert bpy.ops.forest.run(sensor="Tripod LiDAR") == {"FINISHED"}
    assert "Points" in _figures(props, "Tripod LiDAR")
    assert OF_TREES.isdisjoint(_figures(props, "Tripod LiDAR"))
    assert "Tree Density" not in drawn()


@pytest.mark.medium
@pytest.mark.parametrize(
    ("kind", "name", "told"),
    [
        ("sonar", "Bat Sonar", "Glints Heard"),
        ("reverb", "Reverb", "Direct Path"),
    ],
)
def test_what_is_heard_without_a_forest_counts_no_leaves_and_no_trunks(props, kind, name, told):
    _own_scene()
    assert bpy.ops.forest.add_sensor(kind=kind) == {"FINISHED"}
    assert bpy.ops.forest.run(sensor=name) == {"FINISHED"}
    assert told in _figures(props, name)
    assert (OF_TREES - {"Behind Wood"}).isdisjoint(_figures(props, name))  # a box hides too


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
def test_what_a_sensor_found_is_told_beside_run(built):
    """It is seen there without going down to the results, and says when it is of the forest before."""
    assert bpy.ops.forest.run(sensor="cloud") == {"FINISHED"}
    bpy.context.view_layer.objects.active = bpy.data.objects["cloud"]
    result = built.results["cloud"]
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
    for thing in sensors.sensors_of(bpy.context.scene):
        bpy.data.objects.remove(thing)
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
