"""Writes the synthetic database to a folder, as FOLDER/chair/chair-3.off and so on.

    python docs/retrieval/database.py FOLDER [salient run's arguments: --set vertices=2500 --cache DIR ...]
"""
import os
import pathlib
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parents[2]
salient = os.environ.get("SALIENT", str(root / "target/release/salient"))
graph = str(root / "graphs/synthetic_database.ron")
folder, arguments = pathlib.Path(sys.argv[1]), sys.argv[2:]

subprocess.run([salient, "run", graph, "--keep-going", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
text = pathlib.Path(graph).read_text()
models = [word for word in text.split('"models": [')[1].split("]")[0].replace('"', " ").replace(",", " ").split()]
for model in models:
    file = folder / model.split("-")[0] / f"{model}.off"
    file.parent.mkdir(parents=True, exist_ok=True)
    subprocess.run([salient, "get", graph, f"mesh[{model}]", "-o", str(file), *arguments], check=True, stderr=subprocess.DEVNULL)
print(f"{len(models)} models in {folder}")
