//! Where the links are in a pose, and how what they carry moves with each of them.

use super::{LinkAxis, Tree};
use crate::numerics::Scalar;
use crate::skeleton::frame::Frame;

/// A link in a pose.
#[derive(Clone, Copy, Debug)]
pub struct PlacedLink<T> {
    /// In the ground's frame.
    pub frame: Frame<T>,
    /// The axis that it turns about, or the way that it slides for s = 1 (m), in the ground's axes.
    axis: [T; 3],
    turns: bool,
    /// s′ and s″, s being a function of the drive's argument.
    pub slope: T,
    pub bend: T,
}

impl Tree {
    /// The links at values of all coordinates.
    pub fn pose<T: Scalar>(&self, coordinates: &[T]) -> Vec<PlacedLink<T>> {
        let mut links: Vec<PlacedLink<T>> = Vec::with_capacity(self.links.len());
        for link in &self.links {
            let [s, slope, bend] = link.drive.bent(link.drive.argument(coordinates));
            let parent = link.parent.map_or_else(Frame::identity, |parent| links[parent].frame);
            let frame = parent * link.before.lift() * link.axis.frame(s);
            let (turns, axis) = match link.axis {
                LinkAxis::Turns(axis) => (true, axis),
                LinkAxis::Slides(direction) => (false, direction),
            };
            links.push(PlacedLink { frame, axis: turned(&frame, &axis.map(T::from)), turns, slope, bend });
        }
        links
    }
}

/// A direction of a frame in the outer axes.
pub fn turned<T: Scalar>(frame: &Frame<T>, x: &[T; 3]) -> [T; 3] {
    frame.axes.map(|row| row[0] * x[0] + row[1] * x[1] + row[2] * x[2])
}

fn cross<T: Scalar>(a: &[T; 3], b: &[T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl<T: Scalar> PlacedLink<T> {
    /// How a point of the ground's frame that the link carries moves with s: ∂x/∂s.
    pub fn moves_point(&self, x: &[T; 3]) -> [T; 3] {
        if self.turns { cross(&self.axis, &[0, 1, 2].map(|i| x[i] - self.frame.origin[i])) } else { self.axis }
    }

    /// How a direction that the link carries moves with s. A link further in takes the changes by those further out with
    /// it: ∂²x/∂s_i ∂s_j is this of ∂x/∂s_j if i carries j, or is j.
    pub fn moves_direction(&self, x: &[T; 3]) -> [T; 3] {
        if self.turns { cross(&self.axis, x) } else { [T::from(0.0); 3] }
    }

    /// ω for ds/dt = 1; zero if the link slides.
    pub fn turn(&self) -> [T; 3] {
        if self.turns { self.axis } else { [T::from(0.0); 3] }
    }
}
