"""The rules of the house (``house_rules``) hold, and none can be fooled by how an import is written."""

import ast
from pathlib import Path

import house_rules as rules
import pytest
from house_rules import House

ROOT = Path(__file__).resolve().parents[1]
# Places that break a rule with a reason: rule, how the violation begins, why.
EXCEPTIONS = {
    "sensors_are_looked_up": {
        "forest_addon/ui/settings/migration.py": "what old files have, by the words that they had",
    },
}


@pytest.fixture(scope="module")
def house():
    yield House.read(ROOT)
    rules.nodes_of.cache_clear()  # a million nodes, which Python's collector would look at ever again
    rules.tree_of.cache_clear()


def violations(rule, house):
    """Every place that breaks a rule without a reason."""
    allowed = EXCEPTIONS.get(rule.__name__, {})
    return sorted({v for v in rule(house) if not any(v.startswith(start) for start in allowed)})


@pytest.mark.parametrize("rule", rules.RULES, ids=lambda rule: rule.__name__)
def test_the_rule_holds(rule, house):
    found = violations(rule, house)
    assert not found, "\n".join(["", *found])


def test_exceptions_are_needed(house):
    for name, places in EXCEPTIONS.items():
        found = list(getattr(rules, name)(house))
        for start in places:
            assert any(v.startswith(start) for v in found), f"{start} breaks {name} no more"


PLANTED = {
    "Blender in a pure room, within a function": (
        rules.pure_rooms_import_no_blender,
        "forest_addon/stand/plan.py",
        "\n\ndef f():\n    import mathutils\n",
    ),
    "Blender by a literal of import_module": (
        rules.pure_rooms_import_no_blender,
        "forest_addon/growth/tree.py",
        "\n\nimport importlib\n\nimportlib.import_module('bpy')\n",
    ),
    "an arrow to the right": (
        rules.rooms_import_only_rooms_before_them,
        "forest_addon/formats/las.py",
        "\n\nfrom ..sensing.rays import boxes\n",
    ),
    "an arrow to the right by __import__": (
        rules.rooms_import_only_rooms_before_them,
        "forest_addon/acoustics/air.py",
        "\n\n__import__('forest_addon.stand.plan')\n",
    ),
    "the add-on imports headless": (
        rules.rooms_import_only_rooms_before_them,
        "forest_addon/api/world.py",
        "\n\nimport importlib\n\nimportlib.import_module('headless.record')\n",
    ),
    "a wing imports its sister": (
        rules.wings_import_only_what_they_may,
        "forest_addon/growth/mesh/meshing.py",
        "\n\nfrom ..lsystem import turtle\n",
    ),
    "a sensor reaches another through a third file": (
        rules.sensors_never_reach_each_other,
        "forest_addon/sensing/audit.py",
        "\n\nfrom .sonar import ping\n",
    ),
    "a folder that is no wing": (
        rules.folders_of_a_room_are_its_wings,
        "forest_addon/stand/utils/__init__.py",
        '"""Helpers."""\n',
    ),
    "a package of others that no room lists": (
        rules.packages_of_others_are_listed,
        "forest_addon/sensing/audit.py",
        "\n\ndef f():\n    import pandas\n",
    ),
    "the report imports a command": (
        rules.headless_has_an_order,
        "headless/report/page.py",
        "\n\nfrom ..commands import demo\n",
    ),
    "validation imports papers": (
        rules.headless_has_an_order,
        "headless/studies/validation/run.py",
        "\n\nimport importlib\n\nimportlib.import_module('..papers.orchards', __package__)\n",
    ),
    "a circle hidden in an f-string": (
        rules.no_circles,
        "headless/studies/bench/cold.py",
        "\n\ndef f(name):\n    import importlib\n\n"
        "    return importlib.import_module(f'.{name}', __package__)\n",
    ),
    "network in the add-on": (
        rules.the_addon_is_relative_and_offline,
        "forest_addon/formats/glb.py",
        "\n\nimport urllib.request\n",
    ),
    "an absolute import of ourselves": (
        rules.the_addon_is_relative_and_offline,
        "forest_addon/formats/glb.py",
        "\n\nfrom forest_addon.base import rng\n",
    ),
    "the class of a sensor is asked for": (
        rules.sensors_are_looked_up,
        "headless/pipeline.py",
        "\n\nfrom forest_addon.spec import Sonar as S\n\n\ndef f(x):\n    return isinstance(x, int | S)\n",
    ),
    "the class of a result is asked for, by a tuple": (
        rules.sensors_are_looked_up,
        "forest_addon/ui/results/finding.py",
        "\n\nKINDS = (Cloud, str)\n\n\ndef f(x):\n    return isinstance(x, KINDS)\n",
    ),
    "a result is matched by its class": (
        rules.sensors_are_looked_up,
        "headless/record.py",
        "\n\ndef f(x):\n    match x:\n        case api.Echo():\n            return 1\n",
    ),
    "the kind of a sensor is compared": (
        rules.sensors_are_looked_up,
        "headless/dataset/scene.py",
        "\n\ndef f(sensor):\n    return sensor.kind in ('sonar', 'reverb')\n",
    ),
    "a file that is too long": (
        rules.files_are_short,
        "forest_addon/stand/plan.py",
        "\n" * rules.LONGEST_FILE,
    ),
    "a public function that only tests use": (
        rules.public_names_are_used,
        "forest_addon/stand/plan.py",
        "\n\ndef plant_a_violation():\n    return 1\n",
    ),
    "a path trick": (
        rules.no_eval_no_path_tricks_no_global_random,
        "headless/pipeline.py",
        "\n\nimport sys\n\nsys.path.append('.')\n",
    ),
    "global random numbers": (
        rules.no_eval_no_path_tricks_no_global_random,
        "forest_addon/stand/plan.py",
        "\n\nx = np.random.uniform()\n",
    ),
    "an angle of columns": (
        rules.functions_of_columns_take_copies,
        "forest_addon/stand/plan.py",
        "\n\ndef f(way):\n    return np.arctan2(way[:, 1], way[..., 0])\n",
    ),
}


@pytest.mark.parametrize("planted", PLANTED)
def test_a_planted_violation_is_caught(planted, house):
    rule, path, text = PLANTED[planted]
    before = violations(rule, house)
    assert len(violations(rule, house.planted(path, text))) > len(before)


def test_a_full_folder_is_caught(house):
    for number in range(rules.LARGEST_FOLDER + 1):
        house = house.planted(f"forest_addon/base/more_{number}.py", '"""More."""\n')
    assert violations(rules.folders_are_small, house)


def test_the_shim_imports_nothing_at_load():
    tree = ast.parse((ROOT / "__init__.py").read_text(encoding="utf-8"))
    assert not [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
