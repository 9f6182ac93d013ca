"""Peers of patch spectra and geodesics, in this process:

    local_peer.py patches METHOD STEM COUNT VALUES WORKERS OUT    METHOD is cholmod or dense, on the operators of the doubled patches
    local_peer.py geodesics MESH COUNT RADIUS OUT         scipy's Dijkstra; RADIUS 0 is without limit
"""
import multiprocessing
import sys

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import LinearOperator, eigsh
from sksparse.cholmod import cholesky

import files
from meter import measured, report


def cholmod_values(stiffness, mass, count):
    sigma = -0.1 * 4 * np.pi / mass.sum()
    matrix = sp.diags(mass).tocsc()
    factor = cholesky((stiffness - sigma * matrix).tocsc())
    inverse = LinearOperator(stiffness.shape, matvec=factor, dtype=float)
    start = np.random.default_rng(1).standard_normal(len(mass))
    values = eigsh(stiffness, count + 1, matrix, sigma=sigma, OPinv=inverse, tol=1e-8, v0=start, return_eigenvectors=False)
    return np.sort(values)[1:]


def dense_values(stiffness, mass, count):
    root = 1 / np.sqrt(mass)
    matrix = stiffness.toarray() * root[:, None] * root
    return scipy.linalg.eigh(matrix, eigvals_only=True, subset_by_index=(0, count), driver="evr", overwrite_a=True,
                             check_finite=False)[1:]


def patches(method, stem, count, values, workers, out):
    """Small problems gain nothing from threads inside BLAS: each worker is a process with one thread, started before the clock."""
    count, values, workers = int(count), int(values), int(workers)
    solve = {"cholmod": cholmod_values, "dense": dense_values}[method]
    operators = [files.read_operator(f"{stem}-{i}.operator") for i in range(count)]
    solve(*operators[0], values)  # whatever is loaded at the first use
    if workers == 1:
        spectra, cost = measured(lambda: [solve(*operator, values) for operator in operators])
    else:
        global one  # forked workers find it, and the operators, in their memory

        def one(i):
            return solve(*operators[i], values)

        with multiprocessing.get_context("fork").Pool(workers) as pool:
            pool.map(one, range(workers), chunksize=1)
            spectra, cost = measured(lambda: pool.map(one, range(count), chunksize=1))
    np.concatenate(spectra).tofile(out)
    report(cost)


def geodesics(path, count, radius, out):
    positions, corners = files.read_mesh(path)
    n, count, radius = len(positions), int(count), float(radius)
    ends = np.unique(np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1), axis=0)
    lengths = np.linalg.norm(positions[ends[:, 0]] - positions[ends[:, 1]], axis=1)
    graph = sp.coo_matrix((lengths, (ends[:, 0], ends[:, 1])), shape=(n, n)).tocsr()
    graph = (graph + graph.T).tocsr()  # both directions stored: faster than directed=False
    sources = [i * n // count for i in range(count)]
    limit = {"limit": radius} if radius > 0 else {}

    def work():
        distances = (dijkstra(graph, directed=True, indices=source, **limit) for source in sources)
        return [d[np.isfinite(d)].sum() for d in distances]

    sums, cost = measured(work)
    np.array(sums).tofile(out)
    report(cost)


if __name__ == "__main__":
    {"patches": patches, "geodesics": geodesics}[sys.argv[1]](*sys.argv[2:])
