//! External loads: forces and moments on bodies over time, such as ground reactions, from a table.
//!
//! A force and its point, both in the ground's frame, are interpolated as a wrench about the ground's origin: a centre of
//! pressure is arbitrary where the force is nearly zero, and a curve through it far away would move the force beside it. In
//! the frame of a body points stay near it, and force and point are interpolated as they are.

use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;

use super::columns::{Columns, Curve, vector_at};
use crate::error::{Result, SourceFile, nearest};
use crate::skeleton::Skeleton;
use crate::skeleton::file::GROUND;
use crate::skeleton::frame::{Frame, Vector, cross};

/// A file of external loads.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadsFile {
    /// The table with the columns, .csv, .sto or .mot, relative to this file.
    pub table: Spanned<String>,
    /// The loads.
    pub external_load: Vec<Spanned<LoadEntry>>,
}

/// A force on a body, and the columns that hold it: `<prefix>x`, `<prefix>y`, `<prefix>z`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadEntry {
    /// Name of the load.
    pub name: String,
    /// The body it acts on.
    pub body: String,
    /// The body in whose axes force and moment are given.
    #[serde(default = "ground")]
    pub force_in: String,
    /// The body in whose frame the point is given.
    #[serde(default = "ground")]
    pub point_in: String,
    /// Prefix of the columns of the force, N.
    pub force: Option<String>,
    /// Prefix of the columns of its point, m; the body's origin if absent.
    pub point: Option<String>,
    /// Prefix of the columns of a moment beside it, N m.
    pub moment: Option<String>,
}

fn ground() -> String {
    GROUND.to_owned()
}

/// Loads over time.
#[derive(Clone, Debug, PartialEq)]
pub struct ExternalLoads {
    pub loads: Vec<ExternalLoad>,
    /// First and last instant, s.
    pub span: [f64; 2],
}

/// A load over time.
#[derive(Clone, Debug, PartialEq)]
pub struct ExternalLoad {
    pub name: String,
    /// Index of the body.
    pub body: usize,
    course: Course,
}

#[derive(Clone, Debug, PartialEq)]
enum Course {
    /// Moment about the ground's origin and force, in its axes.
    Wrench { moment: Curve, force: Curve },
    /// Force and moment in the axes of a body (`None`: the ground), at a point in a body's frame.
    Apart {
        axes: Option<usize>,
        force: Option<Curve>,
        moment: Option<Curve>,
        frame: Option<usize>,
        point: Option<Curve>,
    },
}

/// A force (N) and a moment (N m) in the ground's axes, at a point of the ground (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadAt {
    pub point: Vector,
    pub force: Vector,
    pub moment: Vector,
}

impl LoadAt {
    /// N m
    pub fn moment_about_origin(&self) -> Vector {
        let of_force = cross(&self.point, &self.force);
        [0, 1, 2].map(|i| self.moment[i] + of_force[i])
    }
}

impl ExternalLoad {
    /// The load at time `t` (s), the bodies having these frames.
    pub fn at(&self, t: f64, frames: &[Frame<f64>]) -> LoadAt {
        match &self.course {
            Course::Wrench { moment, force } => {
                LoadAt { point: [0.0; 3], force: vector_at(force, t), moment: vector_at(moment, t) }
            }
            Course::Apart { axes, force, moment, frame, point } => {
                let turned = |curve: &Option<Curve>| {
                    let x = curve.as_ref().map_or([0.0; 3], |curve| vector_at(curve, t));
                    axes.map_or(x, |body| Frame { origin: [0.0; 3], ..frames[body] }.point(&x))
                };
                let point = match (point, frame) {
                    (None, _) => frames[self.body].origin,
                    (Some(point), None) => vector_at(point, t),
                    (Some(point), Some(body)) => frames[*body].point(&vector_at(point, t)),
                };
                LoadAt { point, force: turned(force), moment: turned(moment) }
            }
        }
    }
}

impl ExternalLoads {
    /// Puts loads together: `entries` of a file, each with the bytes where it stands; `table`: that with the columns;
    /// `smoothing_hz`: cut-off of the low-pass on forces, moments and points, 0 for none.
    ///
    /// # Errors
    /// If a body or a column is missing, or a number is not finite.
    pub fn new(
        source: &SourceFile,
        entries: &[(LoadEntry, Range<usize>)],
        table: &SourceFile,
        skeleton: &Skeleton,
        smoothing_hz: f64,
    ) -> Result<Self> {
        let columns = Columns::new(table, smoothing_hz)?;
        let loads = entries.iter().map(|(entry, place)| {
            let body = |name: &str| {
                let index = skeleton.bodies.iter().position(|body| body.name == name && name != GROUND);
                index.map(Some).or((name == GROUND).then_some(None)).ok_or_else(|| {
                    let names = skeleton.bodies.iter().map(|body| body.name.as_str());
                    let near =
                        nearest(name, names.clone()).map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
                    let help = format!("{near}the bodies are: {}", names.collect::<Vec<_>>().join(", "));
                    let message = format!("the load `{}` names `{name}`, which is no body of the model", entry.name);
                    source.error(Some(place.clone()), message, "here", Some(help))
                })
            };
            let Some(on) = body(&entry.body)? else {
                let help = "name the body that the force acts on".to_owned();
                let message = format!("the load `{}` acts on the ground", entry.name);
                return Err(source.error(Some(place.clone()), message, "here", Some(help)));
            };
            if entry.force.is_none() && entry.moment.is_none() {
                let help = "name the columns of a force or a moment".to_owned();
                let message = format!("the load `{}` has neither a force nor a moment", entry.name);
                return Err(source.error(Some(place.clone()), message, "here", Some(help)));
            }
            let course = course(&columns, entry, body(&entry.force_in)?, body(&entry.point_in)?)?;
            Ok(ExternalLoad { name: entry.name.clone(), body: on, course })
        });
        let span = [columns.time[0], columns.time[columns.time.len() - 1]];
        Ok(Self { loads: loads.collect::<Result<_>>()?, span })
    }
}

fn course(columns: &Columns<'_>, entry: &LoadEntry, axes: Option<usize>, frame: Option<usize>) -> Result<Course> {
    let user = format!("the load `{}`", entry.name);
    let vectors = |prefix: &Option<String>| columns.vectors(prefix, &user, &|_| true);
    let (force, moment) = (vectors(&entry.force)?, vectors(&entry.moment)?);
    // Where there is no force its point does not matter, and force plates leave it out.
    let pushes = |k: usize| force.as_ref().is_some_and(|force| force[k] != [0.0; 3]);
    let point = columns.vectors(&entry.point, &user, &pushes)?;
    if let (None, None, Some(force), Some(point)) = (axes, frame, &force, &point) {
        let about_origin = |i: usize| {
            let moment = moment.as_ref().map_or([0.0; 3], |moment| moment[i]);
            LoadAt { point: point[i], force: force[i], moment }.moment_about_origin()
        };
        let moment: Vec<Vector> = (0..force.len()).map(about_origin).collect();
        return Ok(Course::Wrench { moment: columns.curve(&moment), force: columns.curve(force) });
    }
    let [force, point, moment] = [force, point, moment].map(|x| x.map(|vectors| columns.curve(&vectors)));
    Ok(Course::Apart { axes, force, moment, frame, point })
}
