"""Accuracy over many pairs of poses: the tables of docs/accuracy.md.

    python docs/accuracy/symmetry.py target/accuracy        # once: templates of cow and cheburashka
    python docs/accuracy/run.py report whole                # or: choose; part
    python docs/accuracy/run.py report whole --set match.agreement=0.5   # anything that `salient run` takes

Reads ../shared/data (or SALIENT_DATA), runs target/release/salient on graphs/evaluate_pair.ron or evaluate_part.ron, and keeps results and cache
in target/accuracy. Needs Python alone.
"""
import json
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

from pairs import DATA, LISTS

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / "target" / "accuracy"
DIRECTIONS = ["(0, 0, 1)", "(0, 1, 0)", "(1, 0, 0)", "(0, 0, -1)"]


def run(graph, pair, extra):
    name, template, a, b, vertices = pair
    template = WORK / template[1:] if template.startswith("@") else DATA / template
    sets = [f'a.path="{DATA / a}"', f'b.path="{DATA / b}"', f'template.path="{template}"', f"small.vertices={vertices}"]
    if template.parent == WORK:
        evaluations = ["as_found", "accuracy"] + (["repeat"] if "pair" in graph else [])
        sets += [f"{node}.mirror=X" for node in evaluations]
    out = WORK / "out"
    command = [ROOT / "target/release/salient", "run", ROOT / "graphs" / graph, "--out", out, "--cache", WORK / "cache"]
    done = subprocess.run(command + [x for s in sets for x in ("--set", s)] + extra, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stderr)
    nodes = ["match", "oriented", "as_found", "accuracy", "repeat"]
    return {n: json.loads((out / f"{n}.json").read_text()) for n in nodes if n != "repeat" or "pair" in graph}


def row(result):
    match, found, accuracy = result["match"], result["as_found"], result["accuracy"]
    figures = {"matches": found["matched"], "twin ratio": 0.0 if match["twin"] is None else match["twin"]["objective"] / match["objective"]}
    figures["gap"] = match["gap"] / abs(match["objective"]) if match["objective"] else 0.0
    for prefix, of in [("found", found), ("oriented", accuracy)]:
        plain, symmetric = of["plain"], of["symmetric"]
        for key in ["within_5", "within_10", "within_25", "auc"]:
            figures[f"{prefix} plain {key}"] = plain[key] if plain else 0.0
            figures[f"{prefix} symmetric {key}"] = symmetric[key] if symmetric else 0.0
    figures["orientation"] = [result["oriented"]["orientation"][key] for key in ["own", "twin", "exchanged"]]
    if "repeat" in result:
        r = result["repeat"]
        for key in ["position", "position_scale"]:
            figures[f"{key}"], figures[f"{key} chance"] = r[key]["repeated"], r[key]["chance"]
    return figures


def mean(rows, key):
    return sum(r[key] for r in rows) / len(rows)



def table(rows, repeat):
    head = ["object", "pairs", "matches (least)", "up to symmetry: 5 %", "10 % (worst)", "25 %", "AUC", "as it is: 10 %", "oriented: 10 %"]
    head += ["position (chance)", "and scale (chance)"] if repeat else []
    print("|", " | ".join(head), "|")
    print("|" + "---|" * len(head))
    objects = list(dict.fromkeys(rows))
    everything = [r for name in objects for r in rows[name]]
    for name, of in [(n, rows[n]) for n in objects] + [("all pairs", everything)]:
        p = lambda key: f"{100 * mean(of, key):.0f} %"
        cells = [name, str(len(of)), f"{mean(of, 'matches'):.1f} ({min(r['matches'] for r in of)})", p("found symmetric within_5")]
        worst = min(r["found symmetric within_10"] for r in of)
        cells += [f"{p('found symmetric within_10')} ({100 * worst:.0f} %)", p("found symmetric within_25"), f"{mean(of, 'found symmetric auc'):.2f}"]
        cells += [p("found plain within_10"), p("oriented plain within_10")]
        if repeat:
            cells += [f"{mean(of, k):.2f} ({mean(of, k + ' chance'):.2f})" for k in ["position", "position_scale"]]
        print("|", " | ".join(cells), "|")
    print(f"\nmean gap {100 * mean(everything, 'gap'):.2f} %, mean objective of the twin {100 * mean(everything, 'twin ratio'):.1f} % of the match's")


def main():
    which, kind, extra = sys.argv[1], sys.argv[2], sys.argv[3:]
    rows = defaultdict(list)
    for number, pair in enumerate(LISTS[which]()):
        if kind == "whole":
            rows[pair[0]].append(row(run("evaluate_pair.ron", pair, extra)))
        else:
            direction = DIRECTIONS[number % len(DIRECTIONS)]
            rows[pair[0]].append(row(run("evaluate_part.ron", pair, ["--set", f"part.toward={direction}"] + extra)))
        print(".", end="", file=sys.stderr, flush=True)
    (WORK / f"{which}-{kind}.json").write_text(json.dumps(rows, indent=1))
    table(rows, kind == "whole")


main()
