//! Checks whether a converged solution is plausible. Each warning has a short code, a limit that a study may change,
//! and a remedy.

use crate::model::Model;
use crate::motion::{MotionTable, low_pass};
use crate::outcome::{JobRow, MuscleRow, Outcome, ReserveRow};
use crate::settings::Settings;

/// A kind of warning: its code, the quantity that it checks with the names of its limits, and what to do about it.
pub struct WarningKind {
    pub code: &'static str,
    pub limit: &'static str,
    pub remedy: &'static str,
}

/// All kinds of warning.
pub const WARNING_KINDS: [WarningKind; 12] = [
    WarningKind {
        code: "tracking",
        limit: "tracking error above warn.tracking_deg (2°) or warn.tracking_mm (10 mm), RMS",
        remedy: "if activations reach 1, the muscles are too weak; otherwise lower mu, refine the mesh or \
                 check the motion",
    },
    WarningKind {
        code: "saturated",
        limit: "activation at its upper bound for more than warn.saturated (0.1) of the time, or activation or \
                excitation above 1 where it has no upper bound",
        remedy: "the muscles are too weak for this motion: check maximum forces, masses and external forces; \
                 where nothing bounds activations, set bounds = \"both_boxed\"",
    },
    WarningKind {
        code: "overload",
        limit: "force above warn.overload (1.5) times the maximum isometric force",
        remedy: "see `passive` and `fibre_velocity`: the force comes from a stretched or rapidly lengthening fibre",
    },
    WarningKind {
        code: "passive",
        limit: "passive force above warn.passive (0.2) times the maximum isometric force",
        remedy: "the fibre is stretched: the tendon slack length or the optimal fibre length is too short for the path",
    },
    WarningKind {
        code: "fibre_length",
        limit: "fibre length below warn.fibre_length_min (0.4) or above warn.fibre_length_max (1.6) optimal fibre \
                lengths",
        remedy: "the tendon slack length or the optimal fibre length does not fit the path",
    },
    WarningKind {
        code: "pushing",
        limit: "a force below -0.005 times the maximum isometric force: a tendon cannot push",
        remedy: "the damped fibre shortens faster than its activation can pull: lower muscle.<name>.damping, or smooth the motion",
    },
    WarningKind {
        code: "left_out",
        limit: "a muscle without strength (below 0.001 times the maximum isometric force) at some instant of a given motion",
        remedy: "its fibre is too short, too long or too fast there: check its lengths, and the motion's unit and smoothing",
    },
    WarningKind {
        code: "fast_motion",
        limit: "a joint coordinate faster than warn.speed_rad_s (30 rad/s) or warn.speed_m_s (10 m/s), or an angle \
                with a range above warn.turn_rad (2π)",
        remedy: "check the unit of the column (degrees labelled as radians?), or smooth the motion (smoothing_hz)",
    },
    WarningKind {
        code: "mesh",
        limit: "estimated discretisation error of the effort or of a mean force above warn.mesh (0.05)",
        remedy: "use a smaller h, or for planar models more stages (stages = 3)",
    },
    WarningKind {
        code: "fibre_velocity",
        limit: "fibre velocity above warn.fibre_velocity (20) optimal fibre lengths per second",
        remedy: "with scheme = \"midpoint\", fibre velocities ring: use radau; otherwise check the motion and \
                 the muscle's lengths",
    },
    WarningKind {
        code: "chatter",
        limit: "an excitation that goes up and down by its whole range more than warn.chatter (8) times",
        remedy: "nothing in the objective keeps excitations from alternating, and the finer the mesh, the more they do; \
                 mean forces change little, excitations and iterations much: set excitation_weight = 0.01",
    },
    WarningKind {
        code: "reserves",
        limit: "peak of a reserve above warn.reserves (0.05) times that of the net joint moment (Hicks et al., J Biomech \
                Eng 137, 2015)",
        remedy: "the muscles do not carry the load: check their strength and paths; a smaller `reserves` or a larger \
                 `reserve_weight` penalises reserves more",
    },
];

/// A warning: its code, and what was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Warning {
    pub code: &'static str,
    pub found: String,
}

/// A mean force counts as at least this fraction of the maximum isometric force when its relative error is computed.
const MIN_FORCE_SHARE: f64 = 0.01;
/// An excess of an activation or excitation over 1 up to this is rounding error.
const ROUNDING_ERROR: f64 = 1e-6;
/// A negative force beyond this times the maximum isometric force pushes.
const PUSHING: f64 = 0.005;

