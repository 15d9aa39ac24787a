//! Loads that the joints of a spatial model carry (joint contact loads).

use super::Solution;
use crate::methods::inverse_dynamics::joint_loads::{Instant, JointLoad, loads_at};
use crate::methods::inverse_dynamics::spatial::weight;
use crate::model::spatial::Spatial;
use crate::model::tree::dynamics::State;
use crate::motion::external_loads::LoadAt;
use crate::outcome::JointRow;
use crate::skeleton::Muscle;
use crate::skeleton::file::GROUND;
use crate::skeleton::frame::{Frame, Vector, norm};

/// The joints' loads at one point, and the frames of the bodies.
struct Carried {
    loads: Vec<JointLoad>,
    frames: Vec<Frame<f64>>,
}

impl Solution<'_> {
    /// A row for each joint of a spatial model; none where muscles have no path.
    pub fn joint_rows(&self) -> Vec<JointRow> {
        let Some(spatial) = self.spatial_with_paths() else { return Vec::new() };
        let carried: Vec<Carried> = self.complete_locals().iter().map(|z| self.carried(spatial, z)).collect();
        let (weights, duration, body_weight) = (self.weights(), self.duration(), weight(&spatial.skeleton));
        let of_weight = |force: f64| (body_weight > 0.0).then(|| force / body_weight);
        let row = |j: usize| {
            let size = |of: fn(&JointLoad) -> &Vector| carried.iter().map(move |at| norm(of(&at.loads[j])));
            let mean = |values: &mut dyn Iterator<Item = f64>| {
                values.zip(&weights).map(|(value, weight)| value * weight).sum::<f64>() / duration
            };
            let peak = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
            let force = || size(|load| &load.force);
            let (mean_force, peak_force) = (mean(&mut force()), peak(&mut force()));
            JointRow {
                joint: spatial.skeleton.joints[j].name.clone(),
                mean_force_n: mean_force,
                peak_force_n: peak_force,
                mean_force_bw: of_weight(mean_force),
                peak_force_bw: of_weight(peak_force),
                mean_moment_n_m: mean(&mut size(|load| &load.moment)),
                peak_moment_n_m: peak(&mut size(|load| &load.moment)),
            }
        };
        real_joints(spatial).map(row).collect()
    }

    /// Hands the components of the joints' loads at a point to `push`: signal, name and value; in the axes of the ground, the
    /// parent and the child.
    pub(super) fn push_joints(&self, z: &[f64], push: &mut impl FnMut(&str, &str, f64)) {
        let Some(spatial) = self.spatial_with_paths() else { return };
        let Carried { loads, frames } = self.carried(spatial, z);
        for j in real_joints(spatial) {
            let joint = &spatial.skeleton.joints[j];
            let ground = Frame::identity();
            let parent = joint.parent.map_or(ground, |body| frames[body]);
            for (name, frame) in [("ground", ground), ("parent", parent), ("child", frames[joint.child])] {
                let back = Frame { origin: [0.0; 3], ..frame }.inverse();
                for (signal, load) in [("joint_force_n", loads[j].force), ("joint_moment_n_m", loads[j].moment)] {
                    for (axis, x) in ["x", "y", "z"].into_iter().zip(back.point(&load)) {
                        push(signal, &format!("{}.{name}.{axis}", joint.name), x);
                    }
                }
            }
        }
    }

    fn spatial_with_paths(&self) -> Option<&Spatial> {
        self.model().spatial().filter(|spatial| spatial.skeleton.muscles.iter().all(Muscle::has_path))
    }

    fn carried(&self, spatial: &Spatial, z: &[f64]) -> Carried {
        let (motion, linkage) = (&self.inverse.motion, &spatial.linkage);
        let q = motion.all.of(z);
        let rates = motion.rates.expect("a spatial model has velocities").of(z);
        let coordinates = linkage.coordinates(q);
        let (speeds, accelerations) = (linkage.rates(rates), linkage.rates(motion.all_accelerations.of(z)));
        let mut own = spatial.skeleton.default_pose();
        spatial.skeleton_coordinates(q, &mut own);
        let frames = linkage.frames(q);
        let reactions = self.reactions(z);
        let (external, _) = motion.loads.of(z).as_chunks::<3>();
        let loads = spatial.loads_at(q, external, &reactions).into_iter();
        let loads = loads.map(|load| (LoadAt { point: load.point, force: load.force, moment: load.moment }, load.body));
        let loads: Vec<(LoadAt, usize)> = loads.collect();
        let instant = Instant {
            skeleton: &spatial.skeleton,
            tree: &linkage.tree,
            state: State {
                coordinates: &coordinates,
                speeds: &speeds,
                accelerations: &accelerations,
                virtual_speeds: &[],
            },
            coordinates: &own,
            frames: &frames,
            loads: &loads,
        };
        let tensions = self.model().muscles.iter().enumerate().filter_map(|(m, muscle)| {
            let number = spatial.skeleton.muscles.iter().position(|own| own.name == muscle.name)?;
            Some((number, muscle.max_isometric_force * self.inverse.fibre_force(z, m)))
        });
        let tensions: Vec<(usize, f64)> = tensions.collect();
        Carried { loads: loads_at(&instant, &tensions), frames }
    }
}

/// Numbers of the joints but the weld of the ground to itself.
fn real_joints(spatial: &Spatial) -> impl Iterator<Item = usize> {
    let skeleton = &spatial.skeleton;
    (0..skeleton.joints.len()).filter(|&j| skeleton.bodies[skeleton.joints[j].child].name != GROUND)
}
