//! Entries that files of planar and of spatial models share, and checks of names and numbers in both.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::curves::{
    ActivationDynamics, ActivationLaw, DeGrooteFregly2016, ForceVelocity, MillardParameters, MuscleCurves, Shape,
};
use crate::error::{Issue, nearest};
use crate::names;

#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CurvesEntry {
    /// The curves of muscles, unless a study sets `muscle_curves`.
    #[serde(skip_serializing_if = "is_default")]
    pub family: MuscleCurves,
    /// How activations follow excitations, unless a study sets it.
    #[serde(skip_serializing_if = "is_default")]
    pub activation_dynamics: ActivationDynamics,
    /// Force at infinite lengthening velocity relative to the isometric force, eq. (8) (`thesis`).
    pub eccentric_limit: f64,
    /// Curvature of the shortening branch, b3 of eq. (9); between 0 and 1 (`thesis`).
    pub shortening_curvature: f64,
}

impl Default for CurvesEntry {
    fn default() -> Self {
        let curve = ForceVelocity::default();
        Self {
            family: MuscleCurves::default(),
            activation_dynamics: ActivationDynamics::default(),
            eccentric_limit: curve.eccentric_limit,
            shortening_curvature: curve.shortening,
        }
    }
}

pub fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl CurvesEntry {
    /// # Errors
    /// If a number is out of its range.
    pub fn check(&self) -> std::result::Result<ForceVelocity, Issue> {
        let curve = ForceVelocity { shortening: self.shortening_curvature, eccentric_limit: self.eccentric_limit };
        if !(curve.shortening > 0.0 && curve.shortening < 1.0) {
            return Err(Issue::new(
                &["curves", "shortening_curvature"],
                format!("found {}", curve.shortening),
                "it must lie between 0 and 1; the thesis uses 0.25",
            ));
        }
        if !(curve.eccentric_limit > 1.0 && curve.eccentric_limit.is_finite()) {
            return Err(Issue::new(
                &["curves", "eccentric_limit"],
                format!("found {}", curve.eccentric_limit),
                "it must be above 1; the thesis uses 1.33",
            ));
        }
        Ok(curve)
    }
}

/// What the entry of a muscle says about its fibre beside its size.
#[derive(Clone, Copy, Debug)]
pub struct FibreEntry {
    pub activation_time: f64,
    pub deactivation_time: f64,
    pub activation_steepness: Option<f64>,
    pub damping: Option<f64>,
    pub effort_weight: Option<f64>,
    pub active_width: Option<f64>,
    pub passive_strain: Option<f64>,
    pub tendon_strain: Option<f64>,
    pub millard: Option<MillardParameters>,
}

/// A checked [`FibreEntry`].
#[derive(Clone, Copy, Debug)]
pub struct Fibre {
    pub activation: ActivationLaw,
    pub damping: f64,
    pub effort_weight: f64,
    pub shape: Shape,
}

/// b of OpenSim's class.
const STEEPNESS: f64 = 0.1;

impl FibreEntry {
    /// # Errors
    /// If a number is out of its range.
    pub fn check(
        &self,
        muscle: &str,
        family: ActivationDynamics,
        force_velocity: ForceVelocity,
    ) -> std::result::Result<Fibre, Issue> {
        let key = |key: &'static str| ["muscle", muscle, key];
        let published = DeGrooteFregly2016::default();
        let degroote = DeGrooteFregly2016 {
            active_width: self.active_width.unwrap_or(published.active_width),
            passive_strain: self.passive_strain.unwrap_or(published.passive_strain),
            tendon_strain: self.tendon_strain.unwrap_or(published.tendon_strain),
        };
        let (damping, effort_weight) = (self.damping.unwrap_or(0.0), self.effort_weight.unwrap_or(1.0));
        let steepness = self.activation_steepness.unwrap_or(STEEPNESS);
        positive(&key("activation_time"), self.activation_time, "s")?;
        positive(&key("deactivation_time"), self.deactivation_time, "s")?;
        positive(&key("activation_steepness"), steepness, "0.1 in OpenSim, 10 switches sharply")?;
        positive(&key("active_width"), degroote.active_width, "1 is the published width")?;
        positive(&key("passive_strain"), degroote.passive_strain, "0.6 is the published strain")?;
        positive(&key("tendon_strain"), degroote.tendon_strain, "0.049 is the published strain")?;
        positive(&key("effort_weight"), effort_weight, "1 is that of the other muscles")?;
        if !(damping >= 0.0 && damping.is_finite()) {
            let help = "it must be at least 0; 0.1 is usual";
            return Err(Issue::new(&key("damping"), format!("found {damping}"), help));
        }
        let millard = self.millard.unwrap_or_default();
        if let Some(defect) = millard.defect() {
            let help = "compare with the defaults in data/README.md";
            return Err(Issue::new(&key("millard"), defect, help));
        }
        Ok(Fibre {
            activation: ActivationLaw { family, up: self.activation_time, down: self.deactivation_time, steepness },
            damping,
            effort_weight,
            shape: Shape { force_velocity, degroote, millard },
        })
    }
}

