//! Resolves frames to a body and a pose on it. OpenSim's frames are bodies and offset frames, which are placed in other
//! frames.

use std::collections::HashSet;

use super::document::Element;
use crate::error::Result;
use crate::skeleton::file::GROUND;
use crate::skeleton::frame::Frame;

/// All frames of a model.
pub struct Frames<'d> {
    bodies: HashSet<&'d str>,
    offsets: Vec<Offset<'d>>,
}

/// An offset frame.
struct Offset<'d> {
    /// Name of the enclosing joint, body or other component.
    owner: &'d str,
    element: Element<'d>,
}

/// A frame on a body.
#[derive(Clone, Copy, Debug)]
pub struct PlacedFrame<'d> {
    pub body: &'d str,
    pub frame: Frame<f64>,
    /// Point and rotations about x, y and z as in the file, if it gives them directly.
    as_written: Option<([f64; 3], [f64; 3])>,
}

impl<'d> PlacedFrame<'d> {
    /// The frame of the body itself.
    pub fn on(body: &'d str) -> Self {
        Self::at(body, [0.0; 3], [0.0; 3])
    }

    /// A frame at a point of a body (m), with body-fixed rotations about x, y and z (rad).
    pub fn at(body: &'d str, point: [f64; 3], rotation: [f64; 3]) -> Self {
        Self { body, frame: Frame::placed(point, rotation), as_written: Some((point, rotation)) }
    }

    /// The frame `inner` of this frame.
    pub fn then(&self, inner: Frame<f64>) -> Self {
        Self { body: self.body, frame: self.frame * inner, as_written: None }
    }

    /// A frame at a point of this frame (m), with body-fixed rotations about x, y and z (rad).
    pub fn within(&self, point: [f64; 3], rotation: [f64; 3]) -> Self {
        match self.as_written {
            Some(([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])) => Self::at(self.body, point, rotation),
            _ => self.then(Frame::placed(point, rotation)),
        }
    }

    /// The point (m), and body-fixed rotations about x, y and z (rad).
    pub fn point_and_rotation(&self) -> ([f64; 3], [f64; 3]) {
        self.as_written.unwrap_or_else(|| {
            let r = &self.frame.axes;
            let second = r[0][2].clamp(-1.0, 1.0).asin();
            // Gimbal lock: the x- and z-axes are parallel, and x takes the whole rotation.
            let rotation = if r[0][2].abs() < 1.0 - 1e-12 {
                [(-r[1][2]).atan2(r[2][2]), second, (-r[0][1]).atan2(r[0][0])]
            } else {
                [r[2][1].atan2(r[1][1]), second, 0.0]
            };
            (self.frame.origin, rotation)
        })
    }
}

impl<'d> Frames<'d> {
    /// Collects the bodies and offset frames of a model.
    pub fn new(model: Element<'d>, bodies: &[Element<'d>]) -> Self {
        let offsets = ["PhysicalOffsetFrame", "OffsetFrame"].into_iter().flat_map(|tag| model.descendants(tag));
        let offset = |element: Element<'d>| {
            // This skips <frames> and <components>, which have no name.
            let owner = element.node.ancestors().skip(1).find_map(|node| node.attribute("name"));
            Offset { owner: owner.unwrap_or(""), element }
        };
        Self { bodies: bodies.iter().map(Element::name).collect(), offsets: offsets.map(offset).collect() }
    }

    /// Resolves the frame that the element `by` names by `path`. Offset frames of `owner` take precedence.
    ///
    /// # Errors
    /// If there is no such frame, or if frames refer to each other in a circle.
    pub fn find(&self, by: Element<'d>, path: &'d str, owner: &str) -> Result<PlacedFrame<'d>> {
        let mut chain = Vec::new();
        let (mut path, mut owner) = (path, owner);
        let body = loop {
            let mut parts = path.split('/').filter(|part| !part.is_empty() && *part != "." && *part != "..").rev();
            let name = parts.next().unwrap_or("");
            let within = parts.next().filter(|set| *set != "bodyset" && *set != "jointset").unwrap_or(owner);
            let named = || self.offsets.iter().filter(|offset| offset.element.name() == name);
            let offset = named().find(|offset| offset.owner == within);
            let is_body = name == GROUND || self.bodies.contains(name);
            match offset.or_else(|| named().next().filter(|_| !is_body)) {
                Some(offset) if chain.len() <= self.offsets.len() => {
                    chain.push(offset.element);
                    let Some(parent) = offset.element.reference("parent", &["parent"]) else {
                        return Err(offset.element.error("the frame has no parent", "name it in <socket_parent>"));
                    };
                    // `..` refers to the enclosing component.
                    let up = parent.trim_matches('/') == "..";
                    (path, owner) = (if up { offset.owner } else { parent }, offset.owner);
                }
                Some(offset) => {
                    let help = "each chain of frames must end at a body";
                    return Err(offset.element.error("frames refer to each other in a circle", help));
                }
                None if is_body => break if name == GROUND { GROUND } else { self.body(name) },
                None => return Err(by.error(format!("there is no body or frame `{path}`"), &self.known())),
            }
        };
        chain.iter().rev().try_fold(PlacedFrame::on(body), |placed, offset| {
            let point = offset.vector("translation")?.unwrap_or_default();
            Ok(placed.within(point, offset.vector("orientation")?.unwrap_or_default()))
        })
    }

    fn body(&self, name: &str) -> &'d str {
        self.bodies.get(name).expect("checked before")
    }

    /// Help text with up to 20 bodies of the model.
    fn known(&self) -> String {
        let mut names: Vec<&str> = self.bodies.iter().copied().take(20).collect();
        names.sort_unstable();
        format!("the bodies include: {}", names.join(", "))
    }
}
