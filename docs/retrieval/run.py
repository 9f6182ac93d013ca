"""The tables of docs/accuracy.md on retrieval.

    python docs/retrieval/run.py 'FOLDER/*/*.off' NAME,NAME,... [salient's arguments]

Classes are folders; NAMEs restrict it to these classes (`all`: every one).
"""
import glob
import json
import os
import pathlib
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parents[2]
salient = os.environ.get("SALIENT", str(root / "target/release/salient"))
graph = str(root / "graphs/retrieval.ron")
pattern, classes, arguments = sys.argv[1], sys.argv[2], sys.argv[3:]
if classes == "all":
    patterns = [pattern]
else:
    patterns = [pattern.replace("*/*", f"{name}/*") for name in classes.split(",")]
assert all(glob.glob(p) for p in patterns), patterns
shapes = "shapes=files(" + ", ".join(f'"{os.path.abspath(p)}"' for p in patterns) + ")"
rows = {
    "default": "metrics", "fused alone": "fused_metrics", "salient features": "salient_metrics", "ShapeDNA": "dna_metrics",
    "WKS, bag of features": "bag_metrics", "WKS, quantiles": "wave_metrics", "HKS, quantiles": "heat_metrics",
    "panoramas": "panorama_metrics", "views": "view_metrics", "spherical harmonics": "volume_metrics",
}
print("| by | NN | first tier | second tier | E | DCG | mAP |\n|---|---|---|---|---|---|---|")
for title, node in rows.items():
    call = [salient, "get", graph, node, "--format", "json", "--set", shapes, *arguments]
    m = json.loads(subprocess.run(call, check=True, capture_output=True).stdout)
    figures = [m[key] for key in ("nn", "first_tier", "second_tier", "e", "dcg", "map")]
    print(f"| {title} | " + " | ".join(f"{x:.3f}" for x in figures) + " |", flush=True)
