"""Figures of ranked lists, written from the definitions with loops and sets and nothing of ours: retrieval.csv beside this file.

Each line: name, relevance of the list (0 and 1), size of the class, nn, first tier, second tier, E, DCG, AP, recall, 11 precisions.
"""
import math
import random
import pathlib


def figures(relevant, size):
    retrieved = list(range(1, len(relevant) + 1))
    hits = {k for k in retrieved if relevant[k - 1]}

    def recall(k):
        return len({h for h in hits if h <= k}) / size

    def precision(k):
        return len({h for h in hits if h <= k}) / k

    page = min(32, len(relevant))
    p, r = (precision(page), recall(page)) if page else (0, 0)
    gains, ideal = 0.0, 0.0
    for k in retrieved:
        gains += (1 if k in hits else 0) / (1 if k == 1 else math.log2(k))
    for k in range(1, size + 1):
        ideal += 1 / (1 if k == 1 else math.log2(k))
    curve = []
    for level in range(11):
        reached = [precision(k) for k in retrieved if recall(k) * 10 >= level - 1e-9]
        curve.append(max(reached) if reached else 0.0)
    return [
        1.0 if 1 in hits else 0.0,
        recall(min(size, len(relevant))),
        recall(min(2 * size, len(relevant))),
        2 / (1 / p + 1 / r) if p and r else 0.0,
        gains / ideal,
        sum(precision(h) for h in hits) / size,
        recall(len(relevant)),
        *curve,
    ]


random.seed(7)
lines = []
for case in range(60):
    length = random.choice([1, 3, 10, 33, 64, 100])
    size = random.randint(1, min(length, 24))
    hits = set(random.sample(range(length), random.randint(0, size)))
    if case % 3 == 0:  # mostly good lists
        hits = {k for k in range(size) if random.random() < 0.8}
    relevant = [k in hits for k in range(length)]
    text = "".join("1" if x else "0" for x in relevant)
    lines.append(",".join([f"case{case}", text, str(size), *(repr(float(x)) for x in figures(relevant, size))]))
pathlib.Path(__file__).with_suffix(".csv").write_text("\n".join(lines) + "\n")
