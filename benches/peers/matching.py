"""Matching: `salient` against other solvers of the quadratic assignment problem. The place is kept: fill `bench`."""


def bench(quick):
    """Prints the table of ratios; `quick` asks for a few small instances. Use `runner.alternating`, `runner.run` and `runner.table`."""
    del quick
    print("No peers yet.\n")
