"""Scene and species files of earlier releases name choices and shipped files as they did then."""

import pytest

from forest_addon.base import places
from forest_addon.base.places import ASSETS
from forest_addon.sensing.sonar.equipment_files import find
from forest_addon.spec import FORMER, Grammar, Rules
from headless.command import scene_file


@pytest.mark.parametrize(("group", "old"), [(Grammar, "T20"), (Grammar, "A20"), (Rules, "S")])
def test_a_dialect_of_an_earlier_release_is_read(group, old):
    given = {"axiom": "A"} if group is Rules else {}
    assert group(dialect=old, **given).dialect == FORMER[old]


def test_shipped_files_of_an_earlier_release_are_found(tmp_path):
    for old, now in places.FORMER.items():
        if old.endswith(".csv"):
            assert find(old, tmp_path, "route") == ASSETS / "scenes" / now
            (tmp_path / old).write_text("a user's own\n")
            assert find(old, tmp_path, "route") == tmp_path / old
        else:
            assert scene_file(old) == ASSETS / "scenes" / f"{now}.toml"
            assert scene_file(old).is_file()
