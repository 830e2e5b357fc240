"""Plain turtles: of Tanveer et al. 2020a, and of ABOP.

A plain turtle for the symbols of Tanveer et al. 2020a: a stack, one segment at a time, matrices.
"""

import re

import numpy as np

from forest_addon.base.rng import truncated_normal


def rotation(axis, angle):
    """Rotation matrix about a unit axis (from the matrix exponential of its cross product)."""
    from scipy.linalg import expm

    x, y, z = axis
    return expm(angle * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))


def grow_plainly(symbols, grammar, jitter, rng):
    """start, end (S, 3) and start radius (S,), drawing in the same order as the product."""
    text = symbols.tobytes().decode()
    count = text.count("d") + text.count("g")
    draw = {k: truncated_normal(rng, count) for k in ("length", "angle", "twist", "lean", "side")}
    lift = rng.random(count) * jitter.raise_ratio

    segments = []  # dicts with start, end, heading, left, length, radius, parent, role
    stack, node, role = [], None, "["
    for symbol in text:
        if symbol in "dg":
            segments.append({"mother": node, "role": role})
            node = len(segments) - 1
        elif symbol == ")":
            node = stack.pop() if stack else node
        else:
            role = symbol
            if symbol != "+":
                stack.append(node)

    def place(i):
        s = segments[i]
        if "end" in s:
            return
        if s["mother"] is None:
            s["length"] = grammar.length * (1 + jitter.length * draw["length"][i])
            s["heading"], s["left"] = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
            s["start"], s["radius"] = np.zeros(3), grammar.radius
        else:
            place(s["mother"])
            m = segments[s["mother"]]
            ratio = grammar.centre_ratio if s["role"] == "[" else grammar.side_ratio
            s["length"] = m["length"] * ratio * (1 + jitter.length * draw["length"][i])
            if s["role"] == "[":
                twist = np.deg2rad(grammar.twist_deg + jitter.twist_deg * draw["twist"][i])
                side = rotation(m["heading"], twist) @ m["left"]
                tilt = np.tan(np.deg2rad(jitter.lean_deg))
                across = np.cross(m["heading"], side)
                h = m["heading"] + tilt * (draw["lean"][i] * side + draw["side"][i] * across)
                s["heading"] = h / np.linalg.norm(h)
                left = side - side @ s["heading"] * s["heading"]
                s["left"] = left / np.linalg.norm(left)
                s["start"], s["radius"] = m["end"], m["radius"] * ratio
            else:
                angle = np.deg2rad(grammar.angle_deg + jitter.angle_deg * draw["angle"][i])
                sign = 1 if s["role"] == "(" else -1
                s["heading"] = rotation(m["left"], sign * angle) @ m["heading"]
                s["left"], s["radius"] = m["left"], m["radius"] * grammar.radius_ratio
                s["start"] = m["end"]
                if s["role"] == "+":
                    onward = next(
                        j
                        for j, other in enumerate(segments)
                        if other["mother"] == s["mother"] and other["role"] == "["
                    )
                    place(onward)
                    o = segments[onward]
                    s["start"] = m["end"] + lift[i] * o["length"] * o["heading"]
        s["end"] = s["start"] + s["length"] * s["heading"]

    for i in range(count):
        place(i)
    return (
        np.array([s["start"] for s in segments]),
        np.array([s["end"] for s in segments]),
        np.array([s["radius"] for s in segments]),
    )


# --------------------------------------------------------------------------------------- turtle abop
# A plain turtle of ABOP: a stack of frames, one symbol after the other, rotation matrices.

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
