"""Outlines of sensors, drawn over the 3D view as lines: beams to -3 dB, fans, paths of sound."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...blender.sensors.objects import kind_of, sensors_of
from ...sensing.kinds import KINDS, outline
from ...spec import SpecError
from ..settings import exchange
from ..shell.chosen import chosen_sensor

WIDTH, CHOSEN = 1.5, 2.5  # pixels, of the chosen sensor's lines
FAINT = 0.3  # share of the strength of a line that the other sensors' have

log = logging.getLogger(__name__)

_drawn_for: int | None = None  # the scene that the batches are of; None: make them anew
_batches: list[tuple[Any, tuple[float, ...], str]] = []


def forget(_depsgraph: bpy.types.Depsgraph | None = None) -> None:
    """Something changed: make the lines anew before the next drawing."""
    global _drawn_for
    _drawn_for = None


def draw(context: bpy.types.Context) -> None:
    """Draw the lines of the scene's sensors, where that is asked for."""
    global _drawn_for
    if not context.scene.forest_sensing.show_sensors:
        return
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    if _drawn_for != context.scene.session_uid:
        _drawn_for = context.scene.session_uid
        _batches.clear()
        for thing, ends in lines(context.scene):
            batch = batch_for_shader(shader, "LINES", {"pos": ends})
            _batches.append((batch, KINDS[kind_of(thing)].colour, thing.name))
    thing = chosen_sensor(context)
    name = "" if thing is None else thing.name
    shader.bind()
    for batch, colour, of in sorted(_batches, key=lambda batch: batch[2] == name):
        shown, width = strength(colour, of == name)
        shader.uniform_float("color", shown)
        shader.uniform_float("lineWidth", width)
        shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
        batch.draw(shader)


def strength(colour: tuple[float, ...], chosen: bool) -> tuple[tuple[float, ...], float]:
    """Colour and width of a sensor's lines: the chosen one's are strong, the others' faint."""
    return (*colour[:3], 1.0 if chosen else FAINT * colour[3]), CHOSEN if chosen else WIDTH


def lines(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Object, np.ndarray]]:
    """Sensors and ends of their lines, (2 N, 3) float32 with N > 0, of every sensor that has any."""
    for thing in sensors_of(scene):
        try:
            ends = outline(exchange.sensor_of(thing)).reshape(-1, 3).astype(np.float32)
        except (SpecError, ValueError):
            continue  # the panel says what is wrong when it is run
        except Exception:  # a fault of ours: other sensors are drawn all the same
            log.exception("Forest Sensing cannot draw where %s looks", thing.name)
            continue
        if len(ends) and np.isfinite(ends).all():
            yield thing, ends
