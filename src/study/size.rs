//! Counts the jobs of a study before any is made: a few lines can ask for more jobs than any memory holds.

use super::axis::{MAX_JOBS, issue};
use super::file::Sweep;
use crate::error::Issue;

/// Largest number of values of all jobs together, one per job and axis.
const MAX_VALUES: usize = 4_000_000;

/// Refuses a study whose sweeps together have too many jobs or too many values, before conditions remove any.
///
/// # Errors
/// An [`Issue`] with the place of the sweeps.
pub fn check(sweeps: &[Sweep]) -> Result<(), Issue> {
    let sizes: Vec<SweepSize> = sweeps.iter().map(SweepSize::of).collect();
    let total = |part: fn(&SweepSize) -> usize| sizes.iter().map(part).fold(0, usize::saturating_add);
    // Each job stores its value, or the lack of one, for every axis of the study.
    let jobs = total(|size| size.jobs);
    let values = jobs.saturating_mul(total(|size| size.axes));
    let help = "use fewer values per axis, or [sweep.sample] instead of every combination";
    let place = vec!["sweep".to_owned()];
    if jobs > MAX_JOBS {
        let jobs = if jobs == usize::MAX { "more than 10^19".to_owned() } else { jobs.to_string() };
        return Err(issue(
            place,
            format!("the study has {jobs} jobs before conditions; at most {MAX_JOBS} are allowed"),
            help,
        ));
    }
    if values > MAX_VALUES {
        let message =
            format!("the study has {jobs} jobs with {values} swept values in all; at most {MAX_VALUES} are allowed");
        return Err(issue(place, message, help));
    }
    Ok(())
}

/// SweepSize of a sweep.
struct SweepSize {
    jobs: usize,
    axes: usize,
}

impl SweepSize {
    fn of(sweep: &Sweep) -> Self {
        let mut size = Self { jobs: 1, axes: 0 };
        let mut times = |jobs: usize, axes: usize| {
            size.jobs = size.jobs.saturating_mul(jobs);
            size.axes = size.axes.saturating_add(axes);
        };
        if let Some(sample) = &sweep.sample {
            times(sample.count, 1 + sample.draws.len());
        }
        for group in sweep.group.values() {
            let inner = Self::of(group);
            times(inner.jobs, inner.axes);
        }
        if !sweep.list.is_empty() {
            times(sweep.list.len(), sweep.list.iter().map(toml::Table::len).max().unwrap_or(0));
        }
        if let Some(table) = &sweep.grid {
            times(table.values().map(length).fold(1, usize::saturating_mul), table.len());
        }
        if let Some(table) = &sweep.star {
            times(table.values().map(length).fold(1, usize::saturating_add), table.len());
        }
        if let Some(table) = &sweep.zip {
            times(table.values().map(length).max().unwrap_or(1), table.len());
        }
        size
    }
}

/// Number of values of an axis: a list, or a range with a count. Anything else is refused where it is parsed.
fn length(axis: &toml::Value) -> usize {
    match axis {
        toml::Value::Array(values) => values.len(),
        toml::Value::Table(range) => range
            .get("count")
            .and_then(toml::Value::as_integer)
            .and_then(|count| usize::try_from(count).ok())
            .unwrap_or(1),
        _ => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(text: &str) -> Option<String> {
        let sweep: Sweep = toml::from_str(text).unwrap();
        check(&[sweep]).err().map(|issue| issue.message)
    }

    #[test]
    fn sweeps_are_counted_as_a_whole() {
        let axis = |name: &str| format!("{name} = {{ from = 0, to = 1, count = 1000 }}\n");
        assert_eq!(found(&format!("[grid]\n{}", axis("a"))), None);
        assert_eq!(found(&format!("[grid]\n{}{}", axis("a"), axis("b"))), None);
        let three = format!("[grid]\n{}{}{}", axis("a"), axis("b"), axis("c"));
        assert!(found(&three).unwrap().contains("1000000000 jobs"));
        let many: String = (0..900).map(|i| axis(&format!("a{i}"))).collect();
        assert!(found(&format!("[grid]\n{many}")).unwrap().contains("more than 10^19"));
        assert_eq!(found(&format!("[zip]\n{many}")), None, "1000 jobs of 900 values");
        assert!(found(&format!("[star]\n{many}")).unwrap().contains("900001 jobs with 810000900 swept values"));
        let samples =
            |count: usize| format!("[sample]\ncount = {count}\nseed = 1\n{}", many.replace(", count = 1000", ""));
        assert_eq!(found(&samples(1000)), None);
        assert!(found(&samples(100_000)).unwrap().contains("90100000 swept values"));
        let sweep: Sweep = toml::from_str(&format!("[grid]\n{}{}", axis("a"), axis("b"))).unwrap();
        assert!(check(&[sweep.clone(), sweep]).unwrap_err().message.contains("2000000 jobs"), "two [[sweep]]");
    }
}
