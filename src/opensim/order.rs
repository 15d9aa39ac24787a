//! Where on its path a muscle meets its surfaces: which parts of the path, and in which order. OpenSim leaves both open: of all parts it takes
//! the one that a surface makes longer by the least, and a cylinder only where the path touches it between its ends.

use std::collections::HashMap;

use crate::skeleton::file::{ObstacleEntry, SkeletonFile};
use crate::skeleton::frame::{Vector, along, dot, minus, norm};
use crate::skeleton::path::Obstacle;
use crate::skeleton::surface::Surface;
use crate::skeleton::{Muscle, Skeleton};

/// Poses that are looked at.
const POSES: u32 = 64;

/// Ranges of coordinates, rad or m, by name.
pub type Ranges<'d> = HashMap<&'d str, [f64; 2]>;

/// Puts the surfaces of each muscle on the parts where they are met in any of some poses, in the order of the path in the default pose.
pub fn arrange(file: &mut SkeletonFile, skeleton: &Skeleton, ranges: &Ranges<'_>) {
    let poses = poses(skeleton, ranges);
    for (entry, muscle) in file.muscle.iter_mut().zip(&skeleton.muscles) {
        let ways: Vec<Way> = poses.iter().map(|pose| Way::of(skeleton, muscle, pose)).collect();
        let mut placed: Vec<(f64, ObstacleEntry)> = Vec::new();
        for obstacle in &muscle.path.surfaces {
            let surface = &skeleton.surfaces[obstacle.surface];
            let met: Vec<usize> = ways.iter().filter_map(|way| way.part(obstacle, surface)).collect();
            let place = ways[0].nearest(surface);
            let name = surface.name.clone();
            // Where no pose meets it, the nearest part.
            let nearest = [place.floor() as usize; 2].map(|part| part.min(muscle.path.points.len() - 2));
            let [first, last] = match (met.iter().min(), met.iter().max(), obstacle.parts) {
                (Some(&first), Some(&last), _) => [first, last],
                (_, _, Some(parts)) => parts,
                _ => nearest,
            };
            let entry = match [first, last] {
                [0, last] if last + 2 == muscle.path.points.len() => ObstacleEntry::Any(name),
                [first, last] if first == last => ObstacleEntry::Part { name, part: first },
                parts => ObstacleEntry::Parts { name, parts },
            };
            placed.push((place, entry));
        }
        placed.sort_by(|a, b| a.0.total_cmp(&b.0));
        entry.surfaces = placed.into_iter().map(|(_, entry)| entry).collect();
    }
}

/// The default pose, and poses spread over the ranges of the coordinates.
fn poses(skeleton: &Skeleton, ranges: &Ranges<'_>) -> Vec<Vec<f64>> {
    let spread = |pose: u32| {
        let mut q: Vec<f64> = (skeleton.coordinates.iter().enumerate())
            .map(|(k, coordinate)| match ranges.get(coordinate.name.as_str()) {
                Some([low, high]) if !coordinate.locked && (low..=high).contains(&&coordinate.default) => {
                    // Beyond what joints do there is nothing to see.
                    let reach = if coordinate.is_angle { std::f64::consts::FRAC_PI_2 } else { 0.1 };
                    let (low, high) = (low.max(coordinate.default - reach), high.min(coordinate.default + reach));
                    low + (high - low) * f64::from(sobol_burley::sample(pose, (k % 256) as u32, 1))
                }
                _ => coordinate.default,
            })
            .collect();
        skeleton.follow(&mut q);
        q
    };
    [skeleton.default_pose()].into_iter().chain((0..POSES).map(spread)).collect()
}

/// A path in one pose, straight.
struct Way {
    /// In the ground's frame, and its number.
    points: Vec<(usize, Vector)>,
    frames: Vec<crate::skeleton::frame::Frame<f64>>,
}

impl Way {
    fn of(skeleton: &Skeleton, muscle: &Muscle, q: &[f64]) -> Self {
        let frames = skeleton.frames(q);
        let met = muscle.path.points.iter().enumerate().filter(|(_, point)| point.is_met(q));
        let points = met.map(|(k, point)| (k, frames[point.body].point(&point.local(q)))).collect();
        Self { points, frames }
    }

    /// The part that a surface makes longer by the least, if it touches any.
    fn part(&self, obstacle: &Obstacle, surface: &Surface) -> Option<usize> {
        let inside = (self.frames[surface.body] * surface.frame).inverse();
        let longer = |pair: &[(usize, Vector)]| {
            if !obstacle.meets(pair[0].0, pair[1].0) {
                return None;
            }
            let (a, b) = (inside.point(&pair[0].1), inside.point(&pair[1].1));
            let contact = surface.shape.contact(&a, &b)?;
            let way = norm(&minus(&contact.first, &a)) + contact.length + norm(&minus(&b, &contact.last));
            Some((way - norm(&minus(&b, &a)), pair[0].0))
        };
        self.points.windows(2).filter_map(longer).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, part)| part)
    }

    /// The place of the path nearest to a surface's centre: a part, and how far along it.
    fn nearest(&self, surface: &Surface) -> f64 {
        let centre = self.frames[surface.body].point(&surface.frame.origin);
        let on = |pair: &[(usize, Vector)]| {
            let (a, way) = (pair[0].1, minus(&pair[1].1, &pair[0].1));
            let share = (dot(&minus(&centre, &a), &way) / dot(&way, &way).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            (norm(&minus(&centre, &along(&a, share, &way))), pair[0].0 as f64 + share)
        };
        self.points.windows(2).map(on).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0.0, |(_, place)| place)
    }
}
