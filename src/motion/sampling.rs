//! From a motion table to coordinates at the measured instants: smoothing, resampling, offsets, assembly of the
//! joints, noise.

use std::sync::Arc;

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};

use super::MotionTable;
use super::joint_motion::{CoordinateFunction, JointMotion};
use super::low_pass::smooth_spline;
use super::surroundings::{Load, Surroundings};
use crate::deadline::Deadline;
use crate::model::Model;
use crate::model::assembly::CannotAssemble;
use crate::model::planar::Planar;
use crate::model::spatial::Spatial;
use crate::numerics::cubic::{CubicSpline, Ends};

/// How a study resamples and modifies a motion before tracking.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionSettings {
    /// There are `measurement_ratio · (p − 1) + 1` equidistant measured instants for p collocation points.
    pub measurement_ratio: usize,
    /// Cut-off frequency of the zero-lag second-order Butterworth low-pass, Hz; 0 for no filter.
    pub smoothing_hz: f64,
    /// Standard deviation of the Gaussian noise added to every coordinate, m and rad.
    pub noise_sd: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Factor on the duration.
    pub time_scale: f64,
    /// (joint coordinate, offset in SI units, factor on the excursion from its first value)
    pub changes: Vec<(String, f64, f64)>,
}

/// The measured coordinates.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Measured instants (`p̂`), s from the start of the motion.
    pub times: Vec<f64>,
    /// `p̂ × nq`, noise included.
    pub coordinates: Vec<Vec<f64>>,
    /// Time of the start of the motion in the motion file, s.
    pub clock: f64,
}

/// Largest change of an angle (rad) or a displacement (m) that closing a loop may make: what measurement error
/// explains.
const MAX_ANGLE_CHANGE: f64 = 2.0 * std::f64::consts::PI / 180.0;
const MAX_DISPLACEMENT_CHANGE: f64 = 5e-3;

/// Instants beyond both ends of the motion through which splines go, if there are any: what is farther does not matter.
const MARGIN: usize = 20;

/// Instants of a planar motion that is given.
const FINE_INSTANTS: usize = 401;

/// Why there is no measurement.
#[derive(Debug)]
pub enum MeasurementError {
    /// The joints of the model cannot be closed at this time (s).
    CannotClose(f64, CannotAssemble),
    /// Closing the joints changes a joint coordinate by more than [`MAX_ANGLE_CHANGE`] or [`MAX_DISPLACEMENT_CHANGE`].
    InconsistentMotion {
        /// s
        time: f64,
        coordinate: String,
        /// rad or m
        wanted: f64,
        found: f64,
        is_angle: bool,
    },
    /// The deadline has passed.
    DeadlinePassed,
}

/// The first joint coordinate that closing the joints has changed too much: its name, the value wanted and the value
/// found (rad or m), and whether it is an angle.
fn changed_coordinate<'p>(planar: &'p Planar, given: &[Option<f64>], q: &[f64]) -> Option<(&'p str, f64, f64, bool)> {
    let (turn, half_turn) = (std::f64::consts::TAU, std::f64::consts::PI);
    planar.coordinates_of_joints().zip(given).find_map(|((joint, name), wanted)| {
        let (wanted, found, is_angle) = ((*wanted)?, joint.coordinate_value(q).value, joint.kind.is_angular());
        let change = found - wanted;
        let change = if is_angle { (change + half_turn).rem_euclid(turn) - half_turn } else { change };
        (change.abs() > if is_angle { MAX_ANGLE_CHANGE } else { MAX_DISPLACEMENT_CHANGE }).then_some((
            name,
            wanted,
            wanted + change,
            is_angle,
        ))
    })
}

impl std::fmt::Display for MeasurementError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            MeasurementError::CannotClose(time, gap) => write!(
                f,
                "the joints cannot all be closed at t = {time:.4} s: {} remain open by up to {:.3e} m or rad, and no \
                 small change of the pose reduces this gap (slope {:.1e}); check the body lengths in this loop",
                gap.joints.join(", "),
                gap.gap,
                gap.slope
            ),
            MeasurementError::InconsistentMotion { time, coordinate, wanted, found, is_angle } => {
                let (factor, unit) = if *is_angle { (1f64.to_degrees(), "°") } else { (1e3, " mm") };
                let (wanted, found) = (factor * wanted, factor * found);
                write!(
                    f,
                    "the joints cannot follow this motion: at t = {time:.4} s `{coordinate}` should be \
                     {wanted:.1}{unit}, but the joints close only at {found:.1}{unit}"
                )
            }
            MeasurementError::DeadlinePassed => {
                write!(f, "the job reached its time limit before it was set up; raise time_limit_s")
            }
        }
    }
}

