"""One peer solves one eigenproblem M v = lambda S v in this process: `eigen_peer.py METHOD OPERATOR K OUT [name=value]...`.

The time is that of ordering, factorisation, iteration and vectors in an array; imports and reading are not in it.
"""
import sys

import numpy as np

import files
from meter import measured, report

#: The shift, in units of 4 pi / area, Weyl's mean distance of eigenvalues. Slightly negative: M - sigma S is then positive definite.
SHIFT = -0.1


def shift(mass, options):
    return options.get("shift", SHIFT) * 4 * np.pi / mass.sum()


def scipy_eigsh(stiffness, mass, k, options, inverse):
    import scipy.sparse as sp
    from scipy.sparse.linalg import eigsh

    sigma, ncv = shift(mass, options), options.get("ncv")
    n = len(mass)
    ncv = None if ncv is None else min(n, max(int(ncv * k), k + 2))
    matrix = sp.diags(mass).tocsc()
    start = np.random.default_rng(1).standard_normal(n)
    shifted = (stiffness - sigma * matrix).tocsc()
    return eigsh(stiffness, k, matrix, sigma=sigma, OPinv=inverse(shifted), ncv=ncv, tol=options["tol"], v0=start)


def cholmod(shifted):
    from scipy.sparse.linalg import LinearOperator
    from sksparse.cholmod import cholesky

    factor = cholesky(shifted)
    return LinearOperator(shifted.shape, matvec=factor, dtype=float)


def superlu(_shifted):
    return None  # eigsh factors by SuperLU itself


def lapy(stiffness, mass, k, _options):
    import scipy.sparse as sp
    from lapy import Solver

    solver = Solver.__new__(Solver)  # its own assembly is not what is measured
    solver.stiffness, solver.mass, solver.use_cholmod = stiffness.tocsc(), sp.diags(mass).tocsc(), True
    return solver.eigs(k)


def slepc(stiffness, mass, k, options):
    from petsc4py import PETSc
    from slepc4py import SLEPc

    n, sigma = len(mass), shift(mass, options)
    scaled = options.get("scaled", 0) == 1
    root = 1 / np.sqrt(mass)
    if scaled:
        import scipy.sparse as sp

        stiffness = (sp.diags(root) @ stiffness @ sp.diags(root)).tocsr()
    a = PETSc.Mat().createAIJ((n, n), csr=(stiffness.indptr, stiffness.indices, stiffness.data))
    a.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    solver = SLEPc.EPS().create()
    if scaled:
        solver.setOperators(a)
        solver.setProblemType(SLEPc.EPS.ProblemType.HEP)
    else:
        index = np.arange(n + 1, dtype=np.int32)
        b = PETSc.Mat().createAIJ((n, n), csr=(index, index[:-1], mass))
        b.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        solver.setOperators(a, b)
        solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    if options.get("ncv"):
        solver.setDimensions(k, min(n, int(options["ncv"] * k)))
    else:
        solver.setDimensions(k)
    solver.setTolerances(options["tol"], 1000)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    solver.setTarget(sigma)
    transform = solver.getST()
    transform.setType(SLEPc.ST.Type.SINVERT)
    inner = transform.getKSP()
    inner.setType(PETSc.KSP.Type.PREONLY)
    inner.getPC().setType(PETSc.PC.Type.CHOLESKY)
    inner.getPC().setFactorSolverType(PETSc.Mat.SolverType.CHOLMOD)
    solver.setFromOptions()
    solver.solve()
    if solver.getConverged() < k:
        raise SystemExit(f"SLEPc converged {solver.getConverged()} of {k} pairs")
    values, vectors = np.empty(k), np.empty((n, k), order="F")
    vector = a.createVecRight()
    for j in range(k):
        values[j] = solver.getEigenpair(j, vector).real
        vectors[:, j] = vector.getArray(readonly=True)
    if scaled:
        vectors *= root[:, None]
    return values, vectors


METHODS = {
    "scipy": lambda *a: scipy_eigsh(*a, superlu),
    "cholmod": lambda *a: scipy_eigsh(*a, cholmod),
    "lapy": lapy,
    "slepc": slepc,
}


def preload(method, extra):
    """What a user's program would have loaded before: not part of the solve."""
    if method == "slepc":
        import glob

        for part in ("petscdir/petsc3.*", "slepcdir/slepc3.*"):  # Debian keeps its real-valued bindings here
            sys.path[:0] = sorted(glob.glob(f"/usr/lib/{part}/*-real/lib/python3/dist-packages"))
        import slepc4py

        slepc4py.init(["peer", *extra])
        import petsc4py.PETSc  # noqa: F401
        from slepc4py import SLEPc  # noqa: F401
    else:
        import scipy.sparse.linalg  # noqa: F401
    if method == "cholmod":
        import sksparse.cholmod  # noqa: F401
    if method == "lapy":
        import cholespy, lapy  # noqa: F401, E401


def main():
    method, operator, k, out, *rest = sys.argv[1:]
    extra = [word for word in rest if word.startswith("-") or "=" not in word]
    options = {"tol": 0.0, **{n: float(v) for n, v in (w.split("=") for w in rest if w not in extra)}}
    stiffness, mass = files.read_operator(operator)
    preload(method, extra)
    np.ones((64, 64)) @ np.ones((64, 64))  # the BLAS's threads are started
    (values, vectors), cost = measured(lambda: METHODS[method](stiffness, mass, int(k), options))
    files.write_pairs(out, values, vectors)
    report(cost)


if __name__ == "__main__":
    main()
