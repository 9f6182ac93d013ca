"""Matching: `salient` against other solvers of the quadratic assignment problem. The place is kept: fill `bench`."""


def bench(quick, only):
    """Prints the table of ratios; `quick` asks for a few small instances, `only` for those whose name contains it.
    Use `runner.alternating`, `runner.run` and `runner.table`."""
    del quick, only
    print("No peers yet.\n")
