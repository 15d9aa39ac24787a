//! Spatial vectors: twists `[ω; v]`, v being the velocity at the ground's origin, wrenches `[moment; force]` about that
//! origin, and inertias between the two. All in the ground's axes.
//!
//! Source: R. Featherstone, *Rigid Body Dynamics Algorithms*, Springer 2008, chapter 2.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use crate::skeleton::frame::{Frame, Vector};

/// A twist or a wrench.
pub type Screw = Vector6<f64>;

pub fn screw(angular: Vector3<f64>, linear: Vector3<f64>) -> Screw {
    Screw::new(angular.x, angular.y, angular.z, linear.x, linear.y, linear.z)
}

pub fn angular(screw: &Screw) -> Vector3<f64> {
    screw.fixed_rows::<3>(0).into()
}

pub fn linear(screw: &Screw) -> Vector3<f64> {
    screw.fixed_rows::<3>(3).into()
}

/// a × b of two twists.
pub fn cross(a: &Screw, b: &Screw) -> Screw {
    let (omega, other) = (angular(a), angular(b));
    screw(omega.cross(&other), omega.cross(&linear(b)) + linear(a).cross(&other))
}

/// a ×* f of a twist and a wrench: `b·(a ×* f) = −(a × b)·f`.
pub fn cross_wrench(a: &Screw, f: &Screw) -> Screw {
    let (omega, force) = (angular(a), linear(f));
    screw(omega.cross(&angular(f)) + linear(a).cross(&force), omega.cross(&force))
}

fn skew(x: &Vector3<f64>) -> Matrix3<f64> {
    x.cross_matrix()
}

fn blocks(a: Matrix3<f64>, b: Matrix3<f64>, c: Matrix3<f64>, d: Matrix3<f64>) -> Matrix6<f64> {
    let mut out = Matrix6::zeros();
    for (block, at) in [(a, (0, 0)), (b, (0, 3)), (c, (3, 0)), (d, (3, 3))] {
        out.fixed_view_mut::<3, 3>(at.0, at.1).copy_from(&block);
    }
    out
}

/// The matrix of `b ↦ a × b`. That of `f ↦ a ×* f` is minus its transpose.
pub fn crossing(a: &Screw) -> Matrix6<f64> {
    let omega = skew(&angular(a));
    blocks(omega, Matrix3::zeros(), skew(&linear(a)), omega)
}

/// The matrix of `a ↦ a ×* f`.
pub fn crossing_into(f: &Screw) -> Matrix6<f64> {
    let force = -skew(&linear(f));
    blocks(-skew(&angular(f)), force, force, Matrix3::zeros())
}

/// Mass, first moment and inertia about a frame's origin, in its axes; those of bodies that move as one add up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MassProperties {
    /// kg
    pub mass: f64,
    /// kg m
    pub moment: Vector3<f64>,
    /// kg m²
    pub inertia: Matrix3<f64>,
}

/// `|x|² − x xᵀ`
fn spread(x: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * x.norm_squared() - x * x.transpose()
}

impl MassProperties {
    /// Of a body with this centre (m) and inertia about it (xx, yy, zz, xy, xz, yz).
    pub fn of_body(mass: f64, centre: Vector, [xx, yy, zz, xy, xz, yz]: [f64; 6]) -> Self {
        let centre = Vector3::from(centre);
        let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) + spread(&centre) * mass;
        Self { mass, moment: centre * mass, inertia }
    }

    /// Of the same bodies about the origin of the outer frame, in its axes.
    pub fn within(&self, frame: &Frame<f64>) -> Self {
        let axes = Matrix3::from_fn(|i, j| frame.axes[i][j]);
        let origin = Vector3::from(frame.origin);
        let moment = axes * self.moment;
        let mixed = origin * moment.transpose();
        let inertia = axes * self.inertia * axes.transpose()
            + spread(&origin) * self.mass
            + Matrix3::identity() * (2.0 * origin.dot(&moment))
            - mixed
            - mixed.transpose();
        Self { mass: self.mass, moment: moment + origin * self.mass, inertia }
    }

    pub fn add(&mut self, other: &Self) {
        self.mass += other.mass;
        self.moment += other.moment;
        self.inertia += other.inertia;
    }

    /// From twists to momenta about the frame's origin.
    pub fn matrix(&self) -> Matrix6<f64> {
        let moment = skew(&self.moment);
        blocks(self.inertia, moment, -moment, Matrix3::identity() * self.mass)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_products_fit_together() {
        let a = Screw::new(0.3, -1.2, 0.7, 2.0, 0.1, -0.4);
        let b = Screw::new(-0.6, 0.2, 1.1, 0.5, -0.9, 0.8);
        let f = Screw::new(1.3, 0.4, -0.2, -0.7, 1.9, 0.6);
        assert!((b.dot(&cross_wrench(&a, &f)) + cross(&a, &b).dot(&f)).abs() < 1e-14);
        assert!((crossing(&a) * b - cross(&a, &b)).norm() < 1e-14);
        assert!((crossing_into(&f) * a - cross_wrench(&a, &f)).norm() < 1e-14);
        assert!((-crossing(&a).transpose() * f - cross_wrench(&a, &f)).norm() < 1e-14);
    }

    #[test]
    fn mass_properties_in_another_frame_are_those_of_the_moved_body() {
        let body = MassProperties::of_body(2.0, [0.1, -0.3, 0.2], [0.3, 0.4, 0.5, 0.01, -0.02, 0.03]);
        let frame = Frame::placed([0.4, 0.5, -0.6], [0.2, -0.7, 1.1]);
        let moved = body.within(&frame);
        let centre = frame.point(&[0.1, -0.3, 0.2]);
        assert!((moved.moment / 2.0 - Vector3::from(centre)).norm() < 1e-14);
        // Kinetic energy is the same in both frames.
        let twist = Screw::new(0.3, -1.2, 0.7, 2.0, 0.1, -0.4);
        let axes = Matrix3::from_fn(|i, j| frame.axes[i][j]).transpose();
        let velocity = linear(&twist) + angular(&twist).cross(&Vector3::from(frame.origin));
        let inner = screw(axes * angular(&twist), axes * velocity);
        let (outside, inside) = (twist.dot(&(moved.matrix() * twist)), inner.dot(&(body.matrix() * inner)));
        assert!((outside - inside).abs() < 1e-12, "{outside} {inside}");
    }
}