/// The warnings on a converged job.
pub fn of_answer(outcome: &Outcome, model: &Model, settings: &Settings) -> Vec<Warning> {
    let (job, muscles) = (&outcome.job, &outcome.muscles);
    let limits = &settings.warn;
    let mut warnings = Vec::new();
    let mut warn = |code: &'static str, found: String| warnings.push(Warning { code, found });
    let (angle_deg, distance_mm) = (job.tracking_rms_deg.unwrap_or(0.0), 1e3 * job.tracking_rms_m.unwrap_or(0.0));
    if angle_deg > limits.tracking_deg || distance_mm > limits.tracking_mm {
        warn("tracking", format!("tracking error {angle_deg:.1}° and {distance_mm:.0} mm (RMS)"));
    }
    // The muscle with the largest value of `measure`.
    let strength = |m: usize| model.muscles[m].max_isometric_force;
    let worst = |measure: &dyn Fn(usize, &MuscleRow) -> f64| {
        let all = muscles.iter().enumerate().map(|(m, row)| (measure(m, row), row));
        all.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let count = |beyond: &dyn Fn(usize, &MuscleRow) -> bool| {
        let others = muscles.iter().enumerate().filter(|(m, row)| beyond(*m, row)).count().saturating_sub(1);
        if others == 0 { String::new() } else { format!(" and {others} more") }
    };
    let is_saturated = |row: &MuscleRow| row.saturated_share > limits.saturated;
    let exceeds_one =
        |row: &MuscleRow| row.peak_activation.max(row.peak_excitation.unwrap_or(0.0)) > 1.0 + ROUNDING_ERROR;
    if let Some((peak, row)) =
        worst(&|_, row| row.peak_activation.max(row.peak_excitation.unwrap_or(0.0))).filter(|(_, row)| exceeds_one(row))
    {
        let more = count(&|_, row| exceeds_one(row));
        warn("saturated", format!("{}{more}: activation or excitation up to {peak:.2}", row.muscle));
    } else if let Some((share, row)) = worst(&|_, row| row.saturated_share).filter(|(_, row)| is_saturated(row)) {
        let more = count(&|_, row| is_saturated(row));
        warn("saturated", format!("{}{more}: activation at 1 for {:.0} % of the time", row.muscle, 100.0 * share));
    }
    let times = |force: f64, m: usize| force / strength(m);
    for (code, force, limit, words) in [
        ("overload", (|row| row.peak_force_n) as fn(&MuscleRow) -> f64, limits.overload, "N"),
        ("passive", |row| row.peak_passive_force_n, limits.passive, "N of passive force"),
        ("pushing", |row| -row.min_force_n, PUSHING, "N of a tendon that pushes"),
    ] {
        if let Some((share, row)) = worst(&|m, row| times(force(row), m)).filter(|(share, _)| *share > limit) {
            let more = count(&|m, row| times(force(row), m) > limit);
            let peak = force(row);
            warn(
                code,
                format!("{}{more}: up to {peak:.0} {words}, {share:.2} times the maximum isometric force", row.muscle),
            );
        }
    }
    let outside = |row: &MuscleRow| {
        let (short, long) = (row.min_fibre_length.unwrap_or(1.0), row.max_fibre_length.unwrap_or(1.0));
        (limits.fibre_length_min - short).max(long - limits.fibre_length_max)
    };
    if let Some((_, row)) = worst(&|_, row| outside(row)).filter(|(by, _)| *by > 0.0) {
        let more = count(&|_, row| outside(row) > 0.0);
        let (low, high) = (row.min_fibre_length.unwrap_or(1.0), row.max_fibre_length.unwrap_or(1.0));
        warn("fibre_length", format!("{}{more}: {low:.2} to {high:.2} optimal fibre lengths", row.muscle));
    }
    let velocity = |row: &MuscleRow| row.peak_fibre_velocity_per_s.unwrap_or(0.0);
    if let Some((peak, row)) = worst(&|_, row| velocity(row)).filter(|(peak, _)| *peak > limits.fibre_velocity) {
        let more = count(&|_, row| velocity(row) > limits.fibre_velocity);
        warn("fibre_velocity", format!("{}{more}: up to {peak:.0} optimal fibre lengths per second", row.muscle));
    }
    let left_out = |row: &MuscleRow| row.left_out_share.unwrap_or(0.0);
    if let Some((share, row)) = worst(&|_, row| left_out(row)).filter(|(share, _)| *share > 0.0) {
        let more = count(&|_, row| left_out(row) > 0.0);
        warn("left_out", format!("{}{more}: no strength for {:.0} % of the time", row.muscle, 100.0 * share));
    }
    let swings = |row: &MuscleRow| row.excitation_swings.unwrap_or(0.0);
    if let Some((most, row)) = worst(&|_, row| swings(row)).filter(|(most, _)| *most > limits.chatter) {
        let more = count(&|_, row| swings(row) > limits.chatter);
        warn("chatter", format!("{}{more}: the excitation goes up and down {most:.0} times", row.muscle));
    }
    warnings.extend(mesh_warning(job, muscles, model, limits.mesh));
    warnings.extend(reserve_warning(&outcome.reserves, limits.reserves));
    warnings
}

/// The warning on reserves that carry more than a negligible part of the load, or an unknown part.
fn reserve_warning(reserves: &[ReserveRow], limit: f64) -> Option<Warning> {
    let beyond = reserves.iter().filter(|row| row.is_reserve && row.share.is_none_or(|share| share > limit));
    let words: Vec<String> = beyond
        .map(|row| {
            let (peak, unit) = row.peak_moment_n_m.map_or((row.peak_force_n, "N"), |peak| (Some(peak), "N m"));
            let share = row.share.map_or("an unknown share".to_owned(), |share| format!("{:.0} %", 100.0 * share));
            format!("{}: up to {:.2} {unit}, {share} of the net load", row.coordinate, peak.unwrap_or(0.0))
        })
        .collect();
    (!words.is_empty()).then(|| Warning { code: "reserves", found: words.join(", ") })
}

/// The warning on the discretisation error: of the effort, and of the mean force with the largest relative error.
fn mesh_warning(job: &JobRow, muscles: &[MuscleRow], model: &Model, limit: f64) -> Option<Warning> {
    let of_effort = job.effort_mesh_error.zip(job.effort).map(|(error, effort)| error.abs() / effort.abs());
    let of_force = |m: usize| {
        let row = &muscles[m];
        let size = row.mean_force_n.abs().max(MIN_FORCE_SHARE * model.muscles[m].max_isometric_force);
        Some((row.mean_force_mesh_error_n?.abs() / size, row.muscle.as_str()))
    };
    let worst = (0..muscles.len()).filter_map(of_force).max_by(|a, b| a.0.total_cmp(&b.0));
    let parts: Vec<String> = [of_effort.map(|share| (share, "the effort")), worst]
        .into_iter()
        .flatten()
        .filter(|(share, _)| *share > limit)
        .map(|(share, what)| format!("about {:.0} % error in {what}", 100.0 * share))
        .collect();
    (!parts.is_empty()).then(|| Warning { code: "mesh", found: parts.join(", ") })
}

/// Rates are taken over at least this time, s: shorter differences would measure noise.
const RATE_WINDOW: f64 = 0.02;

/// The largest absolute rate (1/s) of values over time, and the smallest and largest value.
pub fn rate_and_range(time: &[f64], values: &[f64]) -> (f64, [f64; 2]) {
    let (mut rate, mut after) = (0.0f64, 0);
    let window = RATE_WINDOW.min(time[time.len() - 1] - time[0]);
    for (i, &t) in time.iter().enumerate() {
        while after + 1 < time.len() && time[after] - t < window {
            after += 1;
        }
        if time[after] > t && time[after] - t >= window {
            rate = rate.max((values[after] - values[i]).abs() / (time[after] - t));
        }
    }
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    (rate, [low, high])
}

/// The warning on an implausibly fast or large motion, with the job's changes applied.
pub fn of_motion(table: &MotionTable, model: &Model, settings: &Settings) -> Option<Warning> {
    let limits = &settings.warn;
    let coordinates = model.mechanics.joint_coordinates();
    let ignored = model.mechanics.unmoved_coordinates();
    let found: Vec<String> = (table.columns.iter())
        .filter(|(name, _)| !ignored.iter().any(|(known, _)| known == name))
        .filter_map(|(name, values)| {
            let is_angle = coordinates.iter().find(|(known, _)| known == name)?.1;
            let factor =
                settings.motion.iter().find(|(changed, ..)| changed == name).map_or(1.0, |change| change.2.abs());
            let (rate, [low, high]) =
                rate_and_range(&table.time, &low_pass(&table.time, values, settings.smoothing_hz));
            let (rate, range) = (factor * rate / settings.time_scale, factor * (high - low));
            let (limit, unit) = if is_angle { (limits.speed_rad_s, "rad/s") } else { (limits.speed_m_s, "m/s") };
            // Allow for rounding in a motion of exactly one full turn.
            let is_wide = is_angle && range > limits.turn_rad * (1.0 + 1e-6);
            (rate > limit || is_wide).then(|| {
                let range_text = if is_wide { format!(", range {:.0}°", range.to_degrees()) } else { String::new() };
                format!("{name}: up to {rate:.0} {unit}{range_text}")
            })
        })
        .collect();
    (!found.is_empty()).then(|| Warning { code: "fast_motion", found: found.join("; ") })
}

/// The codes for the column `warnings`, and what was found as text; `None` without warnings.
pub fn said(warnings: &[Warning]) -> (Option<String>, Option<String>) {
    if warnings.is_empty() {
        return (None, None);
    }
    let codes: Vec<&str> = warnings.iter().map(|warning| warning.code).collect();
    let words: Vec<String> = warnings.iter().map(|warning| format!("{}: {}", warning.code, warning.found)).collect();
    (Some(codes.join(", ")), Some(words.join("; ")))
}
