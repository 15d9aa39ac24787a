//! Of a planar model: the equations of motion of its bodies, projected on the motions that its joints allow.

use nalgebra::DVector;

use super::NetForce;
use crate::model::Mechanics;
use crate::model::mechanics::Motion;
use crate::model::planar::Planar;
use crate::motion::{MotionTable, smooth_spline};
use crate::numerics::cubic::CubicSpline;

/// The net forces at the instants `time` (s) of a motion, its coordinates low-passed at `smoothing_hz` (0: not).
///
/// # Errors
/// Why there are none, in words: a coordinate without a column, joints that cannot be closed, or that close a loop.
pub fn net_forces(
    planar: &Planar,
    table: &MotionTable,
    time: &[f64],
    smoothing_hz: f64,
) -> Result<Vec<NetForce>, String> {
    if planar.joints.len() > planar.bodies.len() {
        return Err("its joints close a loop, so that many moments make the same motion".to_owned());
    }
    let columns = planar.coordinates_of_joints().map(|(_, name)| {
        let values = table.column(name).ok_or_else(|| format!("the motion has no column for `{name}`"))?;
        Ok(smooth_spline(&table.time, values, smoothing_hz))
    });
    let columns = columns.collect::<Result<Vec<CubicSpline>, String>>()?;
    let mut poses: Vec<Vec<f64>> = Vec::with_capacity(table.time.len());
    for &t in &table.time {
        let given: Vec<Option<f64>> = columns.iter().map(|column| Some(column.at(t)[0])).collect();
        let pose = planar.assemble(&given, poses.last().map(Vec::as_slice));
        poses.push(pose.map_err(|open| format!("at {t} s these joints stay open: {}", open.joints.join(", ")))?);
    }
    let of_bodies: Vec<CubicSpline> = (0..planar.coordinates())
        .map(|i| smooth_spline(&table.time, &poses.iter().map(|q| q[i]).collect::<Vec<f64>>(), 0.0))
        .collect();
    let mut found: Vec<NetForce> = (planar.coordinates_of_joints())
        .map(|(joint, name)| NetForce {
            coordinate: name.to_owned(),
            is_angle: joint.kind.is_angular(),
            is_residual: false,
            values: Vec::with_capacity(time.len()),
        })
        .collect();
    for &t in time {
        let [q, velocity, acceleration] =
            [0, 1, 2].map(|level| of_bodies.iter().map(|x| x.at(t)[level]).collect::<Vec<f64>>());
        let mut force = vec![0.0; q.len()];
        let motion = Motion { q: &q, velocity: &velocity, acceleration: &acceleration };
        planar.force(motion, &planar.constant_loads(), &mut force);
        let Some(directions) = planar.coordinate_directions(&q) else {
            return Err(format!("at {t} s its joints allow a motion in which no coordinate changes"));
        };
        let net = directions.transpose() * DVector::from(force);
        found.iter_mut().zip(net.iter()).for_each(|(own, value)| own.values.push(*value));
    }
    Ok(found)
}
