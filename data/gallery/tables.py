#!/usr/bin/env python3
"""The READMEs' tables of results, from the shipped studies: runs the studies, and writes each table between its marks.

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


def abduction(results):
    rows = results.read("abduction").merge(pd.read_parquet(results.run("abduction") / "ratios.parquet").drop(columns="status"), on="job_id")
    rows = rows[(rows.measure == "mean_force") & (rows.mu == 0.2)]
    strength, offset = "muscle.TeresMajor.max_isometric_force", "motion.abduction_offset_deg"
    offsets = sorted(rows[offset].unique())
    lines = [f"| girdle | strength of teres major, N | {' | '.join(f'{value:g}°' for value in offsets)} |", "|---" * (2 + len(offsets)) + "|"]
    for girdle in ["fixed", "given", "free"]:
        for force, of in rows[rows["body.clavicle,scapula.role"] == girdle].groupby(strength):
            values = of.set_index(offset).value
            lines.append(f"| {girdle} | {force:g} | {' | '.join(f'{values[value]:.2f}' for value in offsets)} |")
    jobs = results.read("abduction")
    converged = results.read("abduction", "regularity")
    converged = converged[converged.status == "converged"]
    lines += ["", f"{len(converged)} of {len(jobs)} jobs converge; loads are unique in {int(converged.loads_unique.sum())}; {int(jobs.warnings.notna().sum())} have warnings."]
    return lines


def pectoralis(results):
    slack, name = "muscle.PectoralisMajor*.tendon_slack_length_scale", "pectoralis_slack"
    rows = results.read(name).merge(pd.read_parquet(results.run(name) / "muscles.parquet").drop(columns="status"), on="job_id")
    for axis, value in [("body.clavicle,scapula.role", "free"), ("mu", 0.1)]:
        rows = rows[rows[axis] == value] if axis in rows else rows
    force = rows.pivot_table(index="muscle", columns=slack, values="mean_force_n")
    change = (force[0.85] - force[1.0]).sort_values(key=abs, ascending=False)
    lines = ["| muscle | mean force, N | change, N | change |", "|---|---|---|---|"]
    for muscle, value in change.head(8).items():
        before = force[1.0][muscle]
        share = f"{100 * value / before:+.1f} %" if before else ""
        lines.append(f"| {muscle} | {before:.2f} | {value:+.2f} | {share} |")
    return lines


def arm26(results):
    jobs = results.read("arm26")
    jobs = jobs[(jobs.scheme == "radau") & (jobs.mu == 0.05)]
    rows = jobs.merge(pd.read_parquet(results.run("arm26") / "muscles.parquet").drop(columns="status"), on="job_id")
    peaks = rows.pivot_table(index="muscle", columns="muscle.TRIlong.max_isometric_force_scale", values="peak_activation")
    opensim = pd.read_csv(ROOT / "data/arm26_static_optimization.csv", comment="#").set_index("muscle").iloc[:, 0]
    order = opensim.sort_values(ascending=False).index
    row = lambda title, values: f"| {title} | {' | '.join(f'{round(values[muscle], 3) + 0:.3f}' for muscle in order)} |"
    return [
        f"| | {' | '.join(order)} |",
        "|---" * (1 + len(order)) + "|",
        row("OpenSim, static optimisation, no passive forces", opensim),
        row("Sinew", peaks[1.0]),
        row("Sinew, strength of TRIlong × 0.02", peaks[0.02]),
    ]


def methods(results):
    jobs = results.read("methods_arm")
    ranks = pd.read_parquet(results.folder / "methods_arm/regularity.parquet")[["job_id", "loads_unique"]]
    jobs = jobs.merge(ranks, on="job_id", how="left")
    jobs = jobs[(jobs.effort_of == "activation") & ((jobs.method == "static") | (jobs.effort_power == 2))]
    muscles = pd.read_parquet(results.folder / "methods_arm/muscles.parquet").set_index(["job_id", "muscle"])
    names = ["biceps", "brachialis", "deltoid_anterior"]
    lines = [f"| method | muscles | criterion | loads unique | {', '.join(names)}: mean force, N |", "|---" * 5 + "|"]
    for _, job in jobs.iterrows():
        def force(name):
            row = muscles.loc[(job.job_id, name)]
            near = row.mean_force_near_low_n, row.mean_force_near_high_n
            return f"{row.mean_force_n:.1f}" + (f" ({near[0]:.1f} to {near[1]:.1f})" if pd.notna(near[0]) else "")
        # Without ranks, by the intervals of mean activations over equally good answers.
        own = muscles.loc[job.job_id]
        is_closed = (own.mean_activation_high - own.mean_activation_low).max() < 1e-6
        criterion = "min/max" if job.criterion == "min_max" else f"p = {job.effort_power:g}"
        unique = "yes" if (is_closed if pd.isna(job.loads_unique) else job.loads_unique) else "no"
        lines.append(f"| {job.method} | {job.muscle_dynamics} | {criterion} | {unique} | {', '.join(map(force, names))} |")
    return lines


def table1_methods(results):
    rows = results.read("table1_methods", "regularity")
    lines = ["| scheme | h, s | μ = 0, eq. (1.7): [Aᵀ Jᵀ], predicted | μ = 0.2, eq. (1.8) |", "|---" * 4 + "|"]
    for (scheme, h), own in rows.groupby(["scheme", "h"], sort=False):
        def ranks(mu):
            row = own[own.mu == mu].iloc[0]
            predicted = "–" if pd.isna(row.predicted_deficiency_aj) else minus(int(row.predicted_deficiency_aj))
            return f"{minus(row.deficiency_aj)}, {predicted}: loads {'unique' if row.loads_unique else 'open'}"
        lines.append(f"| {scheme} | {h} | {ranks(0)} | {ranks(0.2)} |")
    return lines


MOST_TRACKING_DEG = 2


def tracks(job):
    """Whether a job follows the motion closely enough to say anything about it."""
    return job.status == "converged" and not job.tracking_rms_deg > MOST_TRACKING_DEG


def criterion_of(keys):
    return "min/max" if keys[0] == "min_max" else f"p = {keys[1]:g}"


def abduction_methods(results):
    jobs = results.read("abduction_methods")
    ratios = pd.read_parquet(results.folder / "abduction_methods/ratios.parquet").set_index("job_id").value
    muscles = pd.read_parquet(results.folder / "abduction_methods/muscles.parquet").set_index("job_id")
    girdle, angle = "body.clavicle,scapula.role", "motion.abduction_offset_deg"

    def limits(job):
        own = muscles.loc[job]
        teres, latissimus = own[own.muscle == "TeresMajor"], own[own.muscle.str.startswith("LatissimusDorsi")]
        low, high = "mean_force_near_low_n", "mean_force_near_high_n"
        if pd.concat([teres, latissimus])[low].isna().any():
            return None
        return teres[low].sum() / latissimus[high].sum(), teres[high].sum() / max(latissimus[low].sum(), 1e-9)

    lines = ["| girdle | method | muscles | criterion | −10° | 5° | 20° | with abduction the ratio | within 5 % of the effort |"]
    lines.append("|---" * 9 + "|")
    for keys, own in jobs.groupby([girdle, "method", "muscle_dynamics", "criterion", "effort_power"], sort=False):
        own = own.sort_values(angle)
        good = own[[tracks(job) for _, job in own.iterrows()]]
        values = ratios[good.job_id]
        change, near = "–", "–"
        if len(good) > 1:
            change = "falls" if values.iloc[-1] < values.iloc[0] else "rises"
            first, last = limits(good.job_id.iloc[0]), limits(good.job_id.iloc[-1])
            if first and last:
                near = "decided" if last[1] < first[0] or last[0] > first[1] else "not decided"
        cell = lambda job: f"{ratios[job.job_id]:.2f}" if tracks(job) else f"({ratios.get(job.job_id, float('nan')):.2f})"
        cells = " | ".join(cell(job) for _, job in own.iterrows())
        lines.append(f"| {keys[0]} | {keys[1]} | {keys[2]} | {criterion_of(keys[3:])} | {cells} | {change} | {near} |")
    return lines


PUBLISHED_ANTAGONISTS = {
    "rhomboids": "Rhomboideus_",
    "scapular trapezius": "TrapeziusScapula_",
    "infraspinatus": "Infraspinatus_",
    "iliac latissimus": "LatissimusDorsi_I",
}


def pectoralis_methods(results):
    """A group responds if its force changes by more than 5 %."""
    slack, name = "muscle.PectoralisMajor*.tendon_slack_length_scale", "pectoralis_methods"
    jobs = results.read(name)
    muscles = pd.read_parquet(results.folder / name / "muscles.parquet").set_index("job_id")
    lines = ["| method | muscles | criterion | " + " | ".join(PUBLISHED_ANTAGONISTS) + " | the published finding |"]
    lines.append("|---" * (4 + len(PUBLISHED_ANTAGONISTS)) + "|")
    for keys, own in jobs.groupby(["method", "muscle_dynamics", "criterion", "effort_power"], sort=False):
        own = own.sort_values(slack)
        if not all(tracks(job) for _, job in own.iterrows()):
            cells, finding = ["–"] * len(PUBLISHED_ANTAGONISTS), "left out: misses the motion by more than 2°"
        else:
            short, long = (muscles.loc[job] for job in own.job_id)
            cells, risen, undecided, unknown = [], 0, False, False
            for group in PUBLISHED_ANTAGONISTS.values():
                of = [rows[rows.muscle.str.startswith(group)] for rows in (short, long)]
                before, after = of[1].mean_force_n.sum(), of[0].mean_force_n.sum()
                change = after / before - 1 if before > 0.01 else 0.0
                risen += int(change > 0.05) - int(change < -0.05)
                ends = of[0].mean_force_near_low_n.sum(skipna=False), of[1].mean_force_near_high_n.sum(skipna=False)
                unknown |= any(pd.isna(end) for end in ends)
                undecided |= bool(ends[0] < ends[1])
                cells.append(f"{100 * change:+.0f} %")
            finding = "holds" if risen == len(cells) else "reverses" if risen == -len(cells) else f"{risen} of {len(cells)}" if risen > 0 else "not seen"
            finding += ", not decided within 5 %" if undecided else ", no ranges" if unknown else ""
        lines.append(f"| {keys[0]} | {keys[1]} | {criterion_of(keys[2:])} | {' | '.join(cells)} | {finding} |")
    return lines


TABLES = {
    "table1": lambda results: table1(results, "table1"),
    "table1_starts": lambda results: table1(results, "table1_starts"),
    "table1_starts_variant": lambda results: table1(results, "table1_starts_variant"),
    "optima": optima,
    "ringing": ringing,
    "convergence": convergence,
    "abduction": abduction,
    "pectoralis": pectoralis,
    "arm26": arm26,
    "methods": methods,
    "abduction_methods": abduction_methods,
    "pectoralis_methods": pectoralis_methods,
    "table1_methods": table1_methods,
}


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("names", nargs="*", metavar="NAME", help=f"of: {', '.join(TABLES)}")
    options.add_argument("--sinew", default=ROOT / "target/release/sinew")
    options = options.parse_args()
    readmes = {path: path.read_text() for path in ROOT.glob("*/README.md")}
    with tempfile.TemporaryDirectory() as folder:
        results = Results(options.sinew, folder)
        for name in options.names or TABLES:
            lines = "\n".join(TABLES[name](results))
            mark = rf"(<!-- table {name} -->\n).*?(<!-- end -->)"
            marked = [path for path, text in readmes.items() if re.search(mark, text, flags=re.DOTALL)]
            if len(marked) != 1:
                raise SystemExit(f"{len(marked)} READMEs have marks for {name}")
            path = marked[0]
            readmes[path] = re.sub(mark, lambda found: f"{found[1]}{lines}\n{found[2]}", readmes[path], flags=re.DOTALL)
            path.write_text(readmes[path])
            print(name, path.relative_to(ROOT), flush=True)


if __name__ == "__main__":
    main()
