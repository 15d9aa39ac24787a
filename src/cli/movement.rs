//! What `inverse-dynamics` and `joint-loads` read: a spatial model, a motion, external loads.

use std::ops::RangeInclusive;
use std::path::Path;

use super::arguments::MovementArguments;
use crate::error::{Result, SourceFile};
use crate::methods::inverse_dynamics::Movement;
use crate::motion::MotionTable;
use crate::motion::external_loads::{ExternalLoads, LoadEntry, LoadsFile};
use crate::opensim;
use crate::skeleton::Skeleton;
use crate::study::{is_spatial, load_skeleton};

/// Instants may be off a window's ends by so much, s.
const ROUNDING: f64 = 1e-9;

/// The files of a movement.
pub struct Files {
    pub skeleton: Skeleton,
    pub table: MotionTable,
    pub loads: Option<ExternalLoads>,
    /// s
    pub window: [f64; 2],
    smoothing_hz: f64,
}

impl Files {
    pub fn read(arguments: &MovementArguments) -> Result<Self> {
        let model = SourceFile::read(&arguments.model)?;
        if !is_spatial(&model) {
            let message = format!("{}: a planar model is not supported here", model.path.display());
            return Err(model.error(None, message, "", Some("the command needs a spatial model".to_owned())));
        }
        let (_, skeleton) = load_skeleton(&model)?;
        super::import::say_lost(&model)?;
        let motion = SourceFile::read(&arguments.motion)?;
        let table = MotionTable::from_file(&motion, &skeleton)?;
        let window = window(arguments, &motion, &table)?;
        let mut loads = None;
        if let Some(path) = &arguments.loads {
            let found = read_loads(path, &skeleton, arguments.force_smoothing)?;
            covers(&SourceFile::read(path)?, "the loads", found.span, window)?;
            loads = Some(found);
        }
        Ok(Self { skeleton, table, loads, window, smoothing_hz: arguments.smoothing })
    }

    pub fn movement(&self) -> Movement<'_> {
        let window: RangeInclusive<f64> = self.window[0] - ROUNDING..=self.window[1] + ROUNDING;
        Movement::new(&self.skeleton, &self.table, self.loads.as_ref(), &window, self.smoothing_hz)
    }

    /// Remarks on the motion.
    pub fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = self.table.notes.iter().map(|note| format!("note: {note}")).collect();
        let coordinates = self.skeleton.coordinates.iter().filter(|c| !c.locked && c.follows.is_none());
        let names = coordinates.map(|coordinate| coordinate.name.as_str());
        let without: Vec<&str> = names.filter(|name| self.table.column(name).is_none()).collect();
        if !without.is_empty() {
            notes.push(format!("note: without a column in the motion, at their defaults: {}", without.join(", ")));
        }
        notes
    }
}

/// Checks that a file with `what` covers the window.
pub fn covers(file: &SourceFile, what: &str, [first, last]: [f64; 2], [from, to]: [f64; 2]) -> Result<()> {
    if first <= from + ROUNDING && last >= to - ROUNDING {
        return Ok(());
    }
    let name = file.path.display();
    let message = format!("{name}: {what} are known from {first} to {last} s, the motion goes from {from} to {to} s");
    let help = format!("choose instants that both have: --window {} {}", from.max(first), to.min(last));
    Err(file.error(None, message, "", Some(help)))
}

/// The window that was asked for, or the whole motion.
fn window(arguments: &MovementArguments, file: &SourceFile, table: &MotionTable) -> Result<[f64; 2]> {
    let whole = [table.start(), table.start() + table.duration()];
    let Some(asked) = arguments.window.as_deref() else { return Ok(whole) };
    let [from, to] = [asked[0], asked[1]];
    let is_inside = whole[0] - ROUNDING <= from && from < to && to <= whole[1] + ROUNDING;
    if !is_inside {
        let message = format!("{}: the window {from} to {to} s is not within the motion", file.path.display());
        let help = format!("the motion goes from {} to {} s", whole[0], whole[1]);
        return Err(file.error(None, message, "", Some(help)));
    }
    Ok([from, to])
}

/// Loads from OpenSim's `.xml`, or our own `.toml`.
fn read_loads(path: &Path, skeleton: &Skeleton, smoothing_hz: f64) -> Result<ExternalLoads> {
    let file = SourceFile::read(path)?;
    let is_xml = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("xml"));
    let (entries, table) = if is_xml {
        opensim::external_loads::external_loads(&file)?
    } else {
        let loads: LoadsFile = toml::from_str(&file.text).map_err(|e| file.toml_error(&e))?;
        let mut starts = file.text.match_indices("[[external_load]]").map(|(at, text)| at..at + text.len());
        let placed = |entry: LoadEntry| (entry, starts.next());
        (loads.external_load.into_iter().map(placed).collect(), loads.table)
    };
    let table = SourceFile::read(&path.parent().unwrap_or(Path::new(".")).join(table))?;
    ExternalLoads::new(&file, &entries, &table, skeleton, smoothing_hz)
}
