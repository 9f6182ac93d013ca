"""Runs measured solves, each in a process of its own, in turn; and prints tables."""
import json
import os
import pathlib
import shlex
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
HERE = ROOT / "benches" / "peers"
WORK = ROOT / "target" / "peers"
DATA = ROOT.parent / "shared" / "data"
SALIENT = ROOT / "target" / "release" / "examples" / "peers"
VENV_PYTHON = WORK / "venv" / "bin" / "python"
DEBIAN_PYTHON = pathlib.Path("/usr/bin/python3")  # slepc4py of Debian works in Debian's interpreter only


def data_folder():
    """Where the real meshes lie, or None: `SALIENT_DATA`, else beside the repository."""
    folder = pathlib.Path(os.environ.get("SALIENT_DATA", DATA))
    return folder if folder.is_dir() else None


def environment(threads):
    """The number of threads, told to every library that could start some. OpenBLAS of 2022 takes recent processors with AVX-512 for older
    ones; it is told better, because that makes the peers faster."""
    count = str(threads)
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    env = {**os.environ, **dict.fromkeys(names, count), "PYTHONDONTWRITEBYTECODE": "1"}
    if "avx512dq" in pathlib.Path("/proc/cpuinfo").read_text():
        env.setdefault("OPENBLAS_CORETYPE", "SkylakeX")
    return env


#: No job is run more often than this: `--rounds`.
most_rounds = 1000

#: Words put before every measured process: `--wrap "taskset -c 0"`.
wrap = []


def configure(words, rounds):
    """From now on every measured process is started by `words`, and no job is run more than `rounds` times."""
    global most_rounds
    wrap[:], most_rounds = shlex.split(words), rounds


class Failed(Exception):
    """A solver did not deliver; the message is its own."""


def run(command, threads, timeout=1800, preparation=False):
    """Runs one process, measured unless it is a preparation; the object that its last line of output holds."""
    try:
        done = subprocess.run(
            [*([] if preparation else wrap), *(str(word) for word in command)], env=environment(threads), capture_output=True, text=True, timeout=timeout
        )
    except subprocess.TimeoutExpired:
        raise Failed(f"longer than {timeout} s") from None
    lines = done.stdout.strip().splitlines()
    if done.returncode != 0 or not lines:
        raise Failed((done.stderr.strip() or "no output").splitlines()[-1])
    return json.loads(lines[-1])


def alternating(jobs, rounds):
    """Runs every job once per round, in turn, and keeps each one's fastest run. `jobs` maps a name to a function without
    arguments that returns a dict with `wall`. Failed ones map to their `Failed`."""
    best = {}
    for _ in range(min(rounds, most_rounds)):
        for name, job in jobs.items():
            if isinstance(best.get(name), Failed):
                continue
            try:
                result = job()
            except Failed as error:
                result = error
            old = best.get(name)
            if old is None or isinstance(result, Failed) or result["wall"] < old["wall"]:
                best[name] = result
    return best


def chosen(cases, only):
    """The cases whose fields, joined by `/`, contain `only`."""
    return [case for case in cases if only in "/".join(map(str, case))]


def seconds(value):
    return f"{value:.3g} s" if value >= 0.1 else f"{1000 * value:.3g} ms"


def megabytes(value):
    return f"{value / 2**20:.0f} MB"


def table(head, rows):
    """Prints a markdown table as it grows: `rows` may be a generator."""
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head), flush=True)
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)
    print()


def note(text):
    """Progress, on standard error, so that standard output holds the tables alone."""
    print(text, file=sys.stderr, flush=True)
