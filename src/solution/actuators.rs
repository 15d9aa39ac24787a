//! What reserves and other actuators contribute, and the net moments at the joint coordinates.

use nalgebra::DMatrix;

use super::Solution;
use crate::methods::Drive;
use crate::methods::inverse_dynamics::spatial::{residuals, weight};
use crate::outcome::ReserveRow;

impl Solution<'_> {
    /// A row for each reserve and actuator.
    pub fn reserve_rows(&self) -> Vec<ReserveRow> {
        if self.inverse.actuators.is_empty() {
            return Vec::new();
        }
        let locals = self.complete_locals();
        let weights = self.weights();
        let (residuals, unit) = self.residuals();
        let net: Option<Vec<Vec<f64>>> = locals.iter().map(|z| self.net_moments(z)).collect();
        let row = |drive: &Drive<'_>| {
            let values: Vec<f64> = locals.iter().map(|z| drive.own.moment * z[drive.control]).collect();
            let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, |a: f64, v| a.max(v.abs()));
            let peak = largest(&mut values.iter().copied());
            let square: f64 = weights.iter().zip(&values).map(|(w, v)| w * v * v).sum();
            let rms = (square / self.duration()).sqrt();
            let net = net.as_ref().map(|net| largest(&mut net.iter().map(|moments| moments[drive.own.number])));
            let is_angle = drive.own.coordinate.is_angle;
            ReserveRow {
                coordinate: drive.own.coordinate.name.to_owned(),
                actuator: drive.own.name.clone(),
                is_reserve: drive.own.is_reserve,
                peak_moment_n_m: is_angle.then_some(peak),
                rms_moment_n_m: is_angle.then_some(rms),
                peak_force_n: (!is_angle).then_some(peak),
                rms_force_n: (!is_angle).then_some(rms),
                share: if residuals.contains(&drive.own.coordinate.name) {
                    Some(peak / unit)
                } else {
                    net.filter(|net| *net > 0.0).map(|net| peak / net)
                },
            }
        };
        self.inverse.actuators.iter().map(row).collect()
    }

    /// Names of the coordinates of a floating base, where all that acts is a residual, and what residuals are measured by: the
    /// weight of all bodies, N (times 1 m).
    fn residuals(&self) -> (Vec<&str>, f64) {
        let Some(spatial) = self.model().spatial() else { return (Vec::new(), 1.0) };
        let (skeleton, weight) = (&spatial.skeleton, weight(&spatial.skeleton));
        let names = residuals(skeleton, &spatial.linkage.tree);
        let names = names.into_iter().map(|c| skeleton.coordinates[c].name.as_str()).collect();
        (names, if weight > 0.0 { weight } else { 1.0 })
    }

    /// The moments (N m) or forces (N) of all muscles and actuators at the joint coordinates: their work along the motion in
    /// which one coordinate changes at a rate of 1 and all others stay. `None` if joints that close a loop, or have no
    /// coordinate, leave that motion open.
    pub(super) fn net_moments(&self, z: &[f64]) -> Option<Vec<f64>> {
        let q = self.inverse.motion.all.of(z);
        let along: DMatrix<f64> = self.model().mechanics.coordinate_directions(q)?;
        let mut moments = vec![0.0; along.ncols()];
        for (m, muscle) in self.model().muscles.iter().enumerate() {
            let mut path = muscle.path.buffer();
            muscle.path.length(q, false, &mut path);
            let force = muscle.max_isometric_force * self.inverse.fibre_force(z, m);
            for (&slot, gradient) in muscle.path.slots().iter().zip(&path.gradient) {
                moments.iter_mut().enumerate().for_each(|(k, moment)| *moment -= force * gradient * along[(slot, k)]);
            }
        }
        for drive in &self.inverse.actuators {
            moments[drive.own.number] += drive.own.moment * z[drive.control];
        }
        Some(moments)
    }
}
