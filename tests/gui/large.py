"""A large forest in a window: what views show of it, results that stay.

The button that runs sensors again is found and clicked.
"""

import bpy
from drive import (
    Scenario,
    Steps,
    click,
    demo_forest,
    find_button,
    idle,
    open_tab,
    press,
    props,
    results,
    scroll,
    settle,
    turn,
    view,
    wait_for,
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
    settings = props()
    view()[1].spaces.active.region_3d.view_distance = 25
    settings.display = "DOTS"
    yield from settle()
    told("2,000 trees as dots", (yield from turn(4)))
    settings.display = "LIGHT"

    steps.step("a scan of full trees")
    bpy.data.objects["tripod"].forest_sensor.terrestrial.angle_step_deg = 1.0
    press("forest.run", sensor="tripod", sure=True)
    yield from results(["tripod"], 240)
    assert settings.display == "LIGHT"

    steps.step("results stay when the forest is grown anew")
    settings.seed += 1
    press("forest.build")
    yield from results(["forest"], 240)
    result = settings.results["tripod"]
    assert result.stale
    assert len(bpy.data.objects[result.shown].data.vertices) > 100

    steps.step("one click runs them again")
    scroll(view()[3], 40)
    click(*(yield from find_button("forest.run(again=True", 0.9, 0.75)))
    yield from wait_for(lambda: not settings.results["tripod"].stale and idle(), 240, "the scan")
