#!/usr/bin/env python3
"""Makes the README's tables of results for the reference arm: runs the shipped studies, and writes each table between its marks in the README.

    python3 data/gallery/tables.py [--sinew target/release/sinew] [NAME ...]

Needs pandas and pyarrow.
"""

import argparse
import pathlib
import re
import subprocess
import tempfile

import pandas as pd

ROOT = pathlib.Path(__file__).resolve().parents[2]
GRIDS = {"measurement": "measured instants", "collocation": "collocation points"}
BOUNDS = ["activation", "excitation", "both"]
# Deficiencies of A and of [Aᵀ Jᵀ] (thesis, Paper B, Table 1).
THESIS = {
    "measurement": [(0, 1), (0, 0), (10, 2)],
    "collocation": [(0, 6), (0, 2), (6, 1)],
}


class Results:
    """Runs a study once and reads its tables."""

    def __init__(self, sinew, folder):
        self.sinew, self.folder = sinew, pathlib.Path(folder)

    def run(self, name, study=None):
        if not (self.folder / name).exists():
            study = study or ROOT / f"studies/{name}.toml"
            subprocess.run([self.sinew, "run", study, "--out", self.folder / name], capture_output=True)
        return self.folder / name

    def read(self, name, *tables):
        whole = pd.read_parquet(self.run(name) / "jobs.parquet")
        for table in tables:
            more = pd.read_parquet(self.folder / name / f"{table}.parquet")
            whole = whole.merge(more[["job_id", *(set(more) - set(whole))]], on="job_id")
        return whole.sort_values("index", kind="stable")


def minus(count):
    return f"−{count}" if count else "0"


def cell(found, predicted, thesis):
    word = "" if found == predicted else f", predicted {minus(predicted)}"
    number = minus(found) if found == thesis else f"**{minus(found)}**"
    return f"{number}{word} ({minus(thesis)})"


def table1(results, name):
    rows = results.read(name, "regularity")
    rows = rows[rows.h == 0.2] if "h" in rows else rows
    lines, counted, predicted, ambiguous = ["| load sharing at | | a ≥ 0 | u ≥ 0 | u, a ≥ 0 |", "|---|---|---|---|---|"], 0, 0, 0
    for grid, title in GRIDS.items():
        for k, (matrix, column) in enumerate([("A", "deficiency_a"), ("[Aᵀ Jᵀ]", "deficiency_aj")]):
            cells = []
            for bounds, thesis in zip(BOUNDS, THESIS[grid]):
                row = rows[(rows.load_sharing_grid == grid) & (rows.bounds == bounds)].iloc[0]
                cells.append(cell(row[column], row[f"predicted_{column}"], thesis[k]))
                counted += row[column] == thesis[k]
                predicted += row[f"predicted_{column}"] == thesis[k]
                ambiguous += k == 0 and bool(row.ambiguous)
            lines.append(f"|{'' if k else f' {title}'} | {matrix} | {' | '.join(cells)} |")
    agree = int(rows.prediction_agrees.sum())
    lines += ["", f"**{counted} of the 12 numbers are the thesis' as counted, {predicted} as predicted.** `ambiguous` in {ambiguous} of 6 cases; `prediction_agrees` in {agree}."]
    return lines


def among(values):
    return ", ".join(minus(value) for value in sorted({int(value) for value in values.dropna()}))


def optima(results):
    rows = results.read("optima").merge(pd.read_parquet(results.run("optima") / "optima.parquet"), on="job_id", suffixes=("_of_job", ""))
    lines = ["| scheme, h | load sharing at | a ≥ 0 | u ≥ 0 | u, a ≥ 0 |", "|---|---|---|---|---|"]
    for scheme in ["midpoint", "radau"]:
        for h in [0.2, 0.1]:
            for grid, title in GRIDS.items():
                cells = []
                for bounds in BOUNDS:
                    of = rows[(rows.scheme == scheme) & (rows.h == h) & (rows.load_sharing_grid == grid) & (rows.bounds == bounds)]
                    values = [f"{1000 * value:.3g}" for value in sorted(of.objective)]
                    values = ", ".join(values) if len(values) < 3 else f"{values[0]} … {values[-1]}"
                    cells.append(f"{len(of)}: {values}; {among(of.deficiency_a)}; {among(of.deficiency_aj)}")
                place = f"{scheme}, {h}" if grid == "measurement" else ""
                lines.append(f"|{f' {place}' if place else ''} | {title} | {' | '.join(cells)} |")
    return lines


