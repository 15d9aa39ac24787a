//! The columns of the swept axes in the table `jobs`, one per axis.

use super::{Table, Values};
use crate::settings::Value;
use crate::study::Study;

/// Columns of `jobs` before those of the axes, and the first one after them.
pub const BEFORE_AXES: [&str; 2] = ["job_id", "index"];
const AFTER_AXES: &str = "status";

/// Names of the swept axes of a study, from its table of jobs.
pub fn axes(jobs: &Table) -> Vec<String> {
    let names = jobs.columns.iter().map(|(name, _)| name.clone());
    names.filter(|name| !BEFORE_AXES.contains(&name.as_str())).take_while(|name| name != AFTER_AXES).collect()
}

/// Settings that are whole numbers.
const WHOLE_NUMBERS: [&str; 7] =
    ["stages", "measurement_ratio", "starts", "first_start", "seed", "max_iterations", crate::study::axis::SAMPLE];

/// Type of a swept column: that of all its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnKind {
    Integer,
    Number,
    Flag,
    Text,
}

impl ColumnKind {
    /// The type of an axis of a study. A real-valued setting is real in every study, even if all its values are whole.
    pub fn of(study: &Study, axis: usize) -> Self {
        let values = || study.jobs.iter().filter_map(move |job| job.swept[axis].as_ref());
        if WHOLE_NUMBERS.contains(&study.axes[axis].as_str()) && values().all(|v| matches!(v, Value::Integer(_))) {
            ColumnKind::Integer
        } else if values().all(|v| v.number().is_some()) {
            ColumnKind::Number
        } else if values().all(|v| matches!(v, Value::Flag(_))) {
            ColumnKind::Flag
        } else {
            ColumnKind::Text
        }
    }

    pub fn values(self, values: &[Option<&Value>]) -> Values {
        match self {
            ColumnKind::Integer => Values::Integer(
                (values.iter())
                    .map(|v| match v {
                        Some(Value::Integer(i)) => Some(*i),
                        _ => None,
                    })
                    .collect(),
            ),
            ColumnKind::Number => Values::Number(values.iter().map(|v| v.and_then(Value::number)).collect()),
            ColumnKind::Flag => Values::Flag(
                (values.iter())
                    .map(|v| match v {
                        Some(Value::Flag(f)) => Some(*f),
                        _ => None,
                    })
                    .collect(),
            ),
            ColumnKind::Text => Values::Text(values.iter().map(|v| v.map(ToString::to_string)).collect()),
        }
    }
}

/// Unit of a swept name: for a setting from its name, for a number of the model from the last key of its path. Empty
/// for texts and flags.
pub fn unit(name: &str) -> &'static str {
    const BY_ENDING: [(&str, &str); 18] = [
        ("_active_length", "optimal fibre lengths"),
        ("transition_length", "optimal fibre lengths"),
        ("_scale", "1"),
        ("_rotation", "rad"),
        (".rotation", "rad"),
        (".axis", "1"),
        ("max_shortening_velocity", "optimal fibre lengths/s"),
        ("_hz", "Hz"),
        ("_deg", "degree"),
        ("_rad", "rad"),
        ("_m", "m"),
        ("_s", "s"),
        (".mass", "kg"),
        (".inertia", "kg m²"),
        ("_isometric_force", "N"),
        ("_length", "m"),
        ("ation_time", "s"),
        (".moment", "N m"),
    ];
    match name {
        "h" => "s",
        "reserves" => "N m or N",
        _ if name.starts_with("reserves.") || name.ends_with(".optimal_force") => "N m or N",
        "memory_limit_mb" => "MB",
        "noise_sd" => "m, rad",
        "scheme"
        | "initial"
        | "bounds"
        | "load_sharing_grid"
        | "warm_start"
        | "regularity"
        | "trajectories"
        | "method"
        | "muscle_dynamics"
        | "criterion"
        | "effort_of"
        | "effort_weight"
        | "passive_forces"
        | "muscle_curves"
        | "activation_dynamics" => "",
        _ if name.ends_with(".role") || name == "curves.family" || name == "curves.activation_dynamics" => "",
        _ if name.starts_with("muscle.") && name.ends_with(".damping") => "maximum isometric forces",
        _ if name.ends_with("_scale") => "1",
        _ if name.contains("point.") || name.contains("centre_of_mass.") || name.contains(".radii.") => "m",
        _ if name.starts_with("gravity.") => "m/s²",
        _ if name.contains(".force.") => "N",
        _ if [".radius", ".length", "rigid_tendon_below"].iter().any(|ending| name.ends_with(ending)) => "m",
        _ if name.starts_with("coordinate.") => "rad or m",
        _ if name.ends_with("pennation_angle") => "rad",
        _ => {
            // Entries of a list have the unit of the list.
            let list = name.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.' || c == '*');
            let fits = |(ending, _): &&(&str, &str)| name.ends_with(ending) || list.ends_with(ending);
            BY_ENDING.iter().find(fits).map_or("1", |(_, unit)| unit)
        }
    }
}
