"""Dijkstra along edges, to all vertices and within a radius, against scipy's."""
import os

import numpy as np

import eigen
from runner import HERE, SALIENT, VENV_PYTHON, WORK, Failed, alternating, chosen, note, run, seconds, table

#: (mesh, sources, vertices within the radius, or 0 for no limit, rounds)
CASES = [(mesh, sources, size, 5) for mesh in ("creature-10k", "creature-43k", "creature-173k") for sources, size in ((20, 0), (200, 400))]
QUICK = [("creature-5k", 20, 0, 3), ("creature-5k", 200, 400, 3)]


def solve(command, reference):
    """One measured run; the sums of its distances are compared with those of the first one."""
    out = WORK / f"sums-{os.getpid()}"
    result = run([*command, out], 1)
    sums = np.fromfile(out)
    difference = abs(sums / reference.setdefault("sums", sums) - 1).max()
    if not difference <= 1e-9:
        raise Failed(f"distances differ by {difference:.0e}")
    return result


def bench(quick, only):
    print("One thread, several sources one after the other; the graph is made before. `within` is the number of vertices in a disc of the "
          "limit.\n")

    def rows():
        for name, sources, size, rounds in chosen(QUICK if quick else CASES, only):
            note(f"geodesics {name} {size}")
            mesh, reference = f"{eigen.prepare(name)}.mesh", {}
            own = [SALIENT, "geodesics", mesh, sources, size]
            radius = run([*own, os.devnull], 1, preparation=True)["radius"]
            peer = [VENV_PYTHON, HERE / "local_peer.py", "geodesics", mesh, sources, radius]
            results = alternating({"salient": lambda: solve(own, reference), "scipy": lambda: solve(peer, reference)}, rounds)
            mine = results["salient"]
            for result in results.values():
                if not isinstance(result, Failed):
                    result["wall"] /= sources
            yield [name, str(sources), str(size) if size else "all",
                   str(mine) if isinstance(mine, Failed) else seconds(mine["wall"]), eigen.cell(results["scipy"], mine)]

    table(["mesh", "sources", "within", "salient, per source", "scipy, per source"], rows())
