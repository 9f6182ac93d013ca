"""Times scipy.sparse.csgraph.dijkstra on the mesh that `hot_loops FILE.obj N OUT.off` wrote: full, and limited to shares of the extent.

One thread's CPU time, the best of several runs; the same numbers of sources as the example.
"""

import sys
import time

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra


def read_off(path):
    with open(path) as file:
        words = file.read().split()
    n, f = int(words[1]), int(words[2])
    points = np.array(words[4 : 4 + 3 * n], dtype=float).reshape(n, 3)
    faces = np.array(words[4 + 3 * n : 4 + 3 * n + 4 * f], dtype=int).reshape(f, 4)[:, 1:]
    return points, faces


def best(rounds, run):
    least = float("inf")
    for _ in range(rounds):
        start = time.thread_time()
        run()
        least = min(least, time.thread_time() - start)
    return least


points, faces = read_off(sys.argv[1])
n = len(points)
pairs = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
lengths = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
graph = csr_matrix(
    (np.concatenate([lengths, lengths]), (np.concatenate([pairs[:, 0], pairs[:, 1]]), np.concatenate([pairs[:, 1], pairs[:, 0]]))),
    shape=(n, n),
)
first = dijkstra(graph, indices=0)
far = first[np.isfinite(first)].max()
rounds = max(3, min(20, 400_000 // n))
full = best(rounds, lambda: dijkstra(graph, indices=n // 3))
print(f"{n} vertices: full {full * 1e9 / n:.1f} ns/vertex {full * 1e3:.3f} ms")
sources = [(7919 * (i + 1)) % n for i in range(50)]
for share in [0.02, 0.05, 0.1, 0.2]:
    # One call for all sources would allocate a table of 50 n; a loop is what a caller of single balls does. The better is reported.
    def loop():
        for s in sources:
            dijkstra(graph, indices=s, limit=share * far)

    once = lambda: dijkstra(graph, indices=sources, limit=share * far)
    times = [best(3, loop), best(3, once)]
    print(f"50 balls of {share}: loop {times[0] * 1e3:.3f} ms, one call {times[1] * 1e3:.3f} ms")
