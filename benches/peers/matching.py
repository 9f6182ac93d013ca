"""Matching: `salient` against HiGHS, SCIP and pylibmgm, on the same problems in one run.

    python3 benches/peers/matching.py [--quick] [--only NAME] [--seconds 60] [FILE.dd ...]

Problems are synthetic ones (`matching_file --make`: 6 candidates a feature, sparse pair scores; "hard" has 70 % of the points in common,
"none" has none) or the files given. HiGHS and SCIP solve the *tight* linearisation: for each candidate a and each feature, the sum
over its candidates b of y_ab <= x_a. One thread each, but for the two
islands of salient's heuristic search. Building the model is not timed, for anyone. pylibmgm has no bound and no proof; its time to best
is that of its whole run.

The peers are installed from PyPI into target/peers/matching on first use.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
VENV = ROOT / "target/peers/matching"
PACKAGES = ["highspy==1.15.1", "numpy==2.4.6", "pylibmgm==1.1.3", "pyscipopt==6.3.0"]
# (kind, size, seeds)
CASES = [("hard", 40, (1, 2, 3)), ("hard", 80, (1, 2, 3)), ("none", 40, (1, 2, 3)), ("none", 80, (1,))]
QUICK = [("hard", 20, (1,)), ("none", 20, (1,))]


def read(path):
    """Sizes, assignments (left, right, cost) and edges (a, b, cost) of a .dd file."""
    sizes, assignments, edges = None, {}, []
    for line in pathlib.Path(path).read_text().splitlines():
        word = line.split()
        if not word:
            continue
        if word[0] == "p":
            sizes = int(word[1]), int(word[2])
        elif word[0] == "a":
            assignments[int(word[1])] = int(word[2]), int(word[3]), float(word[4])
        elif word[0] == "e":
            edges.append((int(word[1]), int(word[2]), float(word[3])))
    return sizes, [assignments[a] for a in range(len(assignments))], edges


def tight_rows(assignments, edges):
    """Constraints of the tight linearisation: (columns, owner); sum of columns <= 1 if owner is None, else <= x_owner."""
    m, rows, slots = len(assignments), {}, {}
    for a, (i, j, _) in enumerate(assignments):
        rows.setdefault((0, i), []).append(a)
        rows.setdefault((1, j), []).append(a)
    for e, (a, b, _) in enumerate(edges):
        for one, other in ((a, b), (b, a)):
            for side in (0, 1):
                slots.setdefault((one, side, assignments[other][side]), []).append(m + e)
    return [(r, None) for r in rows.values()] + [(r, key[0]) for key, r in slots.items()]


def highs(path, seconds):
    import highspy
    import numpy as np

    _, assignments, edges = read(path)
    if any(edge[2] > 0 for edge in edges):
        raise ValueError("the tight linearisation here is for pair costs of 0 or less")
    m, n = len(assignments), len(assignments) + len(edges)
    rows = tight_rows(assignments, edges)
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = n, len(rows)
    lp.col_cost_ = np.array([a[2] for a in assignments] + [e[2] for e in edges])
    lp.col_lower_, lp.col_upper_ = np.zeros(n), np.ones(n)
    lp.row_lower_ = np.full(len(rows), -highspy.kHighsInf)
    lp.row_upper_ = np.array([1.0 if owner is None else 0.0 for _, owner in rows])
    start, index, value = [0], [], []
    for columns, owner in rows:
        index += columns + ([] if owner is None else [owner])
        value += [1.0] * len(columns) + ([] if owner is None else [-1.0])
        start.append(len(index))
    lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    lp.a_matrix_.start_, lp.a_matrix_.index_ = np.array(start, np.int32), np.array(index, np.int32)
    lp.a_matrix_.value_ = np.array(value)
    lp.integrality_ = [highspy.HighsVarType.kInteger] * m + [highspy.HighsVarType.kContinuous] * len(edges)
    solver = highspy.Highs()
    for name, setting in (("output_flag", False), ("threads", 1), ("mip_rel_gap", 0.0), ("time_limit", seconds)):
        solver.setOptionValue(name, setting)
    solver.passModel(lp)
    begin, best = time.perf_counter(), []
    solver.cbMipImprovingSolution.subscribe(
        lambda event: best.append((event.data_out.objective_function_value, time.perf_counter() - begin)))
    solver.run()
    total = time.perf_counter() - begin
    info = solver.getInfo()
    objective = info.objective_function_value
    proved = solver.getModelStatus() == highspy.HighsModelStatus.kOptimal
    when = [t for value, t in best if value <= objective + 1e-9 * abs(objective)]
    return dict(objective=-objective, bound=-info.mip_dual_bound, proved=proved, total=total,
                best=when[0] if when else total, proof=total if proved else None)


def scip(path, seconds):
    import pyscipopt

    _, assignments, edges = read(path)
    if any(edge[2] > 0 for edge in edges):
        raise ValueError("the tight linearisation here is for pair costs of 0 or less")
    model = pyscipopt.Model()
    model.hideOutput()
    variables = [model.addVar(vtype="B", obj=a[2]) for a in assignments]
    variables += [model.addVar(vtype="C", lb=0.0, ub=1.0, obj=e[2]) for e in edges]
    for columns, owner in tight_rows(assignments, edges):
        model.addCons(pyscipopt.quicksum(variables[c] for c in columns) <= (1 if owner is None else variables[owner]))

    class Watch(pyscipopt.Eventhdlr):
        def eventinit(self):
            self.model.catchEvent(pyscipopt.SCIP_EVENTTYPE.BESTSOLFOUND, self)

        def eventexit(self):
            self.model.dropEvent(pyscipopt.SCIP_EVENTTYPE.BESTSOLFOUND, self)

        def eventexec(self, event):
            best.append((self.model.getPrimalbound(), time.perf_counter() - begin))

    best = []
    model.includeEventhdlr(Watch(), "watch", "times of improvements")
    model.setParam("limits/time", seconds)
    begin = time.perf_counter()
    model.optimize()
    total = time.perf_counter() - begin
    objective = model.getPrimalbound()
    proved = model.getStatus() == "optimal"
    when = [t for value, t in best if value <= objective + 1e-9 * abs(objective)]
    return dict(objective=-objective, bound=-model.getDualbound(), proved=proved, total=total,
                best=when[0] if when else total, proof=total if proved else None)


def libmgm(path, seconds):
    """Its own stopping criterion: it has no time limit."""
    del seconds
    import pylibmgm

    sizes, assignments, edges = read(path)
    model = pylibmgm.GmModel(pylibmgm.Graph(0, sizes[0]), pylibmgm.Graph(1, sizes[1]), len(assignments), len(edges))
    for i, j, cost in assignments:
        model.add_assignment(i, j, cost)
    for a, b, cost in edges:
        model.add_edge(a, b, cost)
    begin = time.perf_counter()
    solution = pylibmgm.solver.solve_gm(model)
    total = time.perf_counter() - begin
    return dict(objective=-solution.evaluate(), bound=None, proved=False, total=total, best=total, proof=None)


PEERS = {"HiGHS": highs, "SCIP": scip, "pylibmgm": libmgm}


def salient(path, seconds):
    call = [ROOT / "target/release/examples/matching_file", path, "--seconds", str(seconds), "--json"]
    return json.loads(subprocess.run(call, check=True, capture_output=True, text=True).stdout)


def peer(name, path, seconds):
    """Runs in a process of its own, with the packages installed for it."""
    call = [VENV / "bin/python", __file__, "--peer", name, str(path), "--seconds", str(seconds)]
    done = subprocess.run(call, capture_output=True, text=True)
    if done.returncode:
        print(f"{name}: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
        return None
    return json.loads(done.stdout.strip().splitlines()[-1])


def install():
    call = ["cargo", "build", "--release", "--quiet", "-p", "salient-kernels", "--example", "matching_file"]
    subprocess.run(call, cwd=ROOT, check=True)
    if not (VENV / "installed").exists():
        subprocess.run([sys.executable, "-m", "venv", VENV], check=True)
        subprocess.run([VENV / "bin/pip", "install", "--quiet", *PACKAGES], check=True)
        (VENV / "installed").touch()


def problems(cases, only):
    folder = ROOT / "target/peers/instances"
    folder.mkdir(parents=True, exist_ok=True)
    for kind, size, seeds in cases:
        for seed in seeds:
            path = folder / f"{kind}-{size}-{seed}.dd"
            if only and only not in path.stem:
                continue
            call = [ROOT / "target/release/examples/matching_file", "--make", kind, str(size), str(seed)]
            path.write_bytes(subprocess.run(call, check=True, capture_output=True).stdout)
            yield path


def row(problem, name, result, best_known):
    def seconds(value):
        return "-" if value is None else f"{value:.3f}"

    if result is None or not math.isfinite(result["objective"]):
        return f"| {problem} | {name} | failed | | | | |"
    below = 100 * (best_known - result["objective"]) / abs(best_known)
    # A peer that has found nothing has no relative gap.
    gapless = result["bound"] is None or result["objective"] <= 0
    gap = "-" if gapless else f"{100 * max(0, result['bound'] / result['objective'] - 1):.2f} %"
    # A time to the best known only where it was reached.
    best = result["best"] if below <= 1e-6 else None
    return (f"| {problem} | {name} | {result['objective']:.6f} | {below:.3f} % | {seconds(best)} | "
            f"{seconds(result['proof'])} | {gap} |")


def bench(quick, only, seconds=60, files=()):
    """Prints the table; `quick` takes small problems, `only` those whose name contains it."""
    install()
    paths = [pathlib.Path(f) for f in files] or problems(QUICK if quick else CASES, only)
    print("| problem | solver | objective | below best known | s to best known | s to proof | gap |")
    print("|---|---|---|---|---|---|---|")
    for path in paths:
        print(path.stem, file=sys.stderr)
        results = {"salient": salient(path, seconds)} | {name: peer(name, path, seconds) for name in PEERS}
        best_known = max(r["objective"] for r in results.values() if r)
        for name, result in results.items():
            print(row(path.stem, name, result, best_known), flush=True)
    print()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--peer", choices=PEERS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.peer:
        print(json.dumps(PEERS[args.peer](args.files[0], args.seconds)))
    else:
        bench(args.quick, args.only, args.seconds, args.files)


if __name__ == "__main__":
    main()
