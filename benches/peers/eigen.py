"""Smallest eigenpairs: `salient` against SLEPc, LaPy and scipy on the same operators to the same residual."""
import dataclasses
import json
import os

import files
from runner import (DEBIAN_PYTHON, HERE, SALIENT, VENV_PYTHON, WORK, Failed, alternating, chosen, data_folder, megabytes, note, run,
                    seconds, table)

#: Largest residual ||M v - lambda S v|| in the S^-1 norm over lambda that counts as solved.
RESIDUAL = 1e-8

#: Name: (source if the real meshes are there, source elsewhere, levels of subdivision).
MESHES = {
    "quadruped-1k": ("quadrupeds/Horse/Horse__Attack_Headbutt_33.off", "creature:1000", 0),
    "creature-5k": (None, "creature:5000", 0),
    "cheburashka-7k": ("cheburashka_poses/cheburashka-01.obj", None, 0),
    "creature-10k": (None, "creature:10000", 0),
    "cow-12k": ("cow_poses/cow-1.obj", None, 0),
    "creature-43k": (None, "creature:10812", 1),
    "creature-100k": (None, "creature:25000", 1),
    "creature-173k": (None, "creature:10812", 2),
}

#: (mesh, k, rounds)
CASES = [
    ("quadruped-1k", 100, 9), ("quadruped-1k", 300, 7),
    ("creature-5k", 100, 7), ("creature-5k", 300, 5),
    ("cheburashka-7k", 100, 7), ("cow-12k", 100, 5),
    ("creature-10k", 100, 7), ("creature-10k", 300, 5), ("creature-10k", 1000, 2),
    ("creature-43k", 100, 4), ("creature-43k", 300, 3),
    ("creature-100k", 100, 2), ("creature-100k", 300, 2),
    ("creature-173k", 100, 2), ("creature-173k", 300, 2),
]
QUICK = [("quadruped-1k", 100, 3), ("creature-5k", 100, 3)]


@dataclasses.dataclass(frozen=True)
class Peer:
    """One way to run one of the solvers of eigen_peer.py."""

    title: str
    method: str
    options: tuple = ()
    #: Tolerances to try, loosest first, until the residual is small enough; empty if the solver has no such option.
    tolerances: tuple = (1e-4, 1e-6, 1e-8, 1e-9)
    #: Largest n and k worth waiting for.
    largest: tuple = (10**9, 10**9)

    def command(self, operator, k, tolerance, out):
        python = DEBIAN_PYTHON if self.method == "slepc" else VENV_PYTHON
        words = [python, HERE / "eigen_peer.py", self.method, operator, k, out, *self.options]
        return words if tolerance is None else [*words, f"tol={tolerance}"]


PEERS = [
    # A tolerance above 3e-8 never sufficed with the generalised problem, nor above 1e-9 with the scaled one.
    Peer("SLEPc tuned", "slepc", ("ncv=1.2",), (3e-8, 1e-8, 3e-9, 1e-9)),
    Peer("SLEPc tuned, scaled", "slepc", ("ncv=1.2", "scaled=1"), (1e-9, 3e-10, 1e-10, 3e-11, 1e-11, 3e-12)),
    Peer("SLEPc default", "slepc", (), (1e-7, 3e-8, 1e-8, 3e-9)),
    Peer("LaPy", "lapy", tolerances=()),
    Peer("eigsh + CHOLMOD", "cholmod"),
    Peer("eigsh + SuperLU", "scipy", largest=(50_000, 300)),
]


def prepare(name):
    """Makes the mesh and its operator unless they are there; the stem of both files, or None if the real mesh is absent."""
    real, synthesised, levels = MESHES[name]
    data = data_folder()
    source = data / real if data and real else synthesised
    if source is None:
        return None
    stem = WORK / "inputs" / (name if source != synthesised or real is None else f"{name}-synthesised")
    if not stem.with_suffix(".operator").exists():
        stem.parent.mkdir(parents=True, exist_ok=True)
        run([SALIENT, "mesh", source, levels, stem], 1, preparation=True)
    return stem


def solve(command, operator, threads):
    """One measured run, with the residual and the orthogonality of what it wrote."""
    out = WORK / f"pairs-{os.getpid()}"
    try:
        result = run([out if word == "OUT" else word for word in command], threads)
        result["residual"], result["orthogonality"] = files.quality(operator, out)
    finally:
        out.unlink(missing_ok=True)
    if not result["residual"] <= RESIDUAL:
        raise Failed(f"residual {result['residual']:.0e}")
    return result


def loosest(peer, operator, k):
    """The loosest tolerance with which `peer` reaches the residual; remembered between runs."""
    if not peer.tolerances:
        return None
    memory = WORK / "tolerances.json"
    known = json.loads(memory.read_text()) if memory.exists() else {}
    key = f"{operator.name} {k} {peer.method} {' '.join(peer.options)}"
    if key not in known:
        for tolerance in peer.tolerances:
            try:
                solve(peer.command(operator, k, tolerance, "OUT"), operator, 2)
            except Failed as error:
                note(f"  {key} at {tolerance:g}: {error}")
                continue
            known[key] = tolerance
            break
        else:
            known[key] = peer.tolerances[-1]
        memory.write_text(json.dumps(known, indent=1))
    return known[key]


def compare(name, k, rounds, threads, peers=None):
    """All methods on one problem: name -> result, `Failed`, or absent if not worth waiting for."""
    stem = prepare(name)
    if stem is None:
        return None
    operator = stem.with_suffix(".operator")
    n = files.size(operator)
    jobs = {"salient": lambda: solve([SALIENT, "eigen", operator, k, threads, "OUT"], operator, threads)}
    for peer in peers or PEERS:
        if k >= n or n > peer.largest[0] or k > peer.largest[1]:
            continue
        command = peer.command(operator, k, loosest(peer, operator, k), "OUT")
        jobs[peer.title] = lambda command=command: solve(command, operator, threads)
    return n, alternating(jobs, rounds)


def cell(result, own):
    """A peer's ratio to salient, and its own time."""
    if result is None:
        return "-"
    if isinstance(result, Failed):
        return f"failed: {result}"
    if isinstance(own, Failed):
        return seconds(result["wall"])
    return f"**{result['wall'] / own['wall']:.1f}x** ({seconds(result['wall'])})"


def row(name, k, threads, n, results):
    own = results["salient"]
    mine = str(own) if isinstance(own, Failed) else f"{seconds(own['wall'])}, cpu {seconds(own['cpu'])}"
    done = {title: r for title, r in results.items() if not isinstance(r, Failed)}
    memory = ", ".join(f"{title} {megabytes(r['memory'])}" for title, r in done.items() if title in ("salient", "SLEPc tuned", "LaPy"))
    residual = ", ".join(f"{r['residual']:.0e}" for r in done.values())
    peers = [cell(results.get(peer.title), own) for peer in PEERS]
    return [f"{name} (n = {n})", str(k), str(threads), mine, *peers, memory, residual]


def bench(quick, only):
    print("Ratios are the peer's wall time over salient's, best of alternating runs. Memory is the peak above what was resident before the "
          "solve. Residuals are in the order of the columns, without the failed.\n")

    def rows():
        for name, k, rounds in chosen(QUICK if quick else CASES, only):
            for threads in (1, 2):
                note(f"eigen {name} k = {k}, {threads} threads")
                compared = compare(name, k, rounds, threads)
                if compared is None:
                    note("  skipped: the real mesh is not there")
                    break
                yield row(name, k, threads, *compared)

    table(["mesh", "k", "threads", "salient", *(peer.title for peer in PEERS), "peak memory", "largest residuals"], rows())
