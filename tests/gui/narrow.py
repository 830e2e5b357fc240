"""All panels at 180 pixels."""
import bpy
from drive import *
from drive import TAB

def narrow(width):
    _, area, main, side = view()
    y = side.y + side.height // 3
    point_at(side.x + 1, y); 
    yield HOVER * 3
    xdotool("mousedown", "1"); yield 0.3
    to = side.x + side.width - width
    for x in (side.x + 5, (side.x + to) // 2, to):
        point_at(x, y); yield 0.3
    xdotool("mouseup", "1"); yield 0.5
    yield from settle()
    print("FIGURE width", view()[3].width, flush=True)

def pages(steps, name):
    for page in range(14):
        steps.step(f"{name} {page:02d}")
        yield from settle()
        side = view()[3]
        top = side.view2d.region_to_view(0, 0)
        steps.step(f"{name} {page:02d} scrolled")
        scroll(side, 16)
        yield from settle()
        if side.view2d.region_to_view(0, 0) == top:
            break
    scroll(view()[3], -200)
    yield from settle()

def scenario(steps):
    steps.step("begin")
    open_every_panel()
    yield from demo_forest()
    import sys
    for kind in ("sonar", "terrestrial", "reverb"):
        press("forest.add_sensor", invoke=False, kind=kind)
    props().advanced = False
    print("FIGURE width before", view()[3].width, flush=True)
    yield from narrow(180)
    yield from pages(steps, "dark")
