"""Writes the synthetic database to a folder, as FOLDER/chair/chair-3.off and so on: N (1 to 20) individuals of each of 20 families.

    python docs/retrieval/database.py FOLDER N [salient's arguments: --set vertices=2500 --cache DIR ...]
"""
import os
import pathlib
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parents[2]
salient = os.environ.get("SALIENT", str(root / "target/release/salient"))
graph = root / "graphs/synthetic_database.ron"
folder, count, arguments = pathlib.Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]

quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
words = graph.read_text().split('"models": [')[1].split("]")[0].replace(",", " ").replace('"', " ").split()
models = [model for model in words if int(model.split("-")[1]) < count]
arguments += ["--set", "models=[" + ", ".join(f'"{model}"' for model in models) + "]"]
subprocess.run([salient, "run", graph, *arguments], check=True, **quiet)
for model in models:
    file = folder / model.split("-")[0] / f"{model}.off"
    file.parent.mkdir(parents=True, exist_ok=True)
    subprocess.run([salient, "get", graph, f"mesh[{model}]", "-o", str(file), *arguments], check=True, **quiet)
print(f"{len(models)} models in {folder}")
