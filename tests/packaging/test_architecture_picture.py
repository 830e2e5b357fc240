"""The picture in docs/architecture.md shows the code as it is."""

import json

import pytest
from PIL import Image
from references.scripts import script

drawing = script("packaging/draw_architecture.py")


@pytest.mark.medium
def test_the_picture_is_current():
    arrows = drawing.project_arrows()
    with Image.open(drawing.PICTURE) as image:
        shown = json.loads(image.info[drawing.SHOWN])
    assert shown == drawing.shown_of(arrows), "run: make architecture"
    boxes = {box for arrow in drawing.reduced(arrows) for box in arrow}
    assert boxes <= {room for _, row in drawing.ROWS for room in row} | drawing.WINGS.keys()


def test_arrows_that_follow_are_left_out():
    arrows = [("ui", "blender"), ("blender", "spec"), ("ui", "spec"), ("ui", "sensing/lidar")]
    arrows += [("sensing/lidar", "spec"), ("blender", "sensing/lidar")]
    expected = [("blender", "sensing"), ("sensing", "spec"), ("ui", "blender")]
    assert drawing.reduced(arrows) == expected
