"""Progress of the running job, with the button that stops it: where jobs start, and in the status bar."""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.jobs import Job
from .views import redraw_panels
from .words import label, say

WIDE = 18  # of the bar in the status bar, in units of Blender's layouts


def how_far(job: Job) -> str:
    """Return what a job is doing, how much of it is done, and when it will be."""
    if job.over:
        return say("{job} is stopping", job=job.title)
    if job.left is None:
        return f"{job.label} {job.share:.0%}"
    left = duration(job.left)
    return say("{step} {share:.0%}, {time} left", step=job.label, share=job.share, time=left)


def duration(seconds: float) -> str:
    """A time as one says it."""
    if seconds < 1.5:
        return say("a second")
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return say("{minutes:.0f} min", minutes=seconds / 60)
    return say("{hours:.1f} h", hours=seconds / 3600)


def draw_job(row: bpy.types.UILayout, job: Job) -> None:
    """Draw how far a job is into a row, and the button that stops it."""
    row.progress(factor=job.share, text=how_far(job))
    row.operator("forest.cancel", text="", icon="CANCEL")


def show_job(context: bpy.types.Context, job: Job) -> None:
    """Have status bar and panels say how far a job is."""

    def draw(header: Any, _context: bpy.types.Context) -> None:
        row = header.layout.row(align=True)
        row.label(text=job.title)
        bar = row.row(align=True)
        bar.ui_units_x = WIDE
        draw_job(bar, job)
        row.label(text=label("Esc: cancel"))

    if context.workspace is not None:
        context.workspace.status_text_set(draw)
    redraw_panels()


def show_no_job(context: bpy.types.Context) -> None:
    """Have the status bar say what it says usually, and panels offer to start work again."""
    if context.workspace is not None:
        context.workspace.status_text_set(None)
    redraw_panels()
