"""A plain turtle of ABOP: a stack of frames, one symbol after the other, rotation matrices."""

import re

import numpy as np

from .turtle_plain import rotation

MODULE = re.compile(r"(.)(?:\(([^()]*)\))?")


def walk_plainly(text, length, angle, thinning, diameter, tropism=(0, 0, -1), elasticity=0.0):
    """Segments and leaves of a string whose numbers are written out.

    Returns a list of segments (start, end, diameter, parent, order, generation) and a list of leaves
    (foot, heading, up, segment).
    """
    tropism = np.array(tropism, float)
    place = np.zeros(3)
    frame = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])  # columns left, up, heading
    state = (place, frame, diameter, -1, None)  # last segment, and the branch that drew it
    branch, branches, stack = 0, 0, []
    segments, leaves = [], []
    for symbol, given in MODULE.findall(text):
        place, frame, width, last, last_branch = state
        number = float(given) if given else None
        turn = angle if number is None else number
        axes = {"+": (1, 1), "-": (1, -1), "&": (0, 1), "^": (0, -1), "\\": (2, 1), "/": (2, -1)}
        if symbol in "Ff":
            reach = length if number is None else number
            end = place + reach * frame[:, 2]
            if symbol == "F":
                order = generation = 0
                if last >= 0:
                    order = segments[last][4] + (branch != last_branch)
                    generation = segments[last][5] + 1
                segments.append((place, end, width, last, order, generation))
                last, last_branch = len(segments) - 1, branch
                torque = np.cross(frame[:, 2], tropism)
                size = np.linalg.norm(torque)
                if elasticity and reach and size > 1e-12:
                    frame = rotation(torque / size, elasticity * size) @ frame
            place = end
        elif symbol in axes:
            axis, sign = axes[symbol]
            frame = rotation(frame[:, axis], np.deg2rad(sign * turn)) @ frame
        elif symbol == "|":
            frame = rotation(frame[:, 1], np.pi) @ frame
        elif symbol == "$":
            level = np.cross([0, 0, 1.0], frame[:, 2])
            if np.linalg.norm(level) > 1e-9:
                level /= np.linalg.norm(level)
                frame = np.stack([level, np.cross(frame[:, 2], level), frame[:, 2]], axis=1)
        elif symbol == "!":
            width = width * thinning if number is None else number
        elif symbol == "~":
            leaves.append((place, frame[:, 2], frame[:, 1], last))
        elif symbol == "[":
            stack.append((state, branch))
            branches += 1
            branch = branches
            continue
        elif symbol == "]":
            state, branch = stack.pop()
            continue
        state = (place, frame, width, last, last_branch)
    return segments, leaves
