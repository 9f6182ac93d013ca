"""Writes the synthetic database to a folder, as FOLDER/chair/chair-3.off and so on: N individuals of each of 20 families, from 0 or from FIRST.

    python docs/retrieval/database.py FOLDER N[+FIRST] [salient's arguments: --set vertices=2500 --cache DIR ...]
"""
import os
import pathlib
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parents[2]
salient = os.environ.get("SALIENT", str(root / "target/release/salient"))
graph = root / "graphs/synthetic_database.ron"
folder, arguments = pathlib.Path(sys.argv[1]), sys.argv[3:]
count, first = (int(x) for x in (sys.argv[2] + "+0").split("+")[:2])

quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
words = graph.read_text().split('"models": [')[1].split("]")[0].replace(",", " ").replace('"', " ").split()
families = [model.split("-")[0] for model in words if model.endswith("-0")]
models = [f"{family}-{first + i}" for family in families for i in range(count)]
arguments += ["--set", "models=[" + ", ".join(f'"{model}"' for model in models) + "]"]
subprocess.run([salient, "run", graph, *arguments], check=True, **quiet)
for model in models:
    file = folder / model.split("-")[0] / f"{model}.off"
    file.parent.mkdir(parents=True, exist_ok=True)
    subprocess.run([salient, "get", graph, f"mesh[{model}]", "-o", str(file), *arguments], check=True, **quiet)
print(f"{len(models)} models in {folder}")
