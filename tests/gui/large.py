"""A large forest in a window: what views show of it, and how many frames a second."""

import bpy
from drive import (
    Scenario,
    Steps,
    demo_forest,
    open_tab,
    press,
    props,
    results,
    settle,
    turn,
    view,
)


def told(what: str, seconds: float) -> None:
    print(f"FIGURE {what}: {1 / seconds:.1f} frames/s", flush=True)


def grow_many(trees: int) -> Scenario:
    """Grow about so many trees, as dense in any number, and turn the view."""
    settings = props()
    settings.forest.size = [(14.4 * trees) ** 0.5] * 2
    settings.forest.spacing = 0.5
    for planting in settings.plantings:
        planting.use_expected, planting.expected, planting.exact = True, trees / 2 + 20, True
        planting.gaussians.clear()
    press("forest.build", frame=True)
    yield from results(["forest"], 240)
    assert settings.display == "LIGHT"
    assert int(settings.results["forest"].figures["Trees"].value.replace(",", "")) > 0.9 * trees
    told(f"{trees:,} trees as stand-ins", (yield from turn(4)))


def scenario(steps: Steps) -> Scenario:
    steps.step("one click in the gallery grows a forest and keeps what is there")
    yield from open_tab("Forest")
    yield from settle()
    told("an empty scene, solid view", (yield from turn(4)))
    before = set(bpy.context.scene.objects) - {bpy.data.objects["Cube"]}
    yield from demo_forest()
    assert before <= set(bpy.context.scene.objects)

    for trees in (1001, 2000):
        steps.step(f"{trees} trees are shown by stand-ins")
        yield from grow_many(trees)

    steps.step("among them, as dots")
    view()[1].spaces.active.region_3d.view_distance = 25
    props().display = "DOTS"
    yield from settle()
    told("2,000 trees as dots", (yield from turn(4)))
