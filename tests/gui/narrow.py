"""The sidebar at 180 pixels: every panel is drawn so narrow, page by page, to be looked at."""

from drive import (
    HOVER,
    Scenario,
    Steps,
    demo_forest,
    open_every_panel,
    point_at,
    press,
    scroll,
    settle,
    view,
    xdotool,
)

WIDE = 180  # pixels
PAGES = 20  # of the sidebar, one above the other, at most


def drag_edge(width: int) -> Scenario:
    """Drag the sidebar's edge until it is so wide."""
    side = view()[3]
    y, to = side.y + side.height // 3, side.x + side.width - width
    point_at(side.x + 1, y)
    yield 3 * HOVER
    xdotool("mousedown", "1")
    yield 3 * HOVER
    for x in (side.x + 5, (side.x + to) // 2, to):
        point_at(x, y)
        yield 3 * HOVER
    xdotool("mouseup", "1")
    yield from settle()


def scenario(steps: Steps) -> Scenario:
    steps.step("a forest and sensors, and every panel open")
    open_every_panel()
    yield from demo_forest()
    press("forest.add_sensor", invoke=False, kind="reverb")
    yield from drag_edge(WIDE)
    assert abs(view()[3].width - WIDE) < 5, view()[3].width
    for page in range(PAGES):
        steps.step(f"page {page}")
        yield from settle()
        side = view()[3]
        top = side.view2d.region_to_view(0, 0)
        scroll(side, 16)
        yield from settle()
        if side.view2d.region_to_view(0, 0) == top:
            break
