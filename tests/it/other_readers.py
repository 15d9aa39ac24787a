"""Opens the tables of two studies as a user would: filter, sort, join, data set, concatenation, CSV. Arguments: two output folders."""

import importlib
import io
import math
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.dataset as ds
import pyarrow.parquet as pq

first, second = sys.argv[1:3]
TABLES = [file.stem for file in Path(first).glob("*.parquet")]
assert {"jobs", "regularity", "muscles", "sensitivities"} <= set(TABLES), TABLES


def contents():
    jobs = pq.read_table(first + "/jobs.parquet").to_pydict()
    assert len(jobs["job_id"]) == 6 and jobs["status"] == ["converged"] * 6, jobs["status"]
    assert jobs["mu"] == [0.1, 0.1, 0.2, 0.2, 0.4, 0.4], jobs["mu"]
    assert jobs["bounds"][:2] == ["activation", "both"]
    assert jobs["error"] == [None] * 6
    assert all(math.isfinite(v) for v in jobs["objective"])
    muscles = pq.read_table(first + "/muscles.parquet").to_pydict()
    assert len(muscles["muscle"]) == 30 and set(map(type, muscles["idle"])) == {bool}
    file = pq.ParquetFile(first + "/jobs.parquet")
    metadata = file.metadata.metadata
    assert metadata[b"sinew.schema_version"] == b"4" and b"mu" in metadata[b"sinew.units"], metadata
    assert file.metadata.row_group(0).column(0).compression == "ZSTD"


def plain_types():
    for folder in (first, second):
        for name in TABLES:
            for field in pq.read_schema(f"{folder}/{name}.parquet"):
                assert "view" not in str(field.type), (name, field)
    # Whole numbers in a study remain real-valued settings; counts remain integers.
    for folder in (first, second):
        schema = pq.read_schema(folder + "/jobs.parquet")
        assert schema.field("mu").type == pa.float64(), schema
        assert pa.types.is_integer(schema.field("iterations").type), schema


def with_pyarrow():
    for name in TABLES:
        table = pq.read_table(f"{first}/{name}.parquet")
        if table.num_rows:
            table.take([0])
            table.sort_by([("job_id", "ascending")])
            pa.csv.write_csv(table, io.BytesIO())
    both = pq.read_table(first + "/jobs.parquet", filters=[("bounds", "==", "both"), ("mu", ">", 0.1)])
    assert both.num_rows == 2, both
    mask = ds.dataset(first + "/muscles.parquet").to_table(filter=pc.field("muscle") == "biceps")
    assert mask.num_rows == 6
    joined = mask.join(pq.read_table(first + "/jobs.parquet").select(["job_id", "mu"]), keys="job_id")
    assert sorted(joined["mu"].to_pylist()) == [0.1, 0.1, 0.2, 0.2, 0.4, 0.4]
    names = ["job_id", "mu", "bounds", "status", "warnings", "remark"]
    files = [folder + "/jobs.parquet" for folder in (first, second)]
    together = pa.concat_tables([pq.read_table(file).select(names) for file in files])
    data_set = ds.dataset(files).to_table(columns=names, filter=pc.field("status") == "converged")
    assert together.num_rows == data_set.num_rows == 8, (together, data_set)
    assert set(together["mu"].to_pylist()) == {0.1, 0.2, 0.4, 1.0, 2.0}


def with_pandas(pd):
    jobs = pd.read_parquet(first + "/jobs.parquet", filters=[("bounds", "==", "both")])
    assert len(jobs) == 3
    muscles = pd.read_parquet(first + "/muscles.parquet").sort_values("muscle")
    assert len(muscles.merge(jobs, on="job_id")) == 15
    both = pd.concat([pd.read_parquet(folder + "/jobs.parquet") for folder in (first, second)])
    assert len(both) == 8 and both["mu"].dtype == "float64"


def with_polars(pl):
    jobs = pl.scan_parquet(first + "/jobs.parquet").filter(pl.col("bounds") == "both").collect()
    assert jobs.height == 3
    muscles = pl.read_parquet(first + "/muscles.parquet").sort("muscle")
    assert muscles.join(jobs, on="job_id").height == 15
    both = [pl.read_parquet(folder + "/jobs.parquet").select("job_id", "mu", "status") for folder in (first, second)]
    assert pl.concat(both).height == 8


def with_duckdb(duckdb):
    ask = lambda query: duckdb.sql(query).fetchall()
    jobs, muscles = f"'{first}/jobs.parquet'", f"'{first}/muscles.parquet'"
    assert ask(f"select count(*) from {jobs} where bounds = 'both' and mu > 0.1") == [(2,)]
    assert ask(f"select count(*) from {muscles} join {jobs} using (job_id) where bounds = 'both'") == [(15,)]
    union = f"select mu from {jobs} union all by name select mu from '{second}/jobs.parquet'"
    assert ask(f"select count(*), max(mu) from ({union})") == [(8, 2.0)]


contents()
plain_types()
with_pyarrow()
print("read by pyarrow", pa.__version__)
for name, check in [("pandas", with_pandas), ("polars", with_polars), ("duckdb", with_duckdb)]:
    try:
        library = importlib.import_module(name)
    except ImportError:
        print(f"SKIPPED: {name} is not installed")
        continue
    check(library)
    print("read by", name, library.__version__)
