"""Trees in one mesh, of known structure: box-modelled, and remeshed from separate parts."""

from dataclasses import dataclass, field

import numpy as np

from .model_tree import tube


@dataclass
class BoxTree:
    """A tube of quads, out of whose faces others are drawn, as one models by hand."""

    sides: int = 8
    rings: list[np.ndarray] = field(default_factory=list)  # (n, sides, 3) of each branch
    holes: list[set[tuple[int, int]]] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    length: list[float] = field(default_factory=list)
    radius: list[float] = field(default_factory=list)

    def trunk(self, path: np.ndarray, radius: np.ndarray) -> int:
        walls = tube(path, radius, self.sides)[: self.sides * (len(path) - 1)]
        first = walls[:, 0].reshape(self.sides, len(path) - 1, 3)
        last = tube(path, radius, self.sides)[self.sides * (len(path) - 1) :]
        top = last[:, 2].reshape(self.sides, len(path) - 1, 3)[:, -1]
        rings = np.concatenate([first, top[:, None]], axis=1).swapaxes(0, 1)
        return self._keep(rings, -1, path, radius)

    def draw_out(self, mother: int, ring: int, side: int, tip: np.ndarray, steps: int = 8) -> int:
        """A four-sided branch out of a face of its parent, to a tip, a third as thick there."""
        own = self.rings[mother]
        after = (side + 1) % own.shape[1]
        face = np.stack(
            [own[ring, side], own[ring, after], own[ring + 1, after], own[ring + 1, side]]
        )
        self.holes[mother].add((ring, side))
        middle = face.mean(axis=0)
        share = np.linspace(0, 1, steps + 1)[:, None, None]
        rings = middle + share * (tip - middle) + (face - middle) * (1 - 0.67 * share)
        path = middle + share[:, 0] * (tip - middle)
        radius = np.linalg.norm(rings - path[:, None], axis=2).mean(axis=1)
        return self._keep(rings, mother, path, radius)

    def _keep(self, rings: np.ndarray, mother: int, path: np.ndarray, radius: np.ndarray) -> int:
        self.rings.append(rings)
        self.holes.append(set())
        self.parents.append(mother)
        self.length.append(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()))
        self.radius.append(float(radius[0]))
        return len(self.rings) - 1

    def facets(self) -> np.ndarray:
        found = []
        for rings, holes in zip(self.rings, self.holes, strict=True):
            count = rings.shape[1]
            for ring in range(len(rings) - 1):
                for side in range(count):
                    if (ring, side) in holes:
                        continue
                    after = (side + 1) % count
                    a, b = rings[ring, side], rings[ring, after]
                    c, d = rings[ring + 1, after], rings[ring + 1, side]
                    found += [[a, b, c], [a, c, d]]
        return np.array(found)


def box_tree() -> BoxTree:
    """A trunk, seven branches, four of them with a twig."""
    tree = BoxTree()
    path = np.linspace([0, 0, 0], [0.4, 0.2, 9], 37)
    trunk = tree.trunk(path, np.linspace(0.25, 0.08, 37))
    for number in range(7):
        ring, side = 12 + 3 * number, (3 * number) % 8
        own = tree.rings[trunk]
        out = own[ring, side] + own[ring, (side + 1) % 8] - 2 * own[ring].mean(axis=0)
        out = out / np.linalg.norm(out) + [0, 0, 0.7]
        branch = tree.draw_out(trunk, ring, side, path[ring] + out * (2.4 - 0.2 * number), 10)
        if number % 2 == 0:
            own = tree.rings[branch]
            out = own[4, 1] + own[4, 2] - 2 * own[4].mean(axis=0)
            out = out / np.linalg.norm(out) + 0.5 * (own[5, 0] - own[4, 0]) / 0.2
            tree.draw_out(branch, 4, 1, own[4].mean(axis=0) + 0.6 * out, 6)
    return tree


def remeshed(facets: np.ndarray, voxel: float) -> np.ndarray:
    """The union of closed parts as one mesh of voxels' surfaces, by Blender; crumbs left out."""
    import pytest

    bpy = pytest.importorskip("bpy")
    corners, index = np.unique(facets.reshape(-1, 3), axis=0, return_inverse=True)
    mesh = bpy.data.meshes.new("parts")
    mesh.from_pydata(corners.tolist(), [], index.reshape(-1, 3).tolist())
    obj = bpy.data.objects.new("parts", mesh)
    bpy.context.scene.collection.objects.link(obj)
    change = obj.modifiers.new("union", "REMESH")
    change.mode, change.voxel_size = "VOXEL", voxel
    made = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    made.calc_loop_triangles()
    places = np.empty(3 * len(made.vertices), np.float32)
    triangles = np.empty(3 * len(made.loop_triangles), np.int32)
    made.vertices.foreach_get("co", places)
    made.loop_triangles.foreach_get("vertices", triangles)
    bpy.data.batch_remove([obj, mesh])
    return places.astype(float).reshape(-1, 3)[triangles.reshape(-1, 3)]
