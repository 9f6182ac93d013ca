"""Patch spectra: the first 21 nonzero eigenvalues of many doubled patches."""
import json
import os

import numpy as np

import eigen
from runner import HERE, SALIENT, VENV_PYTHON, WORK, Failed, alternating, chosen, note, run, seconds, table

VALUES = 21
COUNT = 50
#: (mesh, vertices of a patch about, rounds)
CASES = [("creature-10k", 30, 5), ("creature-10k", 50, 5), ("creature-10k", 90, 5), ("creature-10k", 180, 5), ("creature-10k", 400, 4), ("creature-10k", 1000, 3), ("creature-10k", 2000, 3),
         ("creature-43k", 4000, 2)]
QUICK = [("creature-5k", 90, 3), ("creature-5k", 1000, 2)]
#: Up to this size of a patch LAPACK is worth waiting for.
DENSE = 400
#: Largest relative difference of the peers' values from salient's.
AGREE = 1e-7


def cut(name, size):
    """Cuts the patches unless they are there; the stem of their files and their sizes."""
    stem = WORK / "inputs" / f"{name}-patch{size}"
    index = stem.with_suffix(".json")
    if not index.exists():
        index.write_text(json.dumps(run([SALIENT, "cut", f"{eigen.prepare(name)}.mesh", size, COUNT, stem], 1, preparation=True)))
    return stem, json.loads(index.read_text())["sizes"]


def solve(command, threads, reference):
    """One measured run; its values are compared with those of the first one."""
    out = WORK / f"values-{os.getpid()}"
    result = run([*command, threads, out], 1)
    values = np.fromfile(out)
    difference = abs(values / reference.setdefault("values", values) - 1).max()
    if not difference <= AGREE:
        raise Failed(f"values differ by {difference:.0e}")
    return {**result, "difference": difference}


def bench(quick, only):
    print(f"{VALUES} values of {COUNT} patches, on 2 threads the peers run in two processes. Salient assembles too; "
          "its peers are given the doubled operators.\n")

    def rows():
        for name, size, rounds in chosen(QUICK if quick else CASES, only):
            stem, sizes = cut(name, size)
            for threads in (1, 2):
                note(f"patches {name} {size}, {threads} threads")
                yield row(name, stem, sizes, size, threads, rounds)

    table(["mesh", "patch vertices (median, largest)", "threads", "salient", "eigsh + CHOLMOD", "LAPACK dense", "differences"],
          rows())


def row(name, stem, sizes, size, threads, rounds):
    reference, count = {}, len(sizes)
    peer = [VENV_PYTHON, HERE / "local_peer.py", "patches"]
    commands = {"salient": [SALIENT, "patches", stem, count, VALUES], "cholmod": [*peer, "cholmod", stem, count, VALUES]}
    if size <= DENSE:
        commands["dense"] = [*peer, "dense", stem, count, VALUES]
    jobs = {k: lambda c=command: solve(c, threads, reference) for k, command in commands.items()}
    results = alternating(jobs, rounds)
    own = results["salient"]
    done = [r for r in results.values() if not isinstance(r, Failed)]
    mine = str(own) if isinstance(own, Failed) else seconds(own["wall"])
    return [name, f"{int(np.median(sizes))}, {max(sizes)}", str(threads), mine,
            *(eigen.cell(results.get(k), own) for k in ("cholmod", "dense")),
            ", ".join(f"{r['difference']:.0e}" for r in done[1:])]
