"""The files that `salient` and its peers hand each other; nodes/kernels/examples/peers/files.rs states the layouts."""
import numpy as np
import scipy.sparse as sp


def read_operator(path):
    """Stiffness M (CSR, int32 indices) and the diagonal of S."""
    with open(path, "rb") as file:
        n, nnz = np.fromfile(file, "<u8", 2).astype(int)
        offsets = np.fromfile(file, "<u8", n + 1).astype(np.int32)
        columns = np.fromfile(file, "<u4", nnz).astype(np.int32)
        values = np.fromfile(file, "<f8", nnz)
        mass = np.fromfile(file, "<f8", n)
    return sp.csr_matrix((values, columns, offsets), shape=(n, n)), mass


def write_operator(path, stiffness, mass):
    matrix = sp.csr_matrix(stiffness)
    matrix.sort_indices()
    with open(path, "wb") as file:
        np.array([matrix.shape[0], matrix.nnz], "<u8").tofile(file)
        matrix.indptr.astype("<u8").tofile(file)
        matrix.indices.astype("<u4").tofile(file)
        matrix.data.astype("<f8").tofile(file)
        np.asarray(mass, "<f8").tofile(file)


def read_mesh(path):
    """Positions (v x 3) and faces (f x 3)."""
    with open(path, "rb") as file:
        vertices, faces = np.fromfile(file, "<u8", 2).astype(int)
        positions = np.fromfile(file, "<f8", 3 * vertices).reshape(-1, 3)
        corners = np.fromfile(file, "<u4", 3 * faces).astype(np.int64).reshape(-1, 3)
    return positions, corners


def write_pairs(path, values, vectors):
    """`vectors` is n x k."""
    with open(path, "wb") as file:
        np.array([vectors.shape[0], len(values)], "<u8").tofile(file)
        np.asarray(values, "<f8").tofile(file)
        for vector in np.asarray(vectors).T:
            np.ascontiguousarray(vector, "<f8").tofile(file)


def read_pairs(path):
    """Values (k) and vectors (n x k, Fortran order, mapped)."""
    n, k = np.fromfile(path, "<u8", 2).astype(int)
    values = np.fromfile(path, "<f8", k, offset=16)
    return values, np.memmap(path, "<f8", "r", offset=16 + 8 * k, shape=(n, k), order="F")


def quality(operator, pairs):
    """Largest ||M v - lambda S v|| in the S^-1 norm over lambda, for ||v||_S = 1 (a zero lambda: over the first positive one), and
    largest entry of |V' S V - I|. One routine for every method."""
    (stiffness, mass), (values, vectors) = read_operator(operator), read_pairs(pairs)
    order = np.argsort(values)
    positive = values[values > 1e-9 * values.max()].min()
    worst = 0.0
    for start in range(0, len(values), 32):
        part = order[start : start + 32]
        v = np.asarray(vectors[:, part])
        v = v / np.sqrt(mass @ (v * v))
        residual = stiffness @ v - mass[:, None] * v * values[part]
        norms = np.sqrt((1 / mass) @ (residual * residual))
        worst = max(worst, (norms / np.maximum(values[part], positive)).max())
    v = np.asarray(vectors)
    gram = v.T @ (mass[:, None] * v)
    return float(worst), float(abs(gram - np.eye(len(values))).max())


def size(operator):
    """The number of rows."""
    return int(np.fromfile(operator, "<u8", 1)[0])
