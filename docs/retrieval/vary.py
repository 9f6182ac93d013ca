"""Copies a database with each object stretched, bent and turned, and a third of them thickened until near parts merge.

    python docs/retrieval/vary.py FROM TO        folders of folders of OFF files; needs numpy and pymeshlab

The synthetic families vary little within a class. In the copy ShapeDNA is as poor as on SHREC'07, or poorer. Seeded by file name.
"""
import pathlib
import sys
import zlib

import numpy as np
import pymeshlab

STRETCH, BEND, MERGED = 0.25, 0.09, 0.35


def load(path):
    words = path.read_text().split()
    n, m = int(words[1]), int(words[2])
    vertices = np.array(words[4:4 + 3 * n], float).reshape(-1, 3)
    return vertices, np.array(words[4 + 3 * n:4 + 3 * n + 4 * m], int).reshape(-1, 4)[:, 1:]


def save(path, vertices, faces):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w") as out:
        out.write(f"OFF\n{len(vertices)} {len(faces)} 0\n")
        np.savetxt(out, vertices, "%.8g")
        np.savetxt(out, np.c_[np.full(len(faces), 3), faces], "%d")


def upright(vertices, faces):
    """In the principal axes of the area, of unit root mean square size."""
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    centre = (corners.mean(1) * area[:, None]).sum(0) / area.sum()
    at = corners.mean(1) - centre
    moments, axes = np.linalg.eigh((at * area[:, None]).T @ at / area.sum())
    return (vertices - centre) @ axes / np.sqrt(moments.sum())


def bent(vertices, rng):
    """By six waves longer than the object."""
    shift = np.zeros_like(vertices)
    for _ in range(6):
        wave = rng.standard_normal(3)
        wave *= rng.uniform(0.6, 1.8) / np.linalg.norm(wave)
        phase = np.sin(vertices @ wave + rng.uniform(0, 2 * np.pi))
        shift += phase[:, None] * rng.standard_normal(3) / np.linalg.norm(wave)
    return vertices + BEND * shift


def thickened(vertices, faces, by):
    """The surface at a distance outside, remeshed to as many faces; the same again where that fails."""
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    try:
        cell, offset = pymeshlab.PureValue(0.045), pymeshlab.PureValue(by)
        meshes.generate_resampled_uniform_mesh(cellsize=cell, offset=offset, mergeclosevert=True)
        meshes.meshing_remove_connected_component_by_diameter(mincomponentdiag=pymeshlab.PercentageValue(30))
        meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=2 * len(vertices), preservetopology=True)
    except pymeshlab.PyMeshLabException:
        return vertices, faces
    new = meshes.current_mesh()
    return (new.vertex_matrix(), new.face_matrix()) if new.vertex_number() > 300 else (vertices, faces)


source, target = map(pathlib.Path, sys.argv[1:3])
for path in sorted(source.glob("*/*.off")):
    rng = np.random.default_rng(zlib.crc32(path.stem.encode()))
    vertices, faces = load(path)
    vertices = upright(vertices, faces) * np.exp(STRETCH * rng.standard_normal(3))
    vertices = bent(vertices, rng)
    if rng.random() < MERGED:
        vertices, faces = thickened(vertices, faces, rng.uniform(0.02, 0.06))
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    save(target / path.parent.name / path.name, vertices @ turn, faces)
