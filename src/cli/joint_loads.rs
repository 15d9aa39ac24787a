//! `sinew joint-loads`: loads that joints carry in a motion with known muscle forces.

use std::path::Path;

use super::arguments::MovementArguments;
use super::movement::{Files, covers, deliver};
use crate::error::{Result, SourceFile};
use crate::methods::inverse_dynamics::joint_loads::{JointLoad, MuscleForces, joint_loads};
use crate::methods::inverse_dynamics::spatial::weight;
use crate::motion::columns::Columns;
use crate::names::counted;
use crate::skeleton::Joint;
use crate::skeleton::file::GROUND;
use crate::skeleton::frame::{Frame, Vector, norm};
use crate::tables::{Table, Values};
use crate::terminal::note;

/// Numbers no larger than this are activations rather than forces.
const LARGEST_ACTIVATION: f64 = 1.5;

pub fn run(arguments: &MovementArguments, forces: &Path) -> Result<u8> {
    let files = Files::read(arguments, &SourceFile::read(&arguments.model)?)?;
    let forces = SourceFile::read(forces)?;
    let muscles = muscle_forces(&files, &forces)?;
    let movement = files.movement();
    let mut rows = Rows::default();
    let weight = weight(&files.skeleton);
    for &time in &movement.time {
        let now = movement.at(time);
        let loads = joint_loads(&movement, &now, &muscles);
        for (j, (joint, load)) in
            files.skeleton.joints.iter().zip(loads).enumerate().filter(|(_, (joint, _))| is_real(&files, joint))
        {
            let ground = Frame::identity();
            let parent = joint.parent.map_or(ground, |body| now.frames[body]);
            for (name, frame) in [("ground", ground), ("parent", parent), ("child", now.frames[joint.child])] {
                rows.add(time, j, name, &load, &frame, weight);
            }
        }
    }
    let table = rows.table(&files);
    let (out, model) = (arguments.out.as_deref(), &files.skeleton.name);
    deliver(&table, model, out, &rows.peaks(&files), movement.time.len())
}

/// The weld of the ground to itself carries nothing.
fn is_real(files: &Files, joint: &Joint) -> bool {
    files.skeleton.bodies[joint.child].name != GROUND
}

/// Forces of the muscles that have a column, named after the muscle or by its path in OpenSim.
fn muscle_forces(files: &Files, file: &SourceFile) -> Result<MuscleForces> {
    let columns = Columns::new(file, 0.0)?;
    covers(file, "muscle forces", [columns.time[0], columns.time[columns.time.len() - 1]], files.window)?;
    let short = |name: &str| name.trim_end_matches("/tendon_force").rsplit('/').next().unwrap_or(name).to_owned();
    if let Some(muscle) = files.skeleton.muscles.iter().find(|muscle| !muscle.has_path()) {
        let message =
            format!("the muscle `{}` has a fitted length, but no path: where it pulls is unknown", muscle.name);
        let help = "use the model with paths; the forces may be those of one with fitted lengths";
        return Err(file.error(None, message, "", Some(help.to_owned())));
    }
    let (mut forces, mut used, mut without) = (Vec::new(), Vec::new(), Vec::new());
    for (m, muscle) in files.skeleton.muscles.iter().enumerate() {
        match columns.text.names.iter().find(|name| short(name) == muscle.name) {
            Some(name) => {
                let values = columns.numbers(name, &format!("the muscle `{}`", muscle.name), &|_| true)?;
                used.push((name.as_str(), values.iter().fold(0.0f64, |a, x| a.max(x.abs()))));
                forces.push((m, columns.spline(&values)));
            }
            None => without.push(muscle.name.as_str()),
        }
    }
    if forces.is_empty() {
        let first = files.skeleton.muscles.first().map_or("a muscle", |muscle| &muscle.name);
        let help = format!("name columns after the model's muscles, such as `{first}`, with forces in N");
        return Err(columns.text.error(file, "no column is a muscle of the model", &help));
    }
    if !without.is_empty() {
        note(&format!("note: without a column, taken as 0 N: {}", without.join(", ")));
    }
    let is_other = |name: &&str| !name.starts_with("time") && used.iter().all(|(own, _)| own != name);
    let others: Vec<&str> = columns.text.names.iter().map(String::as_str).filter(is_other).collect();
    if let Some(first) = others.first() {
        let count = counted(others.len(), "other column");
        note(&format!("note: {count} (`{first}` …) ignored: joints carry what actuators make in their moments"));
    }
    if used.iter().all(|(_, peak)| *peak <= LARGEST_ACTIVATION) {
        note("warning: no muscle force is above 1.5 N: are these activations?");
    }
    Ok(MuscleForces { forces })
}

