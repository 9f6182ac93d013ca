"""The pairs of poses that settings were chosen on (CHOOSE) and those that are reported (REPORT).

A pair is (object, template, left file, right file, vertices of the decimated right one); paths are relative to the data. No
quadruped is in both lists. CesiumMan, cow and cheburashka are one individual each, so for them the lists have different pairs, of partly the
same poses. Templates that begin with `@` are made by symmetry.py.

The data is ../shared/data beside the repository, or where SALIENT_DATA says.
"""
import os
from pathlib import Path

DATA = Path(os.environ.get("SALIENT_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))


def files(folder, pattern):
    return [str(p.relative_to(DATA)) for p in sorted((DATA / folder).glob(pattern))]


def quadrupeds(species, numbers):
    poses = files(f"quadrupeds/{species}", "*.off")
    rest = f"quadrupeds/{species}/{species}__rest.off"
    return [(species, rest, poses[a], poses[b], 750) for a, b in numbers]


def cesium(numbers):
    poses = files("cesium_man", "*.off")
    return [("CesiumMan", "cesium_man/CesiumMan__rest.off", poses[a], poses[b], 1500) for a, b in numbers]


def numbered(name, template, path, numbers):
    return [(name, template, path % a, path % b, 1500) for a, b in numbers]


def cow(numbers):
    return numbered("cow", "@cow.off", "cow_poses/cow-%d.obj", numbers)


def cheburashka(numbers):
    return numbered("cheburashka", "@cheburashka.off", "cheburashka_poses/cheburashka-%02d.obj", numbers)


def choose():
    own = [(2, 13), (5, 18), (9, 15), (1, 20)]
    pairs = [p for s in ["Horse", "Wolf", "Alpaca", "Husky"] for p in quadrupeds(s, own)]
    return pairs + cesium([(0, 3), (1, 4)]) + cow([(1, 4), (2, 6)]) + cheburashka([(1, 5), (3, 9)])


def report():
    own = [(1, 12), (4, 20), (7, 15), (2, 18), (10, 22), (0, 16), (3, 9)]
    pairs = [p for s in ["Deer", "Donkey", "Fox", "ShibaInu"] for p in quadrupeds(s, own)]
    pairs += cesium([(0, 2), (1, 3), (2, 4), (4, 0)]) + cow([(3, 5), (7, 1), (4, 2), (6, 3), (5, 7)])
    return pairs + cheburashka([(2, 7), (4, 10), (6, 11), (8, 1), (5, 3), (9, 6)])


LISTS = {"choose": choose, "report": report}
