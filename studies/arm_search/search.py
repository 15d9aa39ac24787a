#!/usr/bin/env python3
"""Searches for an arm that reproduces all twelve numbers of the thesis' Table 1, counted and predicted: a seeded evolution of arms using Sinew studies.

    python3 studies/arm_search/search.py [--near] [--seed 1] [--sinew target/release/sinew] [--out results/arm_search]

The first generation is drawn from the ranges of sample.toml; each later one varies the best arms so far. Every arm takes six jobs, the cells
of Table 1, from one start. The search ends with the first arm that has 12 and 12, and prints it with the names of sample.toml. Needs pyarrow.
"""

import argparse
import collections
import pathlib
import random
import subprocess
import sys
import time
import tomllib

import pyarrow.parquet as parquet

HERE = pathlib.Path(__file__).resolve().parent
DATA = HERE.parent.parent / "data"
# Deficiencies of A and of [Aᵀ Jᵀ] by load-sharing grid and bounds (thesis, Paper B, Table 1).
THESIS = {
    ("measurement", "activation"): (0, 1),
    ("measurement", "excitation"): (0, 0),
    ("measurement", "both"): (10, 2),
    ("collocation", "activation"): (0, 6),
    ("collocation", "excitation"): (0, 2),
    ("collocation", "both"): (6, 1),
}
FIRST, LATER = 600, 240
# Number of arms kept for each set of correct cases, so that an arm that solves a rare case survives although it fails in others.
KEPT = 4
# Step sizes as fractions of a range, and fractions of the numbers that a child changes.
STEPS, CHANGED = (0.3, 0.1, 0.03, 0.01), (0.1, 0.3, 1.0)


def study(name, arms):
    """The study of these arms: each is an entry of the list, multiplied by the six cells."""
    lines = [
        f'name = "{name}"',
        f'model = "{DATA}/models/arm_nominal.toml"',
        f'motion = "{DATA}/motions/arm_curl_nominal.csv"',
        '[base]\nmu = 0.2\nscheme = "midpoint"\nh = 0.2\nregularity = "optimum"\ntime_limit_s = 20.0',
    ]
    for arm in arms:
        lines.append("[[sweep.list]]")
        lines += [f'"{path}" = {value!r}' for path, value in arm.items()]
    lines.append('[sweep.grid]\nload_sharing_grid = ["measurement", "collocation"]\nbounds = ["activation", "excitation", "both"]')
    return "\n".join(lines) + "\n"


