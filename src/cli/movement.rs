//! What `inverse-dynamics` and `joint-loads` read: a model, a motion, external loads.

use std::ops::RangeInclusive;
use std::path::Path;

use super::arguments::MovementArguments;
use super::layout::wrapped;
use super::output::{csv, write_table};
use super::{GOOD, print};
use crate::error::{Result, SourceFile};
use crate::methods::inverse_dynamics::spatial::{LoadFacts, Movement, load_facts};
use crate::model::tree::Tree;
use crate::motion::MotionTable;
use crate::motion::columns::check_cutoff;
use crate::motion::external_loads::{ExternalLoad, ExternalLoads};
use crate::names::counted;
use crate::skeleton::Skeleton;
use crate::study::loads::LoadSources;
use crate::study::{is_spatial, load_skeleton};
use crate::tables::Table;
use crate::terminal::note;

/// Instants may be off a window's ends by so much, s.
const ROUNDING: f64 = 1e-9;

/// The files of a movement.
pub struct Files {
    pub skeleton: Skeleton,
    pub table: MotionTable,
    pub loads: Option<ExternalLoads>,
    pub window: [f64; 2],
    smoothing_hz: f64,
}

impl Files {
    /// Reads what belongs to a spatial model, and says what is left out or assumed.
    pub fn read(arguments: &MovementArguments, model: &SourceFile) -> Result<Self> {
        let name = model.path.display();
        let refused = |message: String, help: &str| Err(model.error(None, message, "", Some(help.to_owned())));
        if !is_spatial(model) {
            return refused(
                format!("{name}: a planar model is not supported here"),
                "the command needs a spatial model",
            );
        }
        let (_, skeleton) = load_skeleton(model)?;
        if let Some(coordinate) = Tree::unsupported(&skeleton) {
            let help = "coordinates of a joint on an ellipsoid must be independent here";
            return refused(format!("{name}: `{coordinate}` follows another coordinate"), help);
        }
        super::import::say_lost(model)?;
        let motion = SourceFile::read(&arguments.motion)?;
        let table = MotionTable::from_file(&motion, &skeleton)?;
        let window = window(arguments, &motion, &table)?;
        let mut loads = None;
        if let Some(path) = &arguments.loads {
            let sources = LoadSources::read(path)?;
            let (found, off) = sources.loads(&skeleton, arguments.force_smoothing)?;
            if !off.is_empty() {
                note(&format!("note: turned off in {}: {}", path.display(), off.join(", ")));
            }
            covers(&sources.table, "the loads", found.span, window)?;
            loads = Some(found);
        }
        let files = Self { skeleton, table, loads, window, smoothing_hz: arguments.smoothing };
        files.say_assumptions();
        Ok(files)
    }

    pub fn movement(&self) -> Movement<'_> {
        Movement::new(&self.skeleton, &self.table, self.loads.as_ref(), &instants(self.window), self.smoothing_hz)
    }

    fn say_assumptions(&self) {
        self.table.notes.iter().for_each(|remark| note(&format!("note: {remark}")));
        let coordinates = self.skeleton.coordinates.iter().filter(|c| c.is_independent());
        let names = coordinates.map(|coordinate| coordinate.name.as_str());
        let without: Vec<&str> = names.filter(|name| self.table.column(name).is_none()).collect();
        if !without.is_empty() {
            note(&format!("note: without a column in the motion, at their defaults: {}", without.join(", ")));
        }
        let held: Vec<&str> = self.skeleton.held_points.iter().map(|held| held.name.as_str()).collect();
        if !held.is_empty() {
            note(&format!("note: these point constraints carry no force here: {}", held.join(", ")));
        }
    }
}

/// Prints a table, or writes it and prints `lines` and the number of instants.
pub fn deliver(table: &Table, model: &str, out: Option<&Path>, lines: &[String], instants: usize) -> Result<u8> {
    let Some(path) = out else {
        print(csv(table)?.trim_end());
        return Ok(GOOD);
    };
    write_table(table, vec![("sinew.model".to_owned(), model.to_owned())], path)?;
    lines.iter().for_each(|line| print(&wrapped(line, "    ")));
    print(&format!("{}: {}", counted(instants, "instant"), path.display()));
    Ok(GOOD)
}

/// What the external loads of a movement amount to, and whether one acts on a body that moves fast under it.
pub fn load_lines(movement: &Movement<'_>) -> Vec<String> {
    let loads = movement.loads.iter().flat_map(|loads| &loads.loads);
    let line = |(facts, load): (LoadFacts, &ExternalLoad)| {
        let body = &movement.skeleton.bodies[load.body].name;
        let air = if facts.speed > IN_THE_AIR {
            format!("; it acts while the body moves at {:.1} m/s under it: does it belong to another one?", facts.speed)
        } else {
            String::new()
        };
        format!("load {} on {body}: vertical force up to {:.2} body weights{air}", load.name, facts.peak)
    };
    load_facts(movement).into_iter().zip(loads).map(line).collect()
}

/// A body that moves faster than this where a force acts on it is in the air, m/s.
const IN_THE_AIR: f64 = 1.0;

/// The instants of a window.
pub fn instants([from, to]: [f64; 2]) -> RangeInclusive<f64> {
    from - ROUNDING..=to + ROUNDING
}

/// Checks that a file with `what` covers the window.
pub fn covers(file: &SourceFile, what: &str, [first, last]: [f64; 2], [from, to]: [f64; 2]) -> Result<()> {
    if first <= from + ROUNDING && last >= to - ROUNDING {
        return Ok(());
    }
    let name = file.path.display();
    let message = format!("{name}: {what} are known from {first} to {last} s, but needed from {from} to {to} s");
    let [low, high] = [from.max(first), to.min(last)];
    let help = if low < high {
        format!("choose instants that both have: --window {low} {high}")
    } else {
        "the two have no instants in common: check their columns of time".to_owned()
    };
    Err(file.error(None, message, "", Some(help)))
}

/// The window that was asked for, or the whole motion.
pub fn window(arguments: &MovementArguments, file: &SourceFile, table: &MotionTable) -> Result<[f64; 2]> {
    check_cutoff(file, &table.time, arguments.smoothing)?;
    let whole = [table.start(), table.start() + table.duration()];
    let Some(asked) = arguments.window.as_deref() else { return Ok(whole) };
    let [from, to] = [asked[0], asked[1]];
    let name = file.path.display();
    let refused = |message: String| {
        let help = format!("the motion goes from {} to {} s", whole[0], whole[1]);
        Err(file.error(None, message, "", Some(help)))
    };
    if from >= to {
        return refused(format!("--window {from} {to}: the window must end after it begins"));
    }
    if from < whole[0] - ROUNDING || to > whole[1] + ROUNDING {
        return refused(format!("{name}: the window {from} to {to} s is not within the motion"));
    }
    if !table.time.iter().any(|t| instants([from, to]).contains(t)) {
        return refused(format!("{name}: the motion has no instant from {from} to {to} s"));
    }
    Ok([from, to])
}