impl MotionSettings {
    /// (offset, factor) of a joint coordinate.
    fn change(&self, name: &str) -> (f64, f64) {
        self.changes.iter().find(|(n, ..)| n == name).map_or((0.0, 1.0), |c| (c.1, c.2))
    }

    /// A spline through the smoothed values of a column.
    fn spline(&self, table: &MotionTable, values: &[f64]) -> CubicSpline {
        smooth_spline(&table.time, values, self.smoothing_hz)
    }

    /// Samples the motion at the measured instants that belong to `points` collocation points.
    ///
    /// # Errors
    /// If the joints cannot be closed at some instant, or the deadline passes.
    pub fn measure(
        &self,
        table: &MotionTable,
        model: &Model,
        points: usize,
        deadline: Deadline,
    ) -> Result<Measurement, MeasurementError> {
        let count = self.measurement_ratio * (points - 1) + 1;
        let step = table.duration() / (count - 1) as f64;
        let times: Vec<f64> = (0..count).map(|i| i as f64 * step * self.time_scale).collect();
        let mut coordinates = match model.spatial() {
            None => {
                let planar = model.planar().expect("a model is planar or spatial");
                let at: Vec<f64> = (0..count).map(|i| table.start() + i as f64 * step).collect();
                self.assembled(table, planar, &at, deadline)?
            }
            Some(spatial) => {
                let motion = self.joint_motion(table, spatial);
                let mut coordinates: Vec<Vec<f64>> = Vec::with_capacity(count);
                for &t in &times {
                    if deadline.passed() {
                        return Err(MeasurementError::DeadlinePassed);
                    }
                    let q = motion.measured(t, coordinates.last().map(Vec::as_slice));
                    coordinates.push(q);
                }
                coordinates
            }
        };
        if self.noise_sd > 0.0 {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(self.seed);
            let normal = Normal::new(0.0, self.noise_sd).expect("a positive standard deviation");
            coordinates.iter_mut().flatten().for_each(|x| *x += normal.sample(&mut rng));
        }
        Ok(Measurement { times, coordinates, clock: table.start() })
    }

    /// The coordinates that move by forces over time since the start of the motion, s.
    ///
    /// # Errors
    /// As for [`MotionSettings::measure`].
    pub fn followed(
        &self,
        table: &MotionTable,
        model: &Model,
        deadline: Deadline,
    ) -> Result<Vec<CubicSpline>, MeasurementError> {
        let of_table = |t: f64| (t - table.start()) * self.time_scale;
        let Some(spatial) = model.spatial() else {
            // Bodies turn about their joints between the rows of a table: instants close to one another keep these closed.
            let planar = model.planar().expect("a model is planar or spatial");
            let step = table.duration() / (FINE_INSTANTS - 1) as f64;
            let at: Vec<f64> = (0..FINE_INSTANTS).map(|i| table.start() + i as f64 * step).collect();
            let coordinates = self.assembled(table, planar, &at, deadline)?;
            let spline = |i: usize| {
                let points = at.iter().map(|&t| of_table(t)).zip(coordinates.iter().map(|q| q[i]));
                CubicSpline::new(&points.collect::<Vec<_>>(), Ends::Differenced)
            };
            return Ok((0..model.mechanics.coordinates()).map(spline).collect());
        };
        let [first, last] = [table.start(), table.start() + table.duration()];
        let from = table.time.partition_point(|&t| t < first).saturating_sub(MARGIN);
        let to = (table.time.partition_point(|&t| t <= last) + MARGIN).min(table.time.len());
        let times: Vec<f64> = table.time[from..to].iter().map(|&t| of_table(t)).collect();
        let motion = self.joint_motion(table, spatial);
        let mut coordinates: Vec<Vec<f64>> = Vec::with_capacity(times.len());
        for &t in &times {
            if deadline.passed() {
                return Err(MeasurementError::DeadlinePassed);
            }
            coordinates.push(motion.measured(t, coordinates.last().map(Vec::as_slice)));
        }
        let spline = |i: usize| {
            let points: Vec<(f64, f64)> = times.iter().copied().zip(coordinates.iter().map(|q| q[i])).collect();
            CubicSpline::new(&points, Ends::Natural)
        };
        Ok((0..model.mechanics.coordinates()).map(spline).collect())
    }