/// An actuator at a joint coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct Actuator {
    pub name: String,
    /// The joint coordinate that it drives.
    pub coordinate: String,
    /// Moment or force at a control of 1, N m or N.
    pub optimal_force: f64,
    /// Bounds on its control.
    pub control: [f64; 2],
}

/// An actuator at a joint coordinate, such as a motor or a residual actuator.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ActuatorEntry {
    /// Name of the actuator.
    pub name: String,
    /// The joint coordinate that it drives.
    pub coordinate: String,
    /// Moment or force at a control of 1, N m or N.
    pub optimal_force: f64,
    /// Lower bound on its control; none by default.
    pub min_control: Option<f64>,
    /// Upper bound on its control; none by default.
    pub max_control: Option<f64>,
}

impl ActuatorEntry {
    /// Checks the entry against the joint coordinates of the model.
    ///
    /// # Errors
    /// If a number is out of range or the coordinate unknown.
    pub fn check<'c>(
        &self,
        coordinates: impl Iterator<Item = &'c str> + Clone,
    ) -> std::result::Result<Actuator, Issue> {
        let key = |key| ["actuator", self.name.as_str(), key];
        positive(&key("optimal_force"), self.optimal_force, "N m or N")?;
        let control = [self.min_control.unwrap_or(f64::NEG_INFINITY), self.max_control.unwrap_or(f64::INFINITY)];
        if control[0].is_nan() || control[1].is_nan() || control[0] >= control[1] {
            let found = format!("found controls from {} to {}", control[0], control[1]);
            return Err(Issue::new(&key("min_control"), found, "the lower bound must be below the upper one"));
        }
        if !coordinates.clone().any(|name| name == self.coordinate) {
            let near = nearest(&self.coordinate, coordinates.clone()).map(|n| format!("did you mean `{n}`? "));
            let all = coordinates.collect::<Vec<_>>().join(", ");
            let help = format!("{}the model has: {all}", near.unwrap_or_default());
            return Err(Issue::new(&key("coordinate"), format!("no joint coordinate `{}`", self.coordinate), help));
        }
        Ok(Actuator {
            name: self.name.clone(),
            coordinate: self.coordinate.clone(),
            optimal_force: self.optimal_force,
            control,
        })
    }
}

/// Rejects numbers that are not positive and finite.
pub fn positive(path: &[&str], value: f64, unit: &str) -> std::result::Result<(), Issue> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(Issue::new(path, format!("found {value}"), format!("it must be a positive number ({unit})")))
    }
}

/// Rejects numbers that are not finite.
pub fn finite(path: &[&str], values: &[f64]) -> std::result::Result<(), Issue> {
    match values.iter().find(|v| !v.is_finite()) {
        None => Ok(()),
        Some(value) => Err(Issue::new(path, format!("found {value}"), "it must be a finite number")),
    }
}

/// Rejects a name that is not safe in files, web pages and spreadsheets.
pub fn named(path: &[&str], name: &str) -> std::result::Result<(), Issue> {
    match names::defect(name) {
        None => Ok(()),
        Some(defect) => {
            let path: Vec<String> = path.iter().map(|key| names::shown(key)).collect();
            let path: Vec<&str> = path.iter().map(String::as_str).collect();
            Err(Issue::new(&path, format!("the name \"{}\": {defect}", names::shown(name)), "give it another name"))
        }
    }
}

/// Checks that each name is safe, can be addressed by studies, and occurs only once.
pub fn unique<'a>(kind: &str, names: impl Iterator<Item = &'a str>) -> std::result::Result<(), Issue> {
    let mut seen = std::collections::BTreeSet::new();
    for name in names {
        named(&[kind, name], name)?;
        if name.contains(['.', '*', ',']) {
            return Err(Issue::new(
                &[kind, name],
                format!("found the name \"{name}\""),
                "a name must not contain `.`, `,` or `*`: studies address values as kind.name.key",
            ));
        }
        if !seen.insert(name) {
            return Err(Issue::new(&[kind, name], format!("the name `{name}` occurs twice"), "give each its own name"));
        }
    }
    Ok(())
}
