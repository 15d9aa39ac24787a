//! Eq. (16), the motion's distance from the measured one (thesis, Paper B): `½‖J_q x − q_exp‖²`, over all coordinates at all
//! measured instants; of a spatial model in the metric of its bodies
//! ([`Mechanics::tracking_rows`](crate::model::Mechanics::tracking_rows)).

use super::{Goal, Sample, Shape};
use crate::problem::quantity::QuantityId;

/// A row of the tracking term: coordinates with their factors.
pub type Row = Vec<(usize, f64)>;

/// `times` in s; `measured` and `rows`: for each instant.
pub fn tracking(coordinates: QuantityId, times: &[f64], measured: &[Vec<f64>], rows: Vec<Vec<Row>>) -> Goal {
    let instants = times.iter().zip(measured).zip(rows);
    let sample = |time: f64, q: &[f64], members: Row| {
        let target = members.iter().map(|&(member, factor)| factor * q[member]).sum();
        Sample { time, quantity: coordinates, members, weight: 1.0, target }
    };
    let samples = instants.flat_map(|((&t, q), rows)| rows.into_iter().map(move |row| sample(t, q, row))).collect();
    Goal { name: "tracking", shape: Shape::Square, samples }
}