def solved(sinew, folder, arms):
    """(score, counted, predicted, correct cases) of each arm. The score also takes into account how far off a number is."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "study.toml").write_text(study(folder.name, arms))
    run = subprocess.run([sinew, "run", folder / "study.toml", "--out", folder], capture_output=True, text=True)
    if run.returncode not in (0, 1):
        sys.exit(run.stderr)
    jobs = parquet.read_table(folder / "jobs.parquet", columns=["job_id", "index", "load_sharing_grid", "bounds"]).to_pylist()
    names = ["deficiency_a", "deficiency_aj", "predicted_deficiency_a", "predicted_deficiency_aj"]
    rows = parquet.read_table(folder / "regularity.parquet", columns=["job_id", *names]).to_pylist()
    ranks = {row["job_id"]: row for row in rows}
    found = [[0.0, 0, 0, frozenset()] for _ in arms]
    for job in jobs:
        one = found[job["index"] // len(THESIS)]
        case = job["load_sharing_grid"], job["bounds"]
        row, wanted = ranks.get(job["job_id"], {}), THESIS[case] * 2
        if all(row.get(name) == number for name, number in zip(names, wanted)):
            one[3] |= {case}
        for k, (name, number) in enumerate(zip(names, wanted)):
            rank = row.get(name)
            off = 9 if rank is None else abs(rank - number)
            one[1 + k // 2] += off == 0
            # The predicted numbers count twice: once they are right, small steps lead to the counted ones.
            one[0] += (1 + k // 2) * ((off == 0) - 0.1 * min(off, 9))
    return found


def number(model, path):
    place = model
    for key in path.split("."):
        if isinstance(place, list):
            place = next((item for item in place if isinstance(item, dict) and item.get("name") == key), None) or place[int(key)]
        else:
            place = place[key]
    return place


def ends(name):
    """First and last row of a motion: time, shoulder, elbow."""
    rows = [line for line in (DATA / f"motions/{name}.csv").read_text().splitlines() if line[0].isdigit()]
    return [[float(field) for field in rows[k].split(",")] for k in (0, -1)]


def shipped(ranges):
    """The reference arm, with the names of sample.toml."""
    arm, nominal = (tomllib.loads((DATA / f"models/{name}.toml").read_text()) for name in ("arm", "arm_nominal"))
    (first, last), (first_then, last_then) = ends("arm_curl"), ends("arm_curl_nominal")
    found = {}
    for path in ranges:
        if path.startswith("motion."):
            k = 1 if "shoulder" in path else 2
            scale = (last[k] - first[k]) / (last_then[k] - first_then[k])
            found[path] = scale if path.endswith("_scale") else first[k] - first_then[k]
        elif path.endswith("_scale"):
            path_of = path.removesuffix("_scale")
            found[path] = number(arm, path_of) / number(nominal, path_of)
        else:
            found[path] = number(arm, path)
    return found


def child(kept, shares, ranges, rng):
    rights = sorted(kept, key=sorted)
    # Rare cases have more weight, or the arms that solve them die out.
    weights = [2 ** len(right) * (1 + sum(1 / shares[case] for case in right)) for right in rights]
    parent, other = (rng.choice(kept[right])[1] for right in rng.choices(rights, weights, k=2))
    step, share = rng.choice(STEPS), rng.choice(CHANGED)
    # Occasionally mix in a part of another arm.
    arm = {path: (other if rng.random() < 0.3 else parent)[path] for path in parent} if rng.random() < 0.2 else dict(parent)
    return varied(arm, ranges, step, rng.sample(list(ranges), max(1, round(share * len(ranges)))), rng)


def varied(arm, ranges, step, paths, rng):
    """The arm with random steps of the given numbers, within their ranges."""
    arm = dict(arm)
    for path in paths:
        low, high = ranges[path]
        arm[path] = min(high, max(low, arm[path] + rng.gauss(0.0, step) * (high - low)))
    return arm


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--sinew", default="target/release/sinew")
    options.add_argument("--out", type=pathlib.Path, default=pathlib.Path("results/arm_search"))
    options.add_argument("--near", action="store_true", help="begin near the reference arm instead of anywhere in the ranges")
    options.add_argument("--minutes", type=float, default=60.0, help="give up after this time")
    options = options.parse_args()
    sample = tomllib.loads((HERE / "sample.toml").read_text())["sweep"]["sample"]
    ranges = {path: (r["from"], r["to"]) for path, r in sample.items() if isinstance(r, dict)}
    rng, begun, tried, kept = random.Random(options.seed), time.monotonic(), 0, {}
    solved_cases = collections.Counter()
    if options.near:
        # Start from a fraction of each range around the shipped arm, not from the arm itself.
        centre = shipped(ranges)
        arms = [varied(centre, ranges, 0.02, list(ranges), rng) for _ in range(FIRST)]
    else:
        arms = [{path: rng.uniform(*ends) for path, ends in ranges.items()} for _ in range(FIRST)]
    for generation in range(10_000):
        found = solved(options.sinew, options.out / f"seed-{options.seed}-{generation:03}", arms)
        tried += len(arms)
        for one in zip(found, arms):
            right = one[0][3]
            solved_cases.update(right)
            kept[right] = sorted([*kept.get(right, []), one], key=lambda one: one[0][0], reverse=True)[:KEPT]
        (_, counted, predicted, _), arm = max((one for some in kept.values() for one in some), key=lambda one: one[0][0])
        minutes = (time.monotonic() - begun) / 60
        print(f"{tried} arms, {minutes:.1f} min: best {counted} counted, {predicted} predicted", flush=True)
        if (counted, predicted) == (12, 12):
            print("\n".join(f'"{path}" = {value!r}' for path, value in arm.items()))
            return
        if minutes > options.minutes:
            sys.exit("not found; try another --seed")
        shares = {case: count / tried for case, count in solved_cases.items()}
        arms = [child(kept, shares, ranges, rng) for _ in range(LATER)]


if __name__ == "__main__":
    main()