    /// Body coordinates of a planar model with its joints closed, one row per instant. `at`: times of the table, s.
    fn assembled(
        &self,
        table: &MotionTable,
        planar: &Planar,
        at: &[f64],
        deadline: Deadline,
    ) -> Result<Vec<Vec<f64>>, MeasurementError> {
        let columns: Vec<(Option<CubicSpline>, (f64, f64))> = planar
            .coordinates_of_joints()
            .map(|(_, name)| (table.column(name).map(|values| self.spline(table, values)), self.change(name)))
            .collect();
        let mut coordinates: Vec<Vec<f64>> = Vec::with_capacity(at.len());
        for &at in at {
            if deadline.passed() {
                return Err(MeasurementError::DeadlinePassed);
            }
            let t = (at - table.start()) * self.time_scale;
            let given: Vec<Option<f64>> = columns
                .iter()
                .map(|(spline, (offset, scale))| {
                    let spline = spline.as_ref()?;
                    let first = spline.at(table.start())[0];
                    Some(first + offset + scale * (spline.at(at)[0] - first))
                })
                .collect();
            let q = planar.assemble(&given, coordinates.last().map(Vec::as_slice));
            let q = q.map_err(|gap| MeasurementError::CannotClose(t, gap))?;
            if let Some((coordinate, wanted, found, is_angle)) = changed_coordinate(planar, &given, &q) {
                return Err(MeasurementError::InconsistentMotion {
                    time: t,
                    coordinate: coordinate.to_owned(),
                    wanted,
                    found,
                    is_angle,
                });
            }
            coordinates.push(q);
        }
        Ok(coordinates)
    }

    /// The joint coordinates of a spatial model over time. Locked ones, and those without a column, keep their default.
    pub fn joint_motion(&self, table: &MotionTable, spatial: &Spatial) -> JointMotion {
        let coordinates = (spatial.skeleton.coordinates.iter())
            .map(|coordinate| match table.column(&coordinate.name) {
                Some(values) if !coordinate.locked => {
                    let spline = self.spline(table, values);
                    let (offset, scale) = self.change(&coordinate.name);
                    CoordinateFunction::Spline { first: spline.at(table.start())[0], spline, offset, scale }
                }
                None if !coordinate.locked => {
                    CoordinateFunction::Constant(coordinate.default + self.change(&coordinate.name).0)
                }
                _ => CoordinateFunction::Constant(coordinate.default),
            })
            .collect();
        let turns = spatial.skeleton.turns.iter().map(|turn| self.change(&turn.name).0).collect();
        let instants = table.time.iter().map(|t| (t - table.start()) * self.time_scale).collect::<Vec<_>>();
        JointMotion::new(spatial, coordinates, (table.start(), self.time_scale), turns, &instants)
    }

    /// External forces, and the motion of given coordinates.
    pub fn surroundings(&self, table: &MotionTable, model: &Model) -> Surroundings {
        let Some(spatial) = model.spatial() else { return Surroundings::constant(model) };
        let over_time = |name: &str, scale: f64| {
            let values = table.force(name)?;
            let spline = |axis: usize| {
                let points = table.time.iter().map(|t| (t - table.start()) * self.time_scale).zip(values[axis].clone());
                CubicSpline::new(&points.collect::<Vec<_>>(), Ends::Natural)
            };
            Some(Load::TimeVarying(Box::new([spline(0), spline(1), spline(2)]), scale))
        };
        let loads = (spatial.skeleton.forces.iter())
            .map(|force| match force.force {
                Some(constant) => Load::Constant(constant.map(|x| x * force.scale)),
                None => over_time(&force.name, force.scale).unwrap_or(Load::Constant([0.0; 3])),
            })
            .collect();
        let is_needed = !spatial.linkage.given.is_empty() || table.loads.is_some();
        let motion = is_needed.then(|| Arc::new(self.joint_motion(table, spatial)));
        Surroundings::new(loads, table.loads.clone(), motion)
    }
}