def ringing(results):
    jobs = results.read("ringing").set_index("job_id")
    muscles = pd.read_parquet(results.run("ringing") / "muscles.parquet").set_index("job_id")
    lines = ["| scheme | h, s | effort ∫Σa² dt, s | tracking RMS, mm | biceps : brachialis, mean N | turns of l̇_m | peak \\|l̇_m\\|, 1/s |", "|---|---|---|---|---|---|---|"]
    before = None
    order = jobs.assign(scheme_at=jobs.scheme.map({"midpoint": 0, "radau": 1})).sort_values(["scheme_at", "stages", "h"], ascending=[True, True, False])
    for job, row in order.iterrows():
        of = muscles.loc[job].set_index("muscle")
        name = row.scheme if row.scheme == "midpoint" else f"radau, {row.stages} stage{'s' if row.stages > 1 else ''}"
        peak = of.peak_fibre_velocity_per_s.max()
        peak = f"{peak:,.0f}" if peak > 100 else f"{peak:.3g}"
        lines.append(
            f"|{f' {name}' if name != before else ''} | {row.h:g} | {row.effort:.4f} | {1000 * row.tracking_rms_m:.2f} "
            f"| {of.mean_force_n['biceps']:.1f} : {of.mean_force_n['brachialis']:.1f} | {100 * of.direction_changes.mean():.0f} % | {peak} |"
        )
        before = name
    return lines


def convergence(results):
    text = (ROOT / "studies/arm_search/sample.toml").read_text().replace("../../", f"{ROOT}/")
    sample = results.folder / "arm_sample.toml"
    sample.write_text(re.sub(r"\ncount = \d+", "\ncount = 40", text))
    results.run("arm_sample", sample)
    kinds = [
        ("table1", "`table1` (midpoint)"),
        ("table1_radau", "`table1_radau`: its cases by radau, 1 to 3 stages, h = 0.2 to 0.05"),
        ("arm_sample", "random arms (40 of `arm_search/sample.toml`, midpoint)"),
        ("robustness", "`robustness`: μ over four decades, both schemes, all bounds, noise, disturbed starts"),
    ]
    lines = ["| what | jobs | converged | median iterations |", "|---|---|---|---|"]
    for name, title in kinds:
        jobs = results.read(name)
        lines.append(f"| {title} | {len(jobs)} | {(jobs.status == 'converged').sum()} | {jobs.iterations.median():g} |")
    return lines


TABLES = {
    "table1": lambda results: table1(results, "table1"),
    "table1_starts": lambda results: table1(results, "table1_starts"),
    "table1_starts_variant": lambda results: table1(results, "table1_starts_variant"),
    "optima": optima,
    "ringing": ringing,
    "convergence": convergence,
}


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("names", nargs="*", metavar="NAME", help=f"of: {', '.join(TABLES)}")
    options.add_argument("--sinew", default=ROOT / "target/release/sinew")
    options = options.parse_args()
    readme = ROOT / "README.md"
    with tempfile.TemporaryDirectory() as folder:
        results = Results(options.sinew, folder)
        for name in options.names or TABLES:
            lines = "\n".join(TABLES[name](results))
            mark = rf"(<!-- table {name} -->\n).*?(<!-- end -->)"
            text, count = re.subn(mark, lambda found: f"{found[1]}{lines}\n{found[2]}", readme.read_text(), flags=re.DOTALL)
            if count != 1:
                raise SystemExit(f"the README has {count} marks for {name}")
            readme.write_text(text)
            print(name, flush=True)


if __name__ == "__main__":
    main()
