//! `sinew joint-loads`: loads that joints carry in a motion with known muscle forces.

use std::path::Path;

use super::arguments::MovementArguments;
use super::layout::wrapped;
use super::movement::{Files, covers};
use super::output::{csv, write_table};
use super::{GOOD, print};
use crate::error::{Result, SourceFile};
use crate::methods::inverse_dynamics::weight;
use crate::methods::joint_loads::{JointLoad, MuscleForces, joint_loads};
use crate::motion::columns::Columns;
use crate::names::counted;
use crate::skeleton::Joint;
use crate::skeleton::file::GROUND;
use crate::skeleton::frame::{Frame, Vector, norm};
use crate::tables::{Table, Values};

pub fn run(arguments: &MovementArguments, forces: &Path) -> Result<u8> {
    let files = Files::read(arguments)?;
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
    match &arguments.out {
        None => print(csv(&table)?.trim_end()),
        Some(path) => {
            write_table(&table, vec![("sinew.model".to_owned(), files.skeleton.name.clone())], path)?;
            let lines = files.notes().into_iter().chain(missing(&files, &muscles)).chain(rows.peaks(&files));
            lines.for_each(|line| print(&wrapped(&line, "    ")));
            print(&format!("{}: {}", counted(movement.time.len(), "instant"), path.display()));
        }
    }
    Ok(GOOD)
}

/// The weld of the ground to itself carries nothing.
fn is_real(files: &Files, joint: &Joint) -> bool {
    files.skeleton.bodies[joint.child].name != GROUND
}

/// Forces of the muscles that have a column.
fn muscle_forces(files: &Files, file: &SourceFile) -> Result<MuscleForces> {
    let columns = Columns::new(file, 0.0)?;
    covers(file, "muscle forces", [columns.time[0], columns.time[columns.time.len() - 1]], files.window)?;
    let mut forces = Vec::new();
    for (m, muscle) in files.skeleton.muscles.iter().enumerate() {
        if columns.text.names.contains(&muscle.name) {
            forces.push((m, columns.spline(&columns.numbers(&muscle.name)?)));
        }
    }
    if forces.is_empty() {
        let first = files.skeleton.muscles.first().map_or("a muscle", |muscle| &muscle.name);
        let help = format!("name columns after the model's muscles, such as `{first}`, with forces in N");
        return Err(columns.text.error(file, "no column is a muscle of the model", &help));
    }
    Ok(MuscleForces { forces })
}

/// A note on muscles without a column.
fn missing(files: &Files, muscles: &MuscleForces) -> Option<String> {
    let names =
        files.skeleton.muscles.iter().enumerate().filter(|(m, _)| muscles.forces.iter().all(|(own, _)| own != m));
    let names: Vec<&str> = names.map(|(_, muscle)| muscle.name.as_str()).collect();
    (!names.is_empty()).then(|| format!("note: without a column, taken as 0 N: {}", names.join(", ")))
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
        self.body_weights.push(Some(size / weight));
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
            format!("{}: up to {force:.0} N ({weights:.2} times the model's weight)", joint.name)
        };
        files.skeleton.joints.iter().enumerate().filter(|(_, joint)| is_real(files, joint)).map(line).collect()
    }
}
