"""Runs the comparisons asked for, and prints their tables: see README.md."""
import argparse
import os
import platform
import subprocess

import eigen
import geodesics
import matching
import patches
from runner import ROOT, configure, data_folder

SECTIONS = {"eigen": eigen.bench, "patches": patches.bench, "geodesics": geodesics.bench, "matching": matching.bench}


def output(*command):
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT).stdout.strip()


def machine():
    with open("/proc/cpuinfo") as info:
        model = next((line.split(":")[1].strip() for line in info if line.startswith("model name")), platform.machine())
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    commit = output("git", "describe", "--always", "--dirty")
    print(f"{model}, {os.cpu_count()} cores, {memory:.0f} GB; {output('rustc', '--version')}; salient {commit}; "
          f"real meshes: {'present' if data_folder() else 'absent'}\n")


def main():
    parser = argparse.ArgumentParser(prog="run", description="salient against its peers, in turn, on this machine")
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"any of {', '.join(SECTIONS)}; all if none is named")
    parser.add_argument("--quick", action="store_true", help="small problems and few rounds")
    parser.add_argument("--only", default="", metavar="TEXT", help="only cases whose fields, joined by /, contain it: creature-10k/300")
    parser.add_argument("--wrap", default="", metavar="COMMAND", help="what starts every measured process: 'taskset -c 0'")
    parser.add_argument("--rounds", type=int, default=1000, metavar="N", help="at most N runs of each")
    arguments = parser.parse_args()
    configure(arguments.wrap, arguments.rounds)
    unknown = set(arguments.sections) - set(SECTIONS)
    if unknown:
        parser.error(f"unknown section {', '.join(sorted(unknown))}; there are {', '.join(SECTIONS)}")
    machine()
    for name in arguments.sections or SECTIONS:
        print(f"## {name}\n")
        SECTIONS[name](arguments.quick, arguments.only)


if __name__ == "__main__":
    main()