#[derive(Default)]
struct Rows {
    time: Vec<Option<f64>>,
    joint: Vec<usize>,
    frame: Vec<Option<String>>,
    /// Components of force and moment.
    components: [Vec<Option<f64>>; 6],
    force: Vec<Option<f64>>,
    body_weights: Vec<Option<f64>>,
}

impl Rows {
    fn add(&mut self, time: f64, joint: usize, name: &str, load: &JointLoad, frame: &Frame<f64>, weight: f64) {
        let turned = |x: &Vector| Frame { origin: [0.0; 3], ..*frame }.inverse().point(x);
        let all = turned(&load.force).into_iter().chain(turned(&load.moment));
        self.components.iter_mut().zip(all).for_each(|(column, value)| column.push(Some(value)));
        let size = norm(&load.force);
        self.time.push(Some(time));
        self.joint.push(joint);
        self.frame.push(Some(name.to_owned()));
        self.force.push(Some(size));
        self.body_weights.push((weight > 0.0).then_some(size / weight));
    }

    fn table(&self, files: &Files) -> Table {
        let skeleton = &files.skeleton;
        let text = |of: &dyn Fn(usize) -> String| Values::Text(self.joint.iter().map(|&j| Some(of(j))).collect());
        let ground = || "ground".to_owned();
        let parent = |j: usize| skeleton.joints[j].parent.map_or_else(ground, |b| skeleton.bodies[b].name.clone());
        let mut columns = vec![
            ("time_s".to_owned(), Values::Number(self.time.clone())),
            ("joint".to_owned(), text(&|j| skeleton.joints[j].name.clone())),
            ("parent".to_owned(), text(&parent)),
            ("child".to_owned(), text(&|j| skeleton.bodies[skeleton.joints[j].child].name.clone())),
            ("frame".to_owned(), Values::Text(self.frame.clone())),
        ];
        let names = ["force_x_n", "force_y_n", "force_z_n", "moment_x_n_m", "moment_y_n_m", "moment_z_n_m"];
        let components = names.into_iter().zip(&self.components);
        columns.extend(components.map(|(name, values)| (name.to_owned(), Values::Number(values.clone()))));
        columns.push(("force_n".to_owned(), Values::Number(self.force.clone())));
        columns.push(("force_body_weights".to_owned(), Values::Number(self.body_weights.clone())));
        Table { name: "joint_loads", columns }
    }

    /// The largest load of each joint.
    fn peaks(&self, files: &Files) -> Vec<String> {
        let peak = |j: usize| {
            let own =
                self.joint.iter().zip(self.force.iter().zip(&self.body_weights)).filter(|(joint, _)| **joint == j);
            own.fold((0.0f64, 0.0f64), |(n, bw), (_, (force, weights))| {
                (n.max(force.unwrap_or(0.0)), bw.max(weights.unwrap_or(0.0)))
            })
        };
        let line = |(j, joint): (usize, &Joint)| {
            let (force, weights) = peak(j);
            let weights =
                if weights > 0.0 { format!(" ({weights:.2} times the model's weight)") } else { String::new() };
            format!("{}: up to {force:.0} N{weights}", joint.name)
        };
        files.skeleton.joints.iter().enumerate().filter(|(_, joint)| is_real(files, joint)).map(line).collect()
    }
}
