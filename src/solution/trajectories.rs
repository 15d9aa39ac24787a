//! Functions of time.

use super::Solution;
use crate::nlp::polish::active;
use crate::outcome::TrajectoryRow;

/// Number of points at each end where reactions and accelerations of the midpoint scheme ring.
const END_POINTS: usize = 4;

impl Solution<'_> {
    /// Functions of time at the collocation points, and the measured coordinates at the measured instants. Times are
    /// those of the motion file, which `motion.time_scale` stretches from the start of the motion.
    pub fn trajectory_rows(&self) -> Vec<TrajectoryRow> {
        let (model, clock) = (self.model(), self.measurement.clock);
        let mut rows = Vec::new();
        let mut push = |t: f64, signal: &str, name: &str, value: f64, end_effect: bool| {
            rows.push(TrajectoryRow {
                time_s: clock + t,
                signal: signal.to_owned(),
                name: name.to_owned(),
                value,
                end_effect,
            });
        };
        self.push_measured(&mut push);
        let mut near = Vec::new();
        // Functions of degree 0 ring at both ends.
        let rings = self.inverse.motion.velocity.is_none() && !self.inverse.motion.is_given;
        let count = self.problem.scheme.points().len();
        for (j, (&t, z)) in self.problem.scheme.points().iter().zip(self.locals()).enumerate() {
            let end = rings && (j < END_POINTS || j + END_POINTS >= count);
            let (q, complete) = (self.inverse.motion.all.of(&z), self.problem.points[j].complete);
            for (i, name) in model.mechanics.coordinate_names().iter().enumerate().filter(|_| complete) {
                push(t, "acceleration", name, z[self.inverse.motion.accelerations.at(i)], end);
            }
            for (name, value) in model.mechanics.joint_coordinate_values(q, &mut near) {
                push(t, "joint_coordinate", name, value, false);
            }
            self.push_muscles(&mut push, (t, &z), complete);
            let paths = model.muscles.iter().map(|muscle| (muscle.name.as_str(), muscle.path.positions(q)));
            let lines = paths.map(|path| ("path_point_m", path));
            for (signal, (name, line)) in
                lines.chain(model.mechanics.bones(q).into_iter().map(|bone| ("bone_point_m", bone)))
            {
                for (k, place) in line.iter().enumerate() {
                    for (axis, x) in ["x", "y", "z"].iter().zip(place) {
                        push(t, signal, &format!("{name}.{k}.{axis}"), *x, false);
                    }
                }
            }
            if let Some(net) = complete.then(|| self.net_moments(&z)).flatten() {
                for (coordinate, value) in model.mechanics.driven_coordinates().iter().zip(net) {
                    let signal = if coordinate.is_angle { "net_moment_n_m" } else { "net_force_n" };
                    push(t, signal, coordinate.name, value, end);
                }
            }
            if complete {
                self.push_joints(&z, &mut |signal, name, value| push(t, signal, name, value, end));
            }
            for drive in self.inverse.actuators.iter().filter(|_| complete) {
                let signal = if drive.own.coordinate.is_angle { "actuator_moment_n_m" } else { "actuator_force_n" };
                push(t, signal, &drive.own.name, drive.own.moment * z[drive.control], false);
            }
            let reactions = if complete { self.reactions(&z) } else { Vec::new() };
            for (name, reaction) in model.mechanics.reaction_names().iter().zip(reactions) {
                push(t, "reaction_n", name, reaction, end);
            }
        }
        let active = active(&self.iterate.inequalities);
        for (bound, active) in self.problem.bounds.iter().zip(active) {
            let limit = self.problem.limit(bound);
            let name = format!("{}.{}", limit.member, limit.name);
            let t = self.problem.scheme.points()[bound.point];
            push(t, "bound_active", &name, f64::from(u8::from(active)), false);
        }
        rows
    }

    /// The measured coordinates at the measured instants, and the solution's there.
    fn push_measured(&self, push: &mut impl FnMut(f64, &str, &str, f64, bool)) {
        let model = self.model();
        let names = model.mechanics.coordinate_names();
        let mut near = Vec::new();
        for (&t, measured) in self.measurement.times.iter().zip(&self.measurement.coordinates) {
            for ((name, measured), found) in names.iter().zip(measured).zip(self.coordinates(t, 0)) {
                push(t, "measured", name, *measured, false);
                push(t, "coordinate", name, found, false);
            }
            let all = self.inverse.all_coordinates(t, measured);
            for (name, value) in model.mechanics.joint_coordinate_values(&all, &mut near) {
                push(t, "measured_joint_coordinate", name, value, false);
            }
        }
    }

    /// The muscles' variables at a point.
    fn push_muscles(&self, push: &mut impl FnMut(f64, &str, &str, f64, bool), (t, z): (f64, &[f64]), complete: bool) {
        let muscles = &self.inverse.muscles;
        let is_state = self.inverse.control.quantity(muscles.activation).kind.is_state();
        for (m, force) in self.inverse.forces.iter().enumerate() {
            let name = &force.muscle().name;
            if complete || is_state {
                push(t, "activation", name, z[muscles.a.at(m)], false);
            }
            let fibre = force.fibre(z);
            if let Some(fibre) = fibre.filter(|_| complete || is_state) {
                push(t, "fibre_length", name, fibre.length, false);
            }
            if complete {
                let excitation = self.inverse.excitation(z, m);
                excitation.into_iter().for_each(|u| push(t, "excitation", name, u, false));
                fibre.into_iter().for_each(|fibre| push(t, "fibre_velocity", name, fibre.velocity, false));
                push(t, "force_n", name, force.muscle().max_isometric_force * force.value(z), false);
            }
        }
    }
}
