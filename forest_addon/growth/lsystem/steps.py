"""Commands to steps: what only turns or widens is joined to what follows it within its branch.

A step turns by a fixed rotation of the turtle's own frame, changes the diameter to diameter·factor +
offset, and then does what the last of its commands says: draw, move, level, bear a leaf, or nothing. A
turtle has a fraction of the steps to walk that its string has symbols.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .dialect import (
    BRANCH,
    CLOSE,
    END,
    OUTLINE,
    PITCH,
    ROLL,
    THIN,
    TURN,
    WIDTH,
    Commands,
)
from .word import GrammarError

_AXIS = {PITCH: 1, TURN: 2, ROLL: 3}  # L, U and H are x, y and z of the turtle's own frame
_TURNS = np.isin(np.arange(16), (TURN, PITCH, ROLL))  # tables by kind of command
_JOINS_ON = np.isin(np.arange(16), (TURN, PITCH, ROLL, WIDTH, THIN, BRANCH))
_STARTS = np.isin(np.arange(16), (BRANCH, END, OUTLINE, CLOSE))  # never joined to what is before


@dataclass(frozen=True)
class Steps:
    """R steps in the order of the string.

    kind, number : (R,), (R, 2) of the last command of each.
    turn : (4, R) quaternion. factor, offset : (R,) of the diameter.
    opens, closes : (R,) whether a step starts with an opening bracket, or is a closing one.
    outline : (R,) number of the outermost outline that it stands in, from its opening on, or -1.
    """

    kind: np.ndarray
    number: np.ndarray
    turn: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    opens: np.ndarray
    closes: np.ndarray
    outline: np.ndarray


def join_commands(commands: Commands) -> Steps:
    """The steps of commands.

    Raises
    ------
    GrammarError : an outline closes that was not opened.
    """
    kind, number = commands.kind, commands.number
    starts = np.ones(len(kind), bool)
    starts[1:] = ~_JOINS_ON[kind[:-1]] | _STARTS[kind[1:]]
    first = np.flatnonzero(starts)
    length = np.diff(np.append(first, len(kind)))
    last = first + length - 1

    turn = np.zeros((4, len(first)))
    turn[0] = 1.0
    factor, offset = np.ones(len(first)), np.zeros(len(first))
    for rank in range(int(length.max(initial=0))):
        step = np.flatnonzero(length > rank)
        does = kind[first[step] + rank]
        turns = _TURNS[does]
        at = step[turns]
        local = _local_turns(does[turns], number[first[at] + rank, 0])
        turn[:, at] = local if rank == 0 else product(turn[:, at], local)
        for command in (WIDTH, THIN):
            at = step[does == command]
            given = number[first[at] + rank, 0]
            factor[at] = 0.0 if command == WIDTH else factor[at] * given
            offset[at] = given if command == WIDTH else offset[at] * given
    return Steps(
        kind=kind[last],
        number=number[last],
        turn=turn,
        factor=factor,
        offset=offset,
        opens=kind[first] == BRANCH,
        closes=kind[first] == END,
        outline=_outlines(kind)[last],
    )


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(4, N) Hamilton products of quaternions."""
    out = np.empty_like(a)
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    return out


def _local_turns(kind: np.ndarray, degrees: np.ndarray) -> np.ndarray:
    """(4, P) quaternions of the turns about the turtle's own axes."""
    local = np.zeros((4, len(kind)))
    half = np.deg2rad(degrees) / 2
    local[0] = np.cos(half)
    sine = np.sin(half)
    for command, axis in _AXIS.items():
        local[axis] = np.where(kind == command, sine, 0.0)
    return local


def _outlines(kind: np.ndarray) -> np.ndarray:
    """(C,) number of the outermost outline that a command stands in, from its opening on, or -1."""
    opens = kind == OUTLINE
    depth = np.cumsum(opens.astype(np.int64) - (kind == CLOSE))
    if len(depth) and depth.min() < 0:
        raise GrammarError("an outline closes that was not opened")
    outermost = opens & (depth == 1)
    return np.asarray(np.where(depth > 0, np.cumsum(outermost) - 1, -1))
