//! What reserves and other actuators contribute, and the net moments at the joint coordinates.

use nalgebra::DMatrix;

use super::Solution;
use crate::methods::Drive;
use crate::outcome::ReserveRow;

impl Solution<'_> {
    /// A row for each reserve and actuator.
    pub fn reserve_rows(&self) -> Vec<ReserveRow> {
        let locals = self.complete_locals();
        let weights = self.scheme_weights();
        self.inverse.actuators.iter().map(|drive| self.reserve_row(drive, &locals, &weights)).collect()
    }

    fn reserve_row(&self, drive: &Drive<'_>, locals: &[Vec<f64>], weights: &[f64]) -> ReserveRow {
        let values: Vec<f64> = locals.iter().map(|z| drive.moment * z[drive.control]).collect();
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, |a: f64, v| a.max(v.abs()));
        let peak = largest(&mut values.iter().copied());
        let square: f64 = weights.iter().zip(&values).map(|(w, v)| w * v * v).sum();
        let rms = (square / self.duration()).sqrt();
        let net: Option<Vec<f64>> = locals.iter().map(|z| self.net_moment(drive, z)).collect();
        let net = net.map(|net| largest(&mut net.into_iter())).filter(|net| *net > 0.0);
        let is_angle = drive.joint.kind.is_angular();
        ReserveRow {
            coordinate: drive.joint.coordinate.clone().unwrap_or_default(),
            actuator: drive.name.clone(),
            is_reserve: drive.is_reserve,
            peak_moment_n_m: is_angle.then_some(peak),
            rms_moment_n_m: is_angle.then_some(rms),
            peak_force_n: (!is_angle).then_some(peak),
            rms_force_n: (!is_angle).then_some(rms),
            share: net.map(|net| peak / net),
        }
    }

    /// The moment (N m) or force (N) of all muscles and actuators at the joint coordinate of `drive`: their work along the
    /// motion in which this coordinate changes at a rate of 1 and all others stay. `None` if joints that close a loop
    /// allow no such motion.
    fn net_moment(&self, drive: &Drive<'_>, z: &[f64]) -> Option<f64> {
        let q = self.inverse.motion.all.of(z);
        let planar = self.model().planar()?;
        let index = planar.coordinates_of_joints().position(|(joint, _)| joint.name == drive.joint.name)?;
        let along: DMatrix<f64> = planar.coordinate_directions(q)?;
        let mut moment = 0.0;
        for (m, muscle) in self.model().muscles.iter().enumerate() {
            let mut path = muscle.path.buffer();
            muscle.path.length(q, false, &mut path);
            let slots = muscle.path.slots().iter().zip(&path.gradient);
            let slope: f64 = slots.map(|(&slot, gradient)| gradient * along[(slot, index)]).sum();
            moment -= muscle.max_isometric_force * self.inverse.fibre_force(z, m) * slope;
        }
        let same = self.inverse.actuators.iter().filter(|other| other.joint.name == drive.joint.name);
        Some(moment + same.map(|other| other.moment * z[other.control]).sum::<f64>())
    }

    /// The quadrature weights of the points where every function has a value, s.
    pub(super) fn scheme_weights(&self) -> Vec<f64> {
        let points = self.problem.points.iter();
        self.problem.scheme.quadrature().into_iter().zip(points).filter(|(_, p)| p.complete).map(|(w, _)| w).collect()
    }
}
