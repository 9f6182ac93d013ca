"""Regenerates eigenvalues.csv: eigenvalues of procedural meshes by scipy, from a Laplacian assembled here anew.

    pip install numpy scipy
    python eigenvalues.py > eigenvalues.csv

Each mesh's 60 smallest eigenvalues of M v = lambda S v come from ARPACK (shift-invert, tolerance at machine precision) and are
checked here against LAPACK's dense solver to 1e-9 relative; the tests allow 1e-9 too. The mesh formulas are repeated in
tests/golden.rs; coordinates may differ in the last bit, which moves eigenvalues by far less than that. Made with numpy 2, scipy 1.
"""

import sys

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg


def torus(p, q):
    """A closed surface: a torus whose tube is modulated."""
    v, u = np.meshgrid(2 * np.pi * np.arange(q) / q, 2 * np.pi * np.arange(p) / p, indexing="ij")
    tube = 0.4 * (1 + 0.2 * np.sin(3 * u) * np.cos(2 * v) + 0.1 * np.cos(u + v))
    points = np.stack([(1 + tube * np.cos(v)) * np.cos(u), (1 + tube * np.cos(v)) * np.sin(u), tube * np.sin(v)], axis=-1)
    faces = []
    for j in range(q):
        for i in range(p):
            a, b = j * p + i, j * p + (i + 1) % p
            d, c = (j + 1) % q * p + i, (j + 1) % q * p + (i + 1) % p
            faces += [[a, b, c], [a, c, d]]
    return points.reshape(-1, 3), np.array(faces)


def sheet(p, q):
    """A surface with boundary, uneven and with obtuse triangles."""
    j, i = np.meshgrid(np.arange(q + 1), np.arange(p + 1), indexing="ij")
    x = (i + 0.3 * np.sin(3.0 * i + 5.0 * j)) / p
    y = (j + 0.3 * np.cos(4.0 * i - 3.0 * j)) / q
    points = np.stack([x, y, 0.3 * np.sin(4 * x + 1) * np.cos(3 * y)], axis=-1)
    faces = []
    for j in range(q):
        for i in range(p):
            a = j * (p + 1) + i
            faces += [[a, a + 1, a + p + 2], [a, a + p + 2, a + p + 1]]
    return points.reshape(-1, 3), np.array(faces)


def pair():
    """Two components, one closed, one with boundary."""
    (a, f), (b, g) = torus(24, 12), sheet(16, 14)
    return np.concatenate([a, b + [5.0, 0.0, 0.0]]), np.concatenate([f, g + len(a)])


def operator(points, faces, mixed):
    """Cotangent stiffness M and lumped areas S, either Meyer's mixed areas or thirds."""
    n = len(points)
    stiffness, mass = scipy.sparse.lil_matrix((n, n)), np.zeros(n)
    for face in faces:
        corners = points[face]
        angles = []
        for i in range(3):
            u, v = corners[(i + 1) % 3] - corners[i], corners[(i + 2) % 3] - corners[i]
            angles.append(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))
        area = 0.5 * np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            w = 0.5 / np.tan(angles[i])
            for r, c, x in [(j, k, -w), (k, j, -w), (j, j, w), (k, k, w)]:
                stiffness[face[r], face[c]] += x
            if not mixed:
                share = area / 3
            elif max(angles) > np.pi / 2:
                share = area / 2 if angles[i] > np.pi / 2 else area / 4
            else:
                ij, ik = (np.sum((corners[i] - corners[o]) ** 2) for o in (j, k))
                share = (ij / np.tan(angles[k]) + ik / np.tan(angles[j])) / 8
            mass[face[i]] += share
    return stiffness.tocsc(), mass


def main():
    meshes = {"torus": torus(40, 20), "sheet": sheet(30, 24), "pair": pair()}
    print("mesh,area,index,eigenvalue")
    for name, (points, faces) in meshes.items():
        for area in ("mixed", "barycentric"):
            stiffness, mass = operator(points, faces, area == "mixed")
            values = scipy.sparse.linalg.eigsh(
                stiffness, k=60, M=scipy.sparse.diags(mass).tocsc(), sigma=-1.0, tol=0, ncv=150, return_eigenvectors=False
            )
            values = np.sort(values)
            dense = scipy.linalg.eigh(stiffness.toarray(), np.diag(mass), eigvals_only=True)[:60]
            error = np.max(np.abs(values - dense) / np.maximum(dense, 1e-2))
            print(name, area, "ARPACK against LAPACK", error, file=sys.stderr)
            assert error < 1e-9
            for index, value in enumerate(values):
                print(f"{name},{area},{index},{value:.15e}")


if __name__ == "__main__":
    main()
